"""Uncertain constants beside limits: what an estimate would be without its limit varies with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq, minimize
from scipy.stats import norm, t, truncnorm

import mbm

TEXT = """(problem p (data d external) (constants (h 0 :sigma 0.3)) (unknowns {unknown}) {limit} {each}
    (observe d (= y (+ a h)) :sigma 0.2) (derive (twice (* 2 a)) (square (^ a 2))))"""


@pytest.mark.parametrize(("unknown", "limit"), [("(a :in (0 10))", ""), ("(a)", "(constraints (>= a 0))")])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
@pytest.mark.parametrize("readings", [(-0.3, -0.1, 0.02), (0.1, 0.04, 0.08)])
def test_a_constant_widens_the_interval_at_a_limit(
    unknown: str, limit: str, each: str, readings: tuple[float, ...]
) -> None:
    """The interval is that of the normal distribution of both parts that is left between the limits: held and not."""
    text = TEXT.format(unknown=unknown, limit=limit, each=each)
    found = mbm.loads(text).solve(data={"d": {"y": np.array(readings), "k": np.zeros(3)}}).solves[0]
    centre, scale = float(np.mean(readings)), float(np.hypot(0.2 / np.sqrt(3), 0.3))
    far = truncnorm.ppf(0.95, -centre / scale, np.inf, centre, scale)
    assert far > 2 * centre  # the shortest begins at the limit
    for name, end in (("a", far), ("twice", 2 * far), ("square", far**2)):
        # 1e-6: half of a difference of two solves stands for the derivative
        assert found[name].interval() == pytest.approx([0.0, end], rel=1e-6, abs=1e-9)


def test_the_degrees_of_freedom_of_a_constant_count_at_a_limit() -> None:
    """Those of the sum of both variances, after Welch and Satterthwaite: Student's t that is left from 0 to 10."""
    text = TEXT.format(unknown="(a :in (0 10))", limit="", each="").replace(":sigma 0.3", ":sigma 0.3 :dof 4")
    readings = np.array([-0.3, -0.1, 0.02])
    found = mbm.loads(text).solve(data={"d": {"y": readings}})
    own, added = 0.2**2 / 3, 0.3**2
    law = t(4 * (own + added) ** 2 / added**2, readings.mean(), np.sqrt(own + added))
    far = law.isf(0.05 * law.sf(0.0) + 0.95 * law.sf(10.0))
    assert found["a"].interval() == pytest.approx([0.0, far], rel=1e-6, abs=1e-9)


X, Y = np.arange(1.0, 6.0), np.array([0.3, 1.1, 1.6, 2.2, 2.4])
LINE = """(problem p (data d external) (constants (c 0.1 :sigma 0.3)) (unknowns {unknown} (b)) {limit} {each}
    (observe d (= y (+ a c (* b x))) :sigma 0.4)
    (derive (sum (+ a c)) (difference (- c a)) (far (- (+ a c) (* 6 b))) (both (+ a b))))"""
DERIVED = {
    "sum": np.array([1.0, 0.0, 1.0]),
    "difference": np.array([-1.0, 0.0, 1.0]),
    "far": np.array([1.0, -6.0, 1.0]),
    "both": np.array([1.0, 1.0, 0.0]),
}


@pytest.mark.parametrize(
    ("unknown", "limit", "held"),
    [
        ("(a :in (0 10))", "", [-1.0, 0.0]),
        ("(a)", "(constraints (>= a 0))", [-1.0, 0.0]),
        ("(a)", "(constraints (<= (+ a b) 0.2))", [1.0, 1.0]),
    ],
)
@pytest.mark.parametrize("offset", [0.0, -1.0])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_a_constant_widens_what_is_derived_of_it_and_of_what_a_limit_holds(
    unknown: str, limit: str, held: list[float], each: str, offset: float
) -> None:
    """The profile, within the limit, of the normal distribution of all three without it: its shortest share."""
    text, y = LINE.format(unknown=unknown, limit=limit, each=each), Y - offset * held[0]
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y, "k": np.zeros(5)}}).solves[0]
    design = np.column_stack([np.ones(5), X])
    spread, way = np.linalg.inv(design.T @ design), np.array([-1.0, 0.0, 1.0])  # of (a, b, c) with c
    centre = np.append(spread @ design.T @ (y - 0.1), 0.1)
    covariance = 0.3**2 * np.outer(way, way)
    covariance[:2, :2] += 0.4**2 * spread
    line, edge = np.append(held, 0.0), 0.2 if held[0] > 0.0 else 0.0
    assert line @ centre > edge
    if held[1] == 0.0:
        assert found["sum"].reason is not None and "with uncertain constants" in found["sum"].reason
    for name, gradient in DERIVED.items():
        grid = np.linspace(-12.0, 6.0, 72_001)
        cost = (grid - gradient @ centre) ** 2 / (gradient @ covariance @ gradient)
        rows = np.array([gradient, line])
        inner = rows @ covariance @ rows.T
        place = line @ centre + inner[0, 1] / inner[0, 0] * (grid - gradient @ centre)
        beyond = inner[1, 1] - inner[0, 1] ** 2 / inner[0, 0]
        if beyond > 1e-12:
            cost += np.maximum(place - edge, 0.0) ** 2 / beyond
        else:
            cost = np.where(place <= edge, cost, np.inf)
        left = np.exp(-0.5 * (cost - cost.min()))
        order = np.argsort(-left, kind="stable")
        inside = grid[order[: int(np.searchsorted(np.cumsum(left[order]), 0.95 * left.sum())) + 1]]
        ends, reach = found[name].interval(), inside.max() - inside.min()
        # what is left is summed up over 400 places
        assert ends == pytest.approx([inside.min(), inside.max()], abs=5e-3 * reach)


