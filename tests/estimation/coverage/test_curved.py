"""Intervals by profile and between limits, against a grid of costs and against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import norm

import mbm

CURVED = """
(problem curved
  (data d (table (x y) (1 1.0) (2 3.1) (3 2.9) (5 4.0) (7 4.2)))
  (unknowns (a :init 5) (b :init 0.5))
  (observe d (= y (* a (- 1 (exp (* (- b) x))))) :sigma 0.6)
  (derive (half (/ 0.69 b)) (r (* a a b))))
"""


@pytest.fixture(scope="module")
def region() -> dict[str, tuple[float, float]]:
    """Extremes over the points where the cost has grown by 1.96²: the profile intervals, by their definition."""
    x, y = np.array([1, 2, 3, 5, 7.0]), np.array([1, 3.1, 2.9, 4, 4.2])
    a, b = np.meshgrid(np.linspace(3, 9, 1500), np.linspace(0.1, 1.0, 1500))
    cost = sum(((a * (1 - np.exp(-b * each)) - value) / 0.6) ** 2 for each, value in zip(x, y, strict=True))
    inside = cost <= cost.min() + norm.ppf(0.975) ** 2
    every = {"a": a, "b": b, "half": 0.69 / b, "r": a * a * b}
    return {name: (each[inside].min(), each[inside].max()) for name, each in every.items()}


@pytest.mark.parametrize("name", ["a", "b", "half", "r"])
def test_profiles_end_where_the_cost_has_grown_enough(name: str, region: dict[str, tuple[float, float]]) -> None:
    found = mbm.loads(CURVED).solve()[name]
    assert found.interval_kind == "profile"
    low, high = region[name]
    # the grid has steps of 1/1500 of its width, ends are found to 1/1000
    assert found.interval() == pytest.approx([low, high], abs=6e-3 * (high - low))


def test_profiles_follow_the_level() -> None:
    found = mbm.loads(CURVED).solve()["a"]
    wider, narrower = found.interval(0.95), found.interval(0.5)
    assert wider[0] < narrower[0] < float(found.value) < narrower[1] < wider[1]


LIMITED = """
(problem limited
  (data d (table (y) ({y})))
  (unknowns (d {option}) (e))
  (observe d (= y d) :sigma 5)
  (observe again d (= y e) :sigma 1)
  {constraint})
