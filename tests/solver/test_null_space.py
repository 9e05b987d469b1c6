"""Reflections that turn constraints away, against NumPy's orthogonal bases."""

import numpy as np

from tests.solver.test_linear_algebra import matrix

CLOSE = 1e-13
"""A few roundings for each of up to five reflections of numbers of size 1."""


def turned(solver, slopes, held, scale):
    """Q (n, n) and how many constraints it turns away."""
    n = len(scale)
    reflections = np.zeros((n, n))
    chosen = np.arange(n)
    count = solver("reflect_constraints", n, n, chosen, scale, len(held), held, slopes, reflections)
    basis = np.eye(n)
    for row in basis:  # rows become Qᵀ e
        solver("to_null_space", n, count, reflections, row)
    return basis, count, reflections


def test_the_surface_is_perpendicular_to_all_constraints_that_hold(solver):
    slopes, scale = matrix(3, 5), np.array([1.0, 2.0, 0.5, 3.0, 1.0])
    held = np.array([1.0, 0.0, 4.0])
    basis, count, reflections = turned(solver, slopes, held, scale)
    assert count == 2
    np.testing.assert_allclose(basis @ basis.T, np.eye(5), rtol=0, atol=CLOSE)
    along = basis[:, count:]
    np.testing.assert_allclose(slopes[[0, 2]] / scale @ along, np.zeros((2, 3)), rtol=0, atol=CLOSE * 20)
    back = basis.copy()
    for row in back:
        solver("from_null_space", 5, count, reflections, row)
    np.testing.assert_allclose(back, np.eye(5), rtol=0, atol=CLOSE)


def test_constraints_that_repeat_one_another_count_once(solver):
    slopes = matrix(3, 4)
    slopes[1] = -2.0 * slopes[0]
    slopes[2] = 0.0
    basis, count, _ = turned(solver, slopes, np.ones(3), np.ones(4))
    assert count == 1
    np.testing.assert_allclose(basis[:, 1:].T @ slopes[0], np.zeros(3), rtol=0, atol=CLOSE * 20)
