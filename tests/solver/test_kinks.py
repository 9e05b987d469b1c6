"""Minima at kinks, where the gradient of neither side vanishes, beside brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import mbm

X = np.linspace(0.0, 10.0, 40)
BROKEN = """
(problem p (data d external) (unknowns (a) (b) (c :init 5))
  (observe d (= y (+ a (* b (max 0 (- x c))))) :sigma 0.3) {more})
"""


def readings(runs: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return 1 + 0.8 * np.maximum(0, X - 4.3) + 0.3 * rng.normal(size=(runs, X.size))


def cost(y: np.ndarray, c: float) -> float:
    """The least sum of squares of a broken line that bends at ``c``."""
    a = np.column_stack([np.ones(X.size), np.maximum(0, X - c)])
    r = y - a @ np.linalg.lstsq(a, y, rcond=None)[0]
    return float(r @ r) / 0.09


def test_a_broken_line_may_bend_at_a_reading() -> None:
    """Some of these sets have their minimum at a reading's place, where the cost has a corner."""
    data = readings(60)
    many = mbm.loads(BROKEN.format(more="(for-each run)")).solve(
        data={"d": {"run": np.repeat(np.arange(60), X.size), "x": np.tile(X, 60), "y": data.ravel()}}
    )
    bent = [k for k, solve in enumerate(many.solves) if "kink" in solve.message]
    assert bent and all(solve.status == "converged" for solve in many.solves)
    compiled = mbm.loads(BROKEN.format(more="")).compile()
    for k in bent:
        alone = compiled.solve(data={"d": {"x": X, "y": data[k]}})
        c = float(alone["c"].value)
        assert float(many.solves[k]["c"].value) == pytest.approx(c, abs=1e-6)
        nearest = X[np.abs(X - c).argmin()]
        # a kink is met to 1e-4 standard deviations, of which one is 0.2
        assert c == pytest.approx(nearest, abs=2e-5)
        around = [cost(data[k], nearest + shift) for shift in np.linspace(-0.1, 0.1, 201)]
        assert alone.cost == pytest.approx(min(around), rel=1e-6) == pytest.approx(cost(data[k], nearest), rel=1e-6)


@pytest.mark.parametrize(
    ("form", "answer"),
    [("(abs (- (* 3 u) 1))", 1 / 3), ("(max (exp u) (- 3 u))", brentq(lambda u: np.exp(u) + u - 3, 0, 2))],
)
def test_one_unknown(form: str, answer: float) -> None:
    """The least size, and the least of the larger of two; one standard deviation is at most 1."""
    clauses = f"(observe one (= -1 {form}) :sigma 1) (observe two (= -2 {form}) :sigma 1)"
    result = mbm.loads(f"(problem p (unknowns (u :init 5)) {clauses})").solve()
    assert float(result["u"].value) == pytest.approx(answer, abs=1e-4)
    assert result.status == "ok" and "kink" in result.message


def test_where_nothing_bends_the_end_of_the_road_is_no_minimum() -> None:
    """The gradient of a root is infinite at its end, and the same on no other side."""
    result = mbm.loads("(problem p (unknowns (u :init 5)) (observe (= 0 (+ 1 (sqrt u))) :sigma 1))").solve()
    assert result.status != "ok"