@pytest.mark.parametrize(
    ("form", "function"),
    [("(+ (exp b) c)", lambda z: np.exp(z[1]) + z[2]), ("(exp (+ a b))", lambda z: np.exp(z[0] + z[1]))],
)
def test_a_constant_widens_what_bends(form: str, function: Callable[[np.ndarray], float]) -> None:
    """To where the least cost over all three, a ≥ 0, has grown by 1.96²."""
    text = LINE.format(unknown="(a :in (0 10))", limit="", each="").replace("(sum (+ a c))", f"(bent {form})")
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": Y}})
    design, way = np.column_stack([np.ones(5), X]), np.array([-1.0, 0.0, 1.0])
    spread = np.linalg.inv(design.T @ design)
    centre = np.append(spread @ design.T @ (Y - 0.1), 0.1)
    covariance = 0.3**2 * np.outer(way, way)
    covariance[:2, :2] += 0.4**2 * spread
    inverse = np.linalg.inv(covariance)

    def least(value: float | None) -> tuple[float, np.ndarray]:
        ends = [] if value is None else [{"type": "eq", "fun": lambda z: function(z) - value}]
        best = minimize(
            lambda z: (z - centre) @ inverse @ (z - centre),
            np.maximum(centre, [0.0, -9.0, -9.0]),
            method="SLSQP",
            bounds=[(0.0, None), (None, None), (None, None)],
            constraints=ends,
            options={"ftol": 1e-12},
        )
        return float(best.fun), best.x

    cost, place = least(None)
    middle, most = function(place), cost + norm.ppf(0.975) ** 2
    low, high = (
        brentq(lambda value: least(value)[0] - most, *ends, xtol=1e-5) for ends in ((0.6, middle), (middle, 4.0))
    )
    # ends are where the growth is right to 0.2 %
    assert found["bent"].interval() == pytest.approx([low, high], rel=5e-3)


@pytest.mark.parametrize("each", ["", "(for-each k)"])
@pytest.mark.parametrize("unknown", ["(a positive)", "(a :in (0 10))"])
def test_a_constant_widens_what_bends_beside_an_estimate_at_its_limit(unknown: str, each: str) -> None:
    """Where the quantity does not move with the constant, either, as long as the limit holds: a grid of (a, b)."""
    forms = {"ratio": "(/ a (+ 4 b))", "product": "(* a b)", "left": "(/ (- 10 a) (+ 4 b))"}
    text = LINE.format(unknown=unknown, limit="", each=each)
    text = text.replace("(sum (+ a c))", " ".join(f"({name} {form})" for name, form in forms.items()))
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": Y, "k": np.zeros(5)}}).solves[0]
    design = np.column_stack([np.ones(5), X])
    covariance = 0.4**2 * np.linalg.inv(design.T @ design) + np.diag([0.3**2, 0.0])
    centre = np.linalg.lstsq(design, Y - 0.1)[0]
    a, b = np.meshgrid(np.linspace(0.0, 3.0, 2001), np.linspace(-0.5, 1.5, 2001), indexing="ij")
    away = np.stack([a - centre[0], b - centre[1]])
    cost = np.einsum("iab,ij,jab->ab", away, np.linalg.inv(covariance), away)
    inside = cost < cost.min() + norm.ppf(0.975) ** 2
    assert not inside[-1].any() and not inside[:, [0, -1]].any()
    values = {"ratio": a / (4.0 + b), "product": a * b, "left": (10.0 - a) / (4.0 + b)}
    for name, each_value in values.items():
        ends = each_value[inside].min(), each_value[inside].max()
        # ends are where the growth is right to 0.2 %
        assert found[name].interval() == pytest.approx(ends, abs=5e-3 * (ends[1] - ends[0]))


@pytest.mark.parametrize("each", ["", "(for-each k)"])
def test_a_constant_widens_the_intervals_of_two_estimates_at_their_limits(each: str) -> None:
    """The shortest of what is left of the profile within both limits, of the normal distribution of all three."""
    y = np.array([-0.3, 0.0, 0.2, 0.5, 0.5])
    text = LINE.format(unknown="(a :in (0 10))", limit="", each=each).replace("(b)", "(b :in (0.3 0.9))")
    found = mbm.loads(text).solve(data={"d": {"x": X, "y": y, "k": np.zeros(5)}}).solves[0]
    assert [found[name].value for name in "ab"] == [0.0, 0.3]
    design = np.column_stack([np.ones(5), X])
    covariance = 0.4**2 * np.linalg.inv(design.T @ design) + np.diag([0.3**2, 0.0])
    root = np.linalg.cholesky(np.linalg.inv(covariance)).T
    goal = root @ np.linalg.lstsq(design, y - 0.1)[0]
    for which, name, ends in ((0, "a", (0.3, 0.9)), (1, "b", (0.0, 10.0))):
        grid = np.linspace(0.0, 3.0, 3001) if name == "a" else np.linspace(0.3, 0.9, 3001)
        gap, other = goal[:, None] - root[:, [which]] * grid, root[:, [1 - which]]
        best = np.clip((other * gap).sum(axis=0) / np.square(other).sum(), *ends)
        left = np.exp(-0.5 * np.square(gap - other * best).sum(axis=0))
        inside = grid[: int(np.searchsorted(np.cumsum(left), 0.95 * left.sum())) + 1]
        assert (np.diff(left) <= 0.0).all()  # the shortest begins at the limit
        # what is left is summed up over 400 places, and over 3001
        assert found[name].interval() == pytest.approx([grid[0], inside[-1]], abs=5e-3 * np.ptp(inside))
