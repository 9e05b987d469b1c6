"""Equations at many points: the numbers of `Assembled`, point by point, for any choice of columns and units."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.solution.batch import batch
from mbm.solution.solvers.batched import minimise_all

PROBLEMS = {
    "two equations in a row, one of them with a covariance, shared unknowns and a prior": """
(problem p
  (data d (table (x y u v) (0 1 0.1 2) (1 3 0.4 4) (2 4 0.7 5) (3 4 1.2 9)))
  (unknowns (a :init 0.3) (b positive :init 1 :sigma 0.5) (c :init 0.1 :in (-1 3)))
  (observe d (= y (+ a (* b x))) :sigma 0.5)
  (observe e d (= [u v] [(* b (exp (* c x))) (+ a (* x c c))]) (= v (* x c)) :sigma 0.2)
  (observe f d (= [u v] [(* a x) (* b x)]) :covariance [[0.04 0.01] [0.01 0.09]]))""",
    "families and a robust loss": """
(problem p
  (data s (table (k x y) ("a" 0 0) ("b" 3 0) ("c" 0 4)) :key k)
  (data d (table (from to r) ("a" "b" 3.1) ("b" "c" 5.2) ("c" "a" 4.5) ("a" "b" 2.9) ("b" "a" 7)))
  (unknowns (p (vector 2) :per s :init [(+ x 0.1) (- y 0.2)]))
  (observe d (= r (distance (p from) (p to))) :sigma 0.1 :loss (huber 1.5))
  (observe g s (= [x y] (p k)) :sigma 1))""",
    "poses, directions and angles": """
(problem p
  (data d (table (x y z u v w) (1 0 0 0.1 1 0.2) (0 1 0 -1 0.2 0.1) (0 0 1 0.3 0.1 1) (1 1 0 -1 1.3 0.2)))
  (unknowns (T (pose 3) :init (pose3 (euler 0.1 0.2 1.5) [0 0 0])) (n direction :init [0 0.1 1]) (h angle :init 0.2))
  (observe d (= [u v w] (transform T [x y z])) :sigma 0.1)
  (observe e d (= h (- (dot n [u v w]) z)) :sigma 0.2))""",
}


@pytest.fixture(params=PROBLEMS)
def equations(request):
    return mbm.loads(PROBLEMS[request.param]).compile()._assembled()[0]


def points_about(equations, count, seed=0):
    random = np.random.default_rng(seed)
    steps = 0.05 * random.normal(size=(count, equations.dimension))
    return np.array([equations.retract(equations.numbers, step) for step in steps])


def test_residuals_and_jacobians_are_those_of_each_point(equations):
    points = points_about(equations, 5)
    stack = batch(equations)
    residuals, jacobian = stack.linearised(points, np.arange(5))
    assert residuals.shape == (5, stack.count) == (5, equations.count)
    for t, point in enumerate(points):
        # The same operations, at most in another order: CasADi's virtual machine against NumPy.
        np.testing.assert_allclose(residuals[t], equations.residuals(point), rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(jacobian[t], equations.jacobian(point), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(stack.residuals(points), residuals)
    np.testing.assert_array_equal(stack.coordinates(points), [equations.coordinates(p) for p in points])


def test_steps_and_bounds(equations):
    points = points_about(equations, 4)
    steps = 0.3 * np.random.default_rng(1).normal(size=(4, equations.dimension))
    moved = batch(equations).moved(points, steps)
    for point, step, after in zip(points, steps, moved, strict=True):
        expected = equations.retract(point, step)
        inside = equations.placed(expected, np.clip(equations.coordinates(expected), equations.lower, equations.upper))
        np.testing.assert_allclose(after, inside, rtol=1e-14, atol=1e-15)


def test_some_columns_and_some_units(equations):
    columns = equations.free[::2]
    wanted = np.unique(equations.units)[1::2]
    points = points_about(equations, 3)
    residuals, jacobian = batch(equations, columns=columns, units=wanted).linearised(points, np.arange(3))
    lines = np.flatnonzero(np.isin(equations.units, wanted))
    for t, point in enumerate(points):
        np.testing.assert_allclose(residuals[t], equations.residuals(point)[lines], rtol=1e-12, atol=1e-13)
        expected = equations.jacobian(point)[np.ix_(lines, range(0, equations.dimension, 2))]
        np.testing.assert_allclose(jacobian[t], expected, rtol=1e-12, atol=1e-12)


def test_units_of_each_trial(equations):
    """Trial by trial, and in the order in which the units are named; shorter trials end in zeros."""
    random = np.random.default_rng(2)
    every = np.unique(equations.units)
    units = np.array([random.permutation(every)[:3] for _ in range(6)])
    points = points_about(equations, 6)
    stack = batch(equations, units=units)
    picked = np.array([4, 1, 5])
    residuals, jacobian = stack.linearised(points[picked], picked)
    for t, trial in enumerate(picked):
        lines = np.concatenate([np.flatnonzero(equations.units == u) for u in units[trial]])
        np.testing.assert_allclose(
            residuals[t, : len(lines)], equations.residuals(points[trial])[lines], rtol=1e-12, atol=1e-13
        )
        np.testing.assert_allclose(
            jacobian[t, : len(lines)], equations.jacobian(points[trial])[lines], rtol=1e-12, atol=1e-12
        )
        assert not residuals[t, len(lines) :].any()
        assert not jacobian[t, len(lines) :].any()


def test_noise_factors_count(equations):
    factors = np.random.default_rng(3).uniform(0.5, 2.0, equations.count)
    weighted = equations.with_factors(factors)
    if weighted.lossy:
        factors = np.repeat(1.7, equations.count)
        weighted = equations.with_factors(factors)
    points = points_about(equations, 2)
    for point, found in zip(points, batch(weighted).residuals(points), strict=True):
        np.testing.assert_allclose(found, weighted.residuals(point), rtol=1e-12, atol=1e-13)


def test_all_points_find_the_minimum(equations):
    found = minimise_all(batch(equations), points_about(equations, 8), iterations=100)
    best = found.cost.min()
    # Settled: the promise is 1e-14 of the cost.
    np.testing.assert_allclose(found.cost, best, rtol=1e-9)
    gradient = equations.jacobian(found.points[0]).T @ equations.residuals(found.points[0])
    free = (equations.coordinates(found.points[0]) > equations.lower) & (
        equations.coordinates(found.points[0]) < equations.upper
    )
    assert np.abs(gradient[free]).max() < 1e-4 * best
