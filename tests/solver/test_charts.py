"""Steps between points, and vectors moved from one tangent space to another: undone by `retract`; by differences."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.solver import description as of
from tests.solver.test_manifolds import after, described

PIECES = {
    "rotation": (of.QUATERNION, 4, 3, np.array([0.5, -0.5, 0.7, 0.1]), np.array([0.6, -0.64, 0.48])),
    "direction": (of.DIRECTION, 3, 2, np.array([0.6, -0.48, -0.64]), np.array([0.8, -0.6])),
    "scale": (of.SCALE, 1, 1, np.array([2.5]), np.array([-1.0])),
}


def piece_of(kind, size):
    label, numbers, tangent, point, step = PIECES[kind]
    if numbers > 1:
        point = point / np.linalg.norm(point)
    return described(label, numbers, tangent), point, size * step


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 0.3, 2.0])
@pytest.mark.parametrize("kind", PIECES)
def test_the_step_between_two_points_leads_from_one_to_the_other(solver, kind, size):
    system, point, step = piece_of(kind, size)
    found = np.zeros(len(step))
    solver("step_between", system, point, after(solver, system, point, step), np.zeros(6), found)
    # the arc of a chord that is known to one rounding
    np.testing.assert_allclose(found, step, rtol=0, atol=1e-15 + 2e-15 * size)


@pytest.mark.parametrize("size", [1e-5, 9e-4, 2e-3, 0.3, 2.0])
@pytest.mark.parametrize("kind", PIECES)
def test_vectors_move_as_differences_of_steps_do(solver, kind, size):
    system, point, step = piece_of(kind, size)
    there = after(solver, system, point, step)
    width, h = len(step), 1e-5
    lines = np.eye(width)
    solver("transport", system, point, step, width, np.zeros(18), lines)
    for k, direction in enumerate(np.eye(width)):
        ends = [np.zeros(width), np.zeros(width)]
        for end, sign in zip(ends, (1, -1), strict=True):
            solver(
                "step_between",
                system,
                there,
                after(solver, system, point, step + sign * h * direction),
                np.zeros(6),
                end,
            )
        # central differences: 1e-10 of curvature, 1e-11 of rounding
        np.testing.assert_allclose(lines[k], (ends[0] - ends[1]) / (2 * h), rtol=0, atol=2e-10)
