"""Curves whose points have errors in both coordinates are found without starts: SciPy from the truth decides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm

SIGMA = 0.02
TEXT = """(problem ellipse (data d external)
  (unknowns (c (vector 2)) (a positive) (b positive) (t angle))
  (observe d (let ((u (+ (* (cos t) (- x (c 1))) (* (sin t) (- y (c 2)))))
                   (v (- (* (cos t) (- y (c 2))) (* (sin t) (- x (c 1))))))
               (- (+ (^ (/ u a) 2) (^ (/ v b) 2)) 1))
    :errors ((x 0.02) (y 0.02))) {more})"""


def points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Forty points (40, 2) of an ellipse with half axes 3 and 1.5 about (1, 2), turned by 0.4, and where they are."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0.0, 2.0 * np.pi, 40)
    return ellipse(np.array([1.0, 2.0, 3.0, 1.5, 0.4]), around) + rng.normal(0.0, SIGMA, (40, 2)), around


def ellipse(p: np.ndarray, around: np.ndarray) -> np.ndarray:
    u, v = p[2] * np.cos(around), p[3] * np.sin(around)
    return np.c_[p[0] + np.cos(p[4]) * u - np.sin(p[4]) * v, p[1] + np.sin(p[4]) * u + np.cos(p[4]) * v]


@pytest.mark.parametrize(("seed", "more"), [(4, ""), (5, "(constraints (> a b))")])
def test_an_ellipse_by_points_with_errors_in_both_coordinates(seed: int, more: str) -> None:
    measured, around = points(seed)
    truth = np.concatenate([[1.0, 2.0, 3.0, 1.5, 0.4], around])
    joint = least_squares(lambda p: ((ellipse(p[:5], p[5:]) - measured) / SIGMA).ravel(), truth, xtol=1e-12)
    table = {"x": measured[:, 0], "y": measured[:, 1]}
    solve = mbm.loads(TEXT.format(more=more)).solve(data={"d": table}).solves[0]
    assert solve.status == "converged"
    assert solve.cost == pytest.approx(2.0 * joint.cost, rel=1e-6)
    axes = sorted([float(solve["a"].value), float(solve["b"].value)])
    np.testing.assert_allclose(axes, sorted(np.abs(joint.x[2:4])), rtol=1e-5)


def test_an_angle_that_has_gone_far_off_comes_back() -> None:
    """At 1e12 turns the rounding of the angle is 1e-3 rad, a third of its standard deviation."""
    measured, _ = points(5)
    problem, table = mbm.loads(TEXT.format(more="")), {"x": measured[:, 0], "y": measured[:, 1]}
    start = {"c": [1.0, 2.0], "a": 3.0, "b": 1.5}
    near, far = (
        problem.solve(data={"d": table}, init=start | {"t": angle}).solves[0] for angle in (0.4, 0.4 + 2e12 * np.pi)
    )
    assert far.status == "converged"
    assert far.cost == pytest.approx(near.cost, rel=1e-9)
    assert float(far["t"].value) == pytest.approx(float(near["t"].value), abs=1e-7)


def test_an_angle_that_is_fixed_stays_where_it_is() -> None:
    """It may be a number of turns, which counts: y = a t k."""
    text = """(problem turns (data d (table (k y) (1 40001) (2 80002.5) (3 119999)))
      (unknowns (t angle :init 20000 :fixed true) (a)) (observe d (= y (* a t k)) :sigma 1))"""
    k, y = np.array([1.0, 2.0, 3.0]), np.array([40001.0, 80002.5, 119999.0])
    expected = float(k @ y / (k @ k)) / 20000.0
    assert float(mbm.loads(text).solve()["a"].value) == pytest.approx(expected, rel=1e-12)
