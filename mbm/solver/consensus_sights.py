"""Lines of sight behind a lens that distorts: found from near ones, by Newton's method on the equations themselves.

A camera stands still, and a point is put before it so that the equation of its image holds: its direction is the line
of sight. Slopes are difference quotients, which leaves the root as it is and the last steps as short as rounding.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Reals, call_kernel
from mbm.solver.consensus_forms import put_motion
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied

STEPS = 30
"""Steps of Newton's method; from near ones it takes five."""

QUOTIENT_STEP = 1e-6
"""By which a slope is taken, beside a direction whose largest component is 1. Rounding and curvature make a millionth
of the slope wrong, so that each step leaves as much of the error before."""

LAST_STEP = 1e-12
"""Change of the direction from which nothing but rounding is left to gain."""


def image_misfit(problem: Problem, u: Integer, sight: ConstantReals, work: ConsensusWork, target: Reals) -> None:
    """What the equation of unit ``u`` leaves (2,) if its point stands at ``sight`` (3,) before the camera."""
    units = work.units
    rows = work.rows
    about = work.rules.about
    block = problem.blocks[units.block[u]]
    part = rows.data.blocks[units.block[u]]
    row = units.row[u]
    point = work.kept
    pose = work.form_scratch[24:]
    known = work.forms[u * work.rules.form_width :]
    for i in range(9):
        pose[i] = 0.0
    for i in range(3):
        pose[4 * i] = 1.0
        pose[9 + i] = sight[i] - known[i]
    put_motion(about[0], about[1], pose, about[2:], work.form_scratch[36:], point)
    inputs = work.subset_rows.inputs
    outputs = work.subset_rows.outputs
    index = rows.index[part.index + row * block.index :]
    given = rows.parameters[part.parameters + row * block.parameters :]
    for lane in range(LANES):
        for v in range(block.variables):
            inputs[v * LANES + lane] = point[index[v]]
        for p in range(block.parameters):
            inputs[(block.variables + p) * LANES + lane] = given[p]
    call_kernel(block.values, inputs, outputs, 1)
    first = block.units[units.equation[u]].first
    for i in range(2):
        target[i] = outputs[(first + i) * LANES]


def found_sight(problem: Problem, u: Integer, work: ConsensusWork, sight: Reals) -> Integer:
    """The line of sight (3,) of unit ``u`` from one near by, by length as that; 0 where it is not found."""
    misfit = work.form_scratch[4:]
    beside = work.form_scratch[6:]
    slopes = work.form_scratch[8:]
    step = work.form_scratch[12:]
    axis = 0
    for i in range(1, 3):
        if fabs(sight[i]) > fabs(sight[axis]):
            axis = i
    far = fabs(sight[axis])
    for i in range(3):
        sight[i] = sight[i] / far
    for _ in range(STEPS):
        image_misfit(problem, u, sight, work, misfit)
        for k in range(2):
            i = (axis + 1 + k) % 3
            held = sight[i]
            sight[i] = held + QUOTIENT_STEP
            image_misfit(problem, u, sight, work, beside)
            sight[i] = held
            for j in range(2):
                slopes[2 * j + k] = (beside[j] - misfit[j]) / QUOTIENT_STEP
        determinant = slopes[0] * slopes[3] - slopes[1] * slopes[2]
        step[0] = (slopes[1] * misfit[1] - slopes[3] * misfit[0]) / determinant
        step[1] = (slopes[2] * misfit[0] - slopes[0] * misfit[1]) / determinant
        if not isfinite(step[0]) or not isfinite(step[1]):
            return 0
        for k in range(2):
            sight[(axis + 1 + k) % 3] += step[k]
        if max(fabs(step[0]), fabs(step[1])) <= LAST_STEP:
            far = sqrt(sight[0] * sight[0] + sight[1] * sight[1] + sight[2] * sight[2])
            for i in range(3):
                sight[i] = sight[i] / far
            return 1
    return 0


def find_sights(problem: Problem, work: ConsensusWork) -> None:
    """What the form knows of the units, with their own lines of sight; NaN where these are not found."""
    width = work.rules.form_width
    copied(problem.numbers, work.starts, work.kept)
    for u in range(work.units.count):
        own = work.sights[u * width :]
        copied(width, work.forms[u * width :], own)
        if isfinite(own[3]) and found_sight(problem, u, work, own[3:]) == 0:
            own[3] = inf - inf
    work.forms = work.sights