"""


@pytest.mark.parametrize(
    ("option", "constraint"),
    [
        (":in (-0.5 0.5)", ""),
        ("", "(constraints (uniform d -0.5 0.5))"),
        ("", "(constraints (<= d 0.5) (>= (* 2 d) -1))"),
    ],
)
def test_a_limit_within_the_interval_cuts_it(option: str, constraint: str) -> None:
    """Shortest interval about the mode: to the nearer limit, and as far below as 95 % between the limits ask for."""
    found = mbm.loads(LIMITED.format(y=0.1, option=option, constraint=constraint)).solve()
    assert found["d"].interval_kind == "limited"
    law = norm(0.1, 5)
    whole = law.cdf(0.5) - law.cdf(-0.5)
    wanted = law.ppf(law.cdf(0.5) - 0.95 * whole)
    assert found["d"].interval() == pytest.approx([wanted, 0.5], abs=1e-9)
    assert found["e"].interval_kind == "t"


@pytest.mark.parametrize(("option", "constraint"), [(":in (-0.5 0.5)", ""), ("", "(constraints (uniform d -0.5 0.5))")])
def test_an_estimate_at_its_limit_has_an_interval(option: str, constraint: str) -> None:
    found = mbm.loads(LIMITED.format(y=4, option=option, constraint=constraint)).solve()
    law = norm(4, 5)
    whole = law.cdf(0.5) - law.cdf(-0.5)
    assert found["d"].interval_kind == "limited"
    assert found["d"].interval() == pytest.approx([law.ppf(law.cdf(0.5) - 0.95 * whole), 0.5], abs=1e-6)


def test_boxes_on_angles_limit_the_angle_that_is_reported() -> None:
    text = """(problem p (data d (table (y) (3.1))) (unknowns (w angle :in (170deg 190deg)))
      (observe d (= y w) :sigma 20deg))"""
    found = mbm.loads(text).solve()["w"]
    low, high = np.rad2deg(found.interval())
    assert low == pytest.approx(170, abs=1e-6)
    assert 180 < high <= 190


def test_limits_in_many_solves_are_those_of_one() -> None:
    rows = " ".join(f"({g} {0.01 * g})" for g in range(40))
    for limit in ("(unknowns (d :in (-0.5 0.5)))", "(unknowns (d)) (constraints (uniform d -0.5 0.5))"):
        text = f"(problem many (data d (table (g y) {rows})) {limit} (observe d (= y d) :sigma 5) (for-each g))"
        solves = mbm.loads(text).solve().document()["solves"]
        for g in (0, 10, 39):
            one = mbm.loads(text.replace(rows, f"({g} {0.01 * g})").replace("(for-each g)", "")).solve()
            entry = solves[g]["estimates"]["d"]
            assert entry["interval_kind"] == "limited"
            assert entry["interval"] == pytest.approx(one["d"].interval(), abs=1e-9)


WEIGHED = """(problem weighed
  (data d (table (t y) (0 2.9) (1 5.3) (2 7.5) (3 8.1) (4 12) (5 13)))
  (unknowns (a) (b))
  (observe d (= y (+ a (* b t))) :sigma {})
  (derive (q (* 2 a))))"""


def test_an_interval_whose_end_is_steep_is_followed_to_it():
    """Poisson-like weights: the profile of the intercept rises without bound where the model reaches zero."""
    t, y = np.arange(6.0), np.array([2.9, 5.3, 7.5, 8.1, 12.0, 13.0])
    found = mbm.loads(WEIGHED.format("(sqrt model)")).solve()
    a, b = float(found["a"].value), float(found["b"].value)

    def density(intercept: float, slope: float) -> float:
        model = intercept + slope * t
        return float(((y - model) ** 2 / model + np.log(model)).sum()) if (model > 0).all() else 1e9

    def growth(intercept: float) -> float:
        least = minimize_scalar(lambda slope: density(intercept, slope), bounds=(0.2, 5), method="bounded").fun
        return float(least) - density(a, b) - norm.ppf(0.975) ** 2

    ends = [brentq(growth, 0.05, a), brentq(growth, a, 9.0)]
    # profiles are followed to a thousandth
    assert np.abs(found["a"].interval(0.95) - ends) == pytest.approx(0, abs=2e-3 * (ends[1] - ends[0]))


@pytest.mark.parametrize("sigma", ["(sqrt model)", "(* 10% model)", "(hypot 0.3 (* 5% model))", "0.5"])
def test_twice_an_unknown_is_as_doubtful_as_the_unknown(sigma):
    found = mbm.loads(WEIGHED.format(sigma)).solve()
    assert found["q"].interval(0.95) == pytest.approx(2 * found["a"].interval(0.95), rel=1e-2)
    said = [each.message for each in found.diagnostics if each.code.name == "too-nonlinear"]
    assert sum("`a`" in each for each in said) == sum("`q`" in each for each in said)


@pytest.mark.parametrize("apart", [0.02, 0.08, 0.15])
def test_the_larger_of_two_ends_below_where_both_have_come_down(apart: float) -> None:
    """Two means with the standard deviation 1: the larger is t below its estimate where t² + (t − apart)² = 1.96²."""
    found = mbm.loads(
        f"(problem p (data d (table (y z) ({apart} 0))) (unknowns (a) (b)) (observe d (= [y z] [a b]) :sigma 1)"
        " (derive (m (max a b)) (s (- (min (- a) (- b))))))"
    ).solve()
    below = (apart + np.sqrt(2 * norm.ppf(0.975) ** 2 - apart**2)) / 2
    for name in ("m", "s"):
        assert found[name].interval_kind == "profile"
        # ends are found to 1/100 of the cost's root
        assert found[name].interval() == pytest.approx([apart - below, apart + norm.ppf(0.975)], abs=0.02 * below)


@pytest.mark.parametrize(
    ("a", "b", "form"),
    [(0.5, 0.2, "(max a (* 2 b))"), (0.2, 0.05, "(max a b (- a b))"), (0.08, 0.0, "(+ (abs a) (abs b))")],
)
def test_another_piece_may_reach_farther_than_that_at_the_estimate(a: float, b: float, form: str) -> None:
    """Both ends are extremes over the disc where the cost has grown by 1.96²."""
    found = mbm.loads(
        f"(problem p (data d (table (y z) ({a} {b}))) (unknowns (a) (b)) (observe d (= [y z] [a b]) :sigma 1)"
        f" (derive (m {form})))"
    ).solve()["m"]
    turn, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 4001), norm.ppf(0.975) * np.linspace(0, 1, 401))
    u, v = a + radius * np.cos(turn), b + radius * np.sin(turn)
    forms = {"(max a (* 2 b))": np.maximum(u, 2 * v), "(max a b (- a b))": np.maximum(np.maximum(u, v), u - v)}
    values = forms.get(form, np.abs(u) + np.abs(v))
    # ends are found to 1/100 of the cost's root
    assert found.interval() == pytest.approx(
        [values.min(), values.max()], abs=0.02 * norm.ppf(0.975) * float(found.sigma)
    )


@pytest.mark.parametrize(("mean", "sigma"), [(0.25, 0.1414), (0.31, 0.2), (-0.1, 0.3)])
def test_quotients_and_logarithms_have_no_end_where_they_have_none(mean: float, sigma: float) -> None:
    """The 95 % interval of b reaches beyond 0."""
    forms = "(i (/ 1 b)) (square (/ -1 (* b b))) (l (log (+ b 0.2))) (s (sqrt b)) (d (/ (+ b 1) b))"
    found = mbm.loads(f"(problem p (unknowns (b)) (observe (= {mean} b) :sigma {sigma}) (derive {forms}))").solve()
    low, high = np.array([-1, 1]) * norm.ppf(0.975) * sigma + mean
    assert list(found["i"].interval()) == list(found["d"].interval()) == [-np.inf, np.inf]
    ends = [-np.inf, -1 / max(-low, high) ** 2]
    # profiles are followed to a thousandth
    np.testing.assert_allclose(found["square"].interval(), ends, rtol=1e-3)
    inside = max(low + 0.2, 0.0)
    np.testing.assert_allclose(
        found["l"].interval(), [np.log(inside) if inside else -np.inf, np.log(high + 0.2)], atol=2e-3
    )
    if mean > 0.0:
        np.testing.assert_allclose(found["s"].interval(), [0.0, np.sqrt(high)], atol=2e-3)


@pytest.mark.parametrize("b", [0.0, 0.6, 1.2, 1.8])
@pytest.mark.parametrize("a", [0.3, 1.0, 2.0])
def test_quotients_of_two_estimates_have_no_end_where_the_divisor_reaches_0(a: float, b: float) -> None:
    found = mbm.loads(
        f"(problem p (data d (table (y z) ({a} {b}))) (unknowns (a) (b)) (observe d (= [y z] [a b]) :sigma 1)"
        " (derive (q (/ a (+ b 0.05)))))"
    ).solve()
    assert list(found["q"].interval()) == [-np.inf, np.inf]


def test_beside_a_limit_what_is_derived_of_one_estimate_has_no_end_where_its_divisor_is_0() -> None:
    found = mbm.loads(
        "(problem p (unknowns (b :in (-0.05 5))) (observe (= -0.1 b) :sigma 0.2)"
        " (derive (i (/ 1 b)) (l (log (abs b)))))"
    ).solve()
    assert list(found["i"].interval()) == [-np.inf, np.inf]
    np.testing.assert_allclose(found["l"].interval(), [-np.inf, np.log(found["b"].interval()[1])])


@pytest.mark.parametrize("each", ["", "(for-each g)"])
def test_what_bends_across_its_slope_goes_as_far_as_the_estimates_take_it(each: str) -> None:
    """Most of b + 5 a² is where a is far from 0, although it is b that it depends on most at the estimates."""
    readings = (0.1, 1.2, 1.5)
    rows = " ".join(f"({g} {0.1 + 1e-6 * g} 1.2 1.5)" for g in range(10 if each else 1))
    solve = mbm.loads(
        f"(problem p (data d (table (g u v w) {rows})) {each} (unknowns (a) (b))"
        " (observe d (= [u v w] [a (+ b a) (+ b (* 2 a))]) :sigma 0.5) (derive (bent (+ b (* 5 a a)))))"
    ).solve()
    a, b = np.meshgrid(np.linspace(-4.0, 4.0, 2001), np.linspace(-4.0, 6.0, 4001), indexing="ij")
    cost = ((a - readings[0]) ** 2 + (b + a - readings[1]) ** 2 + (b + 2 * a - readings[2]) ** 2) / 0.25
    values = (b + 5 * a**2)[cost - cost.min() < norm.ppf(0.975) ** 2]
    for each_solve in solve.solves:
        # the grid is as fine as a hundredth of the width
        wanted = [values.min(), values.max()]
        assert each_solve["bent"].interval() == pytest.approx(wanted, abs=0.01 * np.ptp(wanted))
        assert any(d.code.name == "too-nonlinear" for d in each_solve.diagnostics)


COUNTED = """(problem p (data d (table (x n) (1 3) (2 4) (3 5) (4 11))) (unknowns (a) (b)) {stated}
  (observe d (= n (+ {a} (* b x))) :distribution poisson) (derive (g a) (f (+ a (* b x)) :over (grid x 0 5 2))))"""


@pytest.mark.parametrize(
    ("stated", "a"),
    [("", "a"), ("(constraints (<= (+ a b) 20))", "a"), ("(constants (c 1 :sigma 0.001))", "(* c a)")],
)
def test_what_is_derived_of_counts_ends_where_their_likelihood_does(stated: str, a: str) -> None:
    x, n = np.arange(1.0, 5.0), np.array([3.0, 4.0, 5.0, 11.0])
    found = mbm.loads(COUNTED.format(stated=stated, a=a)).solve()
    at_0, at_5 = np.meshgrid(np.linspace(-4.0, 7.0, 1101), np.linspace(4.0, 20.0, 1601), indexing="ij")
    model = at_0 + (at_5 - at_0) / 5 * x[:, None, None]
    cost = 2 * (model - n[:, None, None] * np.log(np.maximum(model, 1e-300))).sum(axis=0)
    cost[(model <= 0.0).any(axis=0)] = np.inf
    inside = cost < cost.min() + norm.ppf(0.975) ** 2
    wanted = np.array([[each[inside].min(), each[inside].max()] for each in (at_0, at_5)])
    # profiles are followed to a thousandth, of derived quantities to a hundredth of the cost's root
    assert found["a"].interval() == pytest.approx(wanted[0], abs=0.02 * np.ptp(wanted[0]))
    assert found["g"].interval() == pytest.approx(wanted[0], abs=0.02 * np.ptp(wanted[0]))
    assert found["f"].interval() == pytest.approx(wanted, abs=0.02 * np.ptp(wanted[1]))
    assert sum(each.code.name == "too-nonlinear" for each in found.diagnostics) >= 3


def test_what_is_derived_of_rounded_readings_goes_as_far_as_these_let_it() -> None:
    """All readings are 5, in steps of 1 and with a scatter of 0.1."""
    found = mbm.loads(
        "(problem p (data d (table (x) (5) (5) (5) (5))) (unknowns (m))"
        " (observe d (= x m) :sigma 0.1 :resolution 1) (derive (twice (* 2 m))))"
    ).solve()
    mean = np.linspace(4.0, 6.0, 4001)
    cost = -8 * np.log(norm.cdf((5.5 - mean) / 0.1) - norm.cdf((4.5 - mean) / 0.1))
    inside = mean[cost < cost.min() + norm.ppf(0.975) ** 2]
    assert found["m"].interval() == pytest.approx([inside.min(), inside.max()], abs=2e-3)
    assert found["twice"].interval() == pytest.approx(2 * inside[[0, -1]], abs=4e-3)
