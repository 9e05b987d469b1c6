"""The compiled step inside hard bounds, with and without a limit of its length: closed forms of two unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.target.records import slot, view
from mbm.target.solver.description import BOUNDS_AT, HEADER, Problem
from mbm.target.solver.workspace import (
    FREE,
    IMAGE,
    METRIC,
    SCALARS,
    STEP_LENGTH,
    STEP_PREDICTED,
    X,
    factor_at,
    vector_at,
    work_integers,
    work_reals,
)


def boxed(solver, radius, limited, upper):
    """The step for residuals (x - 200, y - 50) at (0, 0), x counted twice: vector, stopped, promise, length."""
    n = 2
    numbers = np.zeros(HEADER + n, dtype=np.int64)
    numbers[Problem.n], numbers[slot(Problem, "positive")] = n, HEADER
    system = view(Problem, numbers)
    constants = np.zeros(BOUNDS_AT + 2 * n)
    constants[BOUNDS_AT : BOUNDS_AT + n], constants[BOUNDS_AT + n :] = -np.inf, upper
    scale = np.array([2.0, 1.0])
    place = np.zeros(int(factor_at(system)) + n * n + 64)
    for vector, values in ((X, [0, 0]), (METRIC, scale), (IMAGE, [-200.0, -50.0]), (FREE, [1, 1])):
        place[vector_at(system, vector) :][:n] = values
    place[factor_at(system) :][: n * n] = np.diag(1.0 / scale).ravel()
    work, flags = np.zeros(int(work_reals(system))), np.zeros(int(work_integers(system)), dtype=np.int64)
    vector, stopped, scalars = np.zeros(n), np.zeros(n), np.zeros(SCALARS)
    solver("boxed_step", numbers, constants, place, radius, limited, work, flags, vector, stopped, scalars)
    return vector, stopped.tolist(), scalars[STEP_PREDICTED], scalars[STEP_LENGTH]


@pytest.mark.parametrize("limit", [5.0, 10.0])
def test_what_a_bound_stops_counts_for_the_length(solver, limit):
    """x ends at 2, which is 4 in its units: √(limit² - 4²) is left for y, which Marquardt meets within 10 %."""
    vector, stopped, promise, length = boxed(solver, limit, 1, [2.0, np.inf])
    assert vector[0] == 2.0
    assert vector[1] == pytest.approx(np.sqrt(limit**2 - 16.0), rel=0.1)
    assert stopped == [1.0, 0.0]
    assert length == pytest.approx(np.hypot(4.0, vector[1]), rel=1e-12)
    assert promise == pytest.approx(200**2 - 198**2 + 50**2 - (50 - vector[1]) ** 2, rel=1e-12)


def test_without_a_limit_the_others_go_all_the_way(solver):
    vector, stopped, promise, _ = boxed(solver, np.inf, 0, [2.0, np.inf])
    assert vector == pytest.approx([2.0, 50.0], rel=1e-12)
    assert stopped == [1.0, 0.0]
    assert promise == pytest.approx(200**2 - 198**2 + 50**2, rel=1e-12)


def test_inside_the_box_nothing_is_stopped(solver):
    vector, stopped, promise, _ = boxed(solver, np.inf, 0, [300.0, 60.0])
    assert vector == pytest.approx([200.0, 50.0], rel=1e-12)
    assert stopped == [0.0, 0.0]
    assert promise == pytest.approx(200**2 + 50**2, rel=1e-12)
