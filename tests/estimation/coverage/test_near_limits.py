"""Near a limit that holds no estimate: a grid of all estimates within it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, t

import mbm
from tests.estimation.coverage.test_beside_limits import NEAR, shortest


def test_near_a_limit_a_ratio_ends_where_its_least_cost_within_the_limit_has_grown() -> None:
    """It is no sum, and nothing holds: its interval once began at the estimate and ended at 354022."""
    x, y = np.arange(1.0, 6.0), np.array([1.3, 1.1, 1.6, 2.2, 2.4])
    text = """(problem p (data d external) (unknowns (a :in (0.2 10)) (b))
        (observe d (= y (+ a (* b x))) :sigma 0.4) (derive (r (/ a b))))"""
    found = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})["r"]

    def growth(ratio: float) -> float:
        slope = max(y @ (ratio + x) / np.square(ratio + x).sum(), 0.2 / ratio)
        least = np.polynomial.Polynomial.fit(x, y, 1)(x) - y
        return float(np.square(y - slope * (ratio + x)).sum() - least @ least) / 0.16 - norm.ppf(0.975) ** 2

    middle = float(found.value)
    ends = brentq(growth, 0.05, middle), brentq(growth, middle, 60.0)
    assert found.interval() == pytest.approx(ends, rel=NEAR)


@pytest.mark.parametrize("readings", [(-0.3, 1.2, 1.8), (0.1, 1.2, 1.5), (0.25, 1.0, 1.5)])
def test_near_a_limit_all_that_depends_on_what_it_limits_keeps_to_it(readings: tuple[float, float, float]) -> None:
    """A grid of both: what bends ends where the least cost has grown, and the other estimate has its shortest share."""
    found = mbm.loads(
        "(problem p (unknowns (a :in (0 5)) (b)) (observe (= {} a) (= {} (+ b a)) (= {} (+ b (* 2 a))) :sigma 0.5)"
        " (derive (bent (+ b (* 5 a a))) (less (- b (* a a a))) (exp (exp (- b a)))))".format(*readings)
    ).solve()
    a, b = np.meshgrid(np.linspace(0.0, 4.0, 2001), np.linspace(-4.0, 6.0, 4001), indexing="ij")
    cost = ((a - readings[0]) ** 2 + (b + a - readings[1]) ** 2 + (b + 2 * a - readings[2]) ** 2) / 0.25
    cost -= cost.min()
    assert found["a"].interval()[0] == 0.0 < found["a"].sigma
    inside = cost < norm.ppf(0.975) ** 2
    for name, values in (("bent", b + 5 * a**2), ("less", b - a**3), ("exp", np.exp(b - a))):
        wanted = values[inside].min(), values[inside].max()
        # ends that are right to a tenth of the growth's root stay, and the grid is as fine as a hundredth of them
        assert found[name].interval() == pytest.approx(wanted, abs=0.03 * (wanted[1] - wanted[0]))
    assert found["b"].interval() == pytest.approx(shortest(b[0], cost.min(axis=0)), abs=0.01)


def test_where_all_estimates_are_at_limits_each_has_the_interval_of_all_together() -> None:
    """Both at once, and one that meets the limit of both as it leaves its own: a grid of both."""
    text = """(problem p (unknowns (a :in (0 5)) (b :in (0 5))) {}
        (observe (= -0.1 a) (= -0.2 b) (= -0.2 (+ a (* 2 b))) :sigma 1)
        (derive (bent (exp (+ a (* a b)))) (sum (+ a b))))"""
    for limit in ("", "(constraints (<= (+ a b) 1))"):
        found = mbm.loads(text.format(limit)).solve()
        a, b = np.meshgrid(np.linspace(0.0, 6.0, 1501), np.linspace(0.0, 6.0, 1501), indexing="ij")
        cost = (a + 0.1) ** 2 + (b + 0.2) ** 2 + (a + 2 * b + 0.2) ** 2
        cost[a + b > (1.0 if limit else np.inf)] = np.inf
        cost -= cost.min()
        assert found["bent"].interval()[0] == pytest.approx(1.0)
        for name, costs in (("a", cost.min(axis=1)), ("b", cost.min(axis=0))):
            # two steps of the grid
            assert found[name].interval() == pytest.approx(shortest(a[:, 0], costs), abs=8e-3)


def test_near_a_limit_scatter_in_proportion_to_the_model_has_ends() -> None:
    """The cost grows with the logarithm of the model only, far above: it once ended at 2.6e15."""
    x, y = np.arange(1.0, 7.0), np.array([5.2, 4.1, 3.3, 4.4, 8.0, 6.7])
    found = mbm.loads(
        "(problem p (data d external) (unknowns (a) (b positive))"
        " (observe d (= y (+ a (* b x))) :sigma (unknown (* 1 model))))"
    ).solve(data={"d": {"x": x, "y": y}})
    a, b = np.meshgrid(np.linspace(0.0, 12.0, 601), np.linspace(0.0, 3.0, 601), indexing="ij")
    model = np.maximum(a[..., None] + b[..., None] * x, 1e-9)
    cost = 6 * np.log(np.square(y / model - 1.0).mean(axis=-1)) + 2 * np.log(model).sum(axis=-1)
    inside = cost - cost.min() < 6 * np.log1p(t.ppf(0.975, 4) ** 2 / 4)
    for name, values in (("a", a[inside]), ("b", b[inside])):
        # the scale is one of all estimates together, with effective degrees of freedom
        wanted = [values.min(), values.max()]
        assert found[name].interval() == pytest.approx(wanted, abs=0.15 * np.ptp(wanted))


def test_near_a_limit_at_0_a_quotient_by_what_it_limits_has_no_end() -> None:
    """At b = 0, a has both signs within its likelihood and a - 1 has one; at a = 0, b may be anything above 0."""
    text = """(problem p (data d (table (x y) (1 0.3) (2 0.1) (3 0.45) (4 0.2))) (unknowns (a) (b positive))
        (observe d (= y (+ a (* 2 b x))) :sigma unknown) (derive (r (/ a b)) (j (/ (- a 1) b)) (h (/ b a))))"""
    found = mbm.loads(text).solve()
    assert list(found["r"].interval()) == list(found["h"].interval()) == [-np.inf, np.inf]
    low, high = found["j"].interval()
    assert low == -np.inf < high < 0.0
