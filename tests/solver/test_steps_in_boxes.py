"""The compiled step inside hard bounds, with and without a limit of its length: closed forms of two unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.machine.records import slot
from mbm.solver.decisions import POSITIVE_KEPT
from mbm.solver.description import BOUNDS_AT, DOGLEG, GAUSS_NEWTON, HEADER, MARQUARDT, Problem
from tests.solver.scratch import FirstPlace, Scratch


def boxed(solver, radius, upper, rule=MARQUARDT, right=(-200.0, -50.0), scale=(2.0, 1.0)):
    """The step for residuals (x - 200, y - 50) at (0, 0), x counted twice: vector, stopped, promise, length."""
    n = 2
    system = np.zeros(HEADER + n, dtype=np.int64)
    system[Problem.n], system[slot(Problem, "positive")], system[Problem.rule] = n, HEADER, rule
    constants = np.zeros(BOUNDS_AT + 2 * n)
    constants[BOUNDS_AT : BOUNDS_AT + n], constants[BOUNDS_AT + n :] = -np.inf, upper
    work = Scratch(system)
    work.record.rows.constants = constants
    place = work.record.first
    place.scale[:n], place.projected[:n], place.free[:n] = scale, right, 1.0
    place.factor[: n * n] = np.diag(1.0 / np.array(scale)).ravel()
    vector, stopped = np.zeros(n), np.zeros(n)
    solver("boxed_step", system, FirstPlace(work), radius, work, vector, stopped)
    return vector, stopped.tolist(), work.record.step_predicted, work.record.step_length


@pytest.mark.parametrize("limit", [5.0, 10.0])
def test_what_a_bound_stops_counts_for_the_length(solver, limit):
    """x ends at 2, which is 4 in its units: √(limit² - 4²) is left for y, which Marquardt meets within 10 %."""
    vector, stopped, promise, length = boxed(solver, limit, [2.0, np.inf])
    assert vector[0] == 2.0
    assert vector[1] == pytest.approx(np.sqrt(limit**2 - 16.0), rel=0.1)
    assert stopped == [1.0, 0.0]
    assert length == pytest.approx(np.hypot(4.0, vector[1]), rel=1e-12)
    assert promise == pytest.approx(200**2 - 198**2 + 50**2 - (50 - vector[1]) ** 2, rel=1e-12)


@pytest.mark.parametrize("rule", [DOGLEG, GAUSS_NEWTON])
@pytest.mark.parametrize("limit", [5.0, 10.0])
def test_other_rules_meet_the_length_to_rounding(solver, limit, rule):
    vector, stopped, promise, length = boxed(solver, limit, [2.0, np.inf], rule)
    assert vector == pytest.approx([2.0, np.sqrt(limit**2 - 16.0)], rel=1e-12)
    assert stopped == [1.0, 0.0]
    assert length == pytest.approx(limit, rel=1e-12)
    assert promise == pytest.approx(200**2 - 198**2 + 50**2 - (50 - vector[1]) ** 2, rel=1e-12)


def test_a_bound_that_takes_the_whole_length_leaves_nothing_for_others(solver):
    """The direction is (200, 0.001), shortened to 7: that is within the bound."""
    vector, _, _, length = boxed(solver, 7.0, [7.0, np.inf], GAUSS_NEWTON, (-200.0, -1e-3), (1.0, 1.0))
    assert vector == pytest.approx([7.0, 3.5e-5], rel=1e-9)
    assert length == pytest.approx(7.0, rel=1e-12)


def test_without_a_limit_the_others_go_all_the_way(solver):
    vector, stopped, promise, _ = boxed(solver, np.inf, [2.0, np.inf])
    assert vector == pytest.approx([2.0, 50.0], rel=1e-12)
    assert stopped == [1.0, 0.0]
    assert promise == pytest.approx(200**2 - 198**2 + 50**2, rel=1e-12)


def test_inside_the_box_nothing_is_stopped(solver):
    vector, stopped, promise, _ = boxed(solver, np.inf, [300.0, 60.0])
    assert vector == pytest.approx([200.0, 50.0], rel=1e-12)
    assert stopped == [0.0, 0.0]
    assert promise == pytest.approx(200**2 + 50**2, rel=1e-12)


@pytest.mark.parametrize(
    ("x", "bound", "down"), [(2.0, 0.0, -2.0 * (1 - POSITIVE_KEPT)), (2.0, 1.9, -0.1), (0.0, 0.0, 0.0)]
)
def test_positive_coordinates_never_step_to_zero(solver, x, bound, down):
    n = 1
    system = np.zeros(HEADER + n, dtype=np.int64)
    system[Problem.n], system[slot(Problem, "positive")], system[HEADER] = n, HEADER, 1
    constants = np.zeros(BOUNDS_AT + 2 * n)
    constants[BOUNDS_AT], constants[BOUNDS_AT + n] = bound, np.inf
    assert solver("down_of", system, constants, np.array([x]), 0) == pytest.approx(down, rel=1e-15)


@pytest.mark.parametrize(("upper", "wanted"), [(np.inf, 1.0), (3.0, 1.5), (0.5, 0.25)])
@pytest.mark.parametrize("x", [0.0, -7.0])
def test_positive_coordinates_that_are_not_become_positive(solver, x, upper, wanted):
    system = np.zeros(HEADER + 1, dtype=np.int64)
    system[Problem.n], system[slot(Problem, "positive")], system[HEADER] = 1, HEADER, 1
    constants = np.zeros(BOUNDS_AT + 2)
    constants[BOUNDS_AT], constants[BOUNDS_AT + 1] = -np.inf, upper
    found = np.array([x])
    solver("project", system, constants, found)
    assert found[0] == wanted
