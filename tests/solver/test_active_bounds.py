"""Coordinates at a bound are held where the residuals push, by the slope of the cost alone."""

import numpy as np

from mbm.solver.description import BOUNDS_AT, HEADER, Problem
from tests.solver.scratch import FirstPlace, Scratch
from tests.solver.test_linear_algebra import matrix


def triangle_of(jacobian, residuals):
    """The triangle (n + 1, n + 1) of ``[J r]``, by NumPy."""
    return np.linalg.qr(np.column_stack([jacobian, residuals]), mode="r")


def test_only_what_residuals_push_is_held(solver):
    jacobian, residuals = matrix(9, 3), matrix(9, 1).ravel()
    # the part of the residuals along the second column is taken away: nothing pushes along that coordinate
    second = jacobian[:, 1]
    residuals = residuals - second * (second @ residuals) / (second @ second)
    sides = np.array([1, -1, 0])
    solver(
        "release_inactive",
        3,
        triangle_of(jacobian, residuals),
        np.ones(3),
        float(residuals @ residuals),
        np.zeros(3),
        sides,
    )
    assert sides.tolist() == [1, 0, 0]


def test_roundings_of_vanishing_residuals_do_not_push(solver):
    jacobian, x = matrix(3, 3), np.array([1e3, 1.0, 1.0])
    # roundings of numbers of the size 1e3, with any direction
    residuals = 1e-13 * matrix(3, 1).ravel()
    sides = np.array([1, -1, 1])
    solver("release_inactive", 3, triangle_of(jacobian, residuals), x, float(residuals @ residuals), np.zeros(3), sides)
    assert sides.tolist() == [0, 0, 0]


def test_coordinates_on_a_bound_that_pushes_them_are_held(solver):
    """By the number of each coordinate: bounds and pushes differ from one to the next."""
    n = 4
    system = np.zeros(HEADER + 2 * n, dtype=np.int64)
    system[Problem.n] = n
    work = Scratch(system)
    constants = np.zeros(BOUNDS_AT + 2 * n)
    constants[BOUNDS_AT : BOUNDS_AT + n], constants[BOUNDS_AT + n :] = [-1.0, -2.0, -3.0, -4.0], [1.0, 2.0, 3.0, 4.0]
    work.record.rows.constants = constants
    place = FirstPlace(work)
    for x, pushes, free in (
        ([-1.0, -2.0, 3.0, 4.0], [-1.0, -1.0, 1.0, 1.0], [0, 0, 0, 0]),
        ([-1.0, -2.0, 3.0, 4.0], [1.0, 1.0, -1.0, 0.0], [1, 1, 1, 1]),
        ([-0.9, -1.9, 2.9, 3.9], [-1.0, -1.0, 1.0, 1.0], [1, 1, 1, 1]),
        ([1.0, 2.0, -3.0, -4.0], [1.0, 1.0, 0.0, -1.0], [0, 0, 1, 0]),
    ):
        place.record.x[:n], work.record.pushes[:n] = x, pushes
        solver("set_held_by_bounds", system, place, work)
        assert place.record.free[:n].tolist() == free
