"""One iteration of Marquardt's method, as `solution.solvers.trust_region` has it: the same tests and constants.

Moré (1978) for the radius and its update; Newton's steps at the end where Gauss-Newton's are slow; last steps judged by
the relative offset.
"""

from __future__ import annotations

from math import isfinite

from mbm.target.decisions import (
    CREEP,
    LEAST_GAIN_RATIO,
    NEAR_OFFSET,
    NEVER,
    OFFSET_DECREASE,
    PATIENCE,
    REACH,
    SLOW_OFFSET,
    TRIAL_POINTS,
    UNDECIDED,
)
from mbm.target.solver.description import (
    COORDINATES,
    FLAT,
    LANES,
    NO_FINITE_STEP,
    NUMBERS,
    ROUNDING,
    RUNNING,
    STRICT,
    UNSURE,
)
from mbm.target.solver.linear_algebra import (
    copied,
)
from mbm.target.solver.newton import set_curvature
from mbm.target.solver.places import arrive, judge
from mbm.target.solver.sweeps import set_triangle, sweep
from mbm.target.solver.trials import same_point, shortening, step_within, try_step
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_OFFSET,
    AT_POINT,
    AT_PREDICTED,
    AT_SLACK,
    COST_TRIED,
    CURVATURE_KNOWN,
    DEFICIENT_OF,
    ENDING_OF,
    FINITE,
    HERE,
    ITERATIONS_DONE,
    PATIENCE_LEFT,
    PENALISED,
    POINT_TRIED,
    RADIUS,
    RESIDUALS_HERE,
    RESIDUALS_TRIED,
    SLOT,
    STEP_LENGTH,
    STEP_PREDICTED,
    STOP,
    TOLERANCE_NOW,
    WHOLE,
    place_at,
    scalars_at,
    step_at,
    trial_at,
    triangle_at,
)
from mbm.target.step_control import radius_after, remaining
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def factor_there(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> Integer:
    """The trial point as the other place, with its triangle; 0 where that is not finite."""
    n = system[COORDINATES]
    there = work[place_at(system, 1 - flags[HERE]) :]
    scalars = work[scalars_at(system) :]
    copied(system[NUMBERS], work[trial_at(system, flags[POINT_TRIED]) :], there[AT_POINT:])
    there[AT_COST] = scalars[COST_TRIED]
    triangle = there[triangle_at(system) :]
    if LANES > 1:
        set_triangle(system, constants, data, index, columns, 1 - flags[HERE], work, flags)
    else:
        sweep(system, constants, data, index, columns, there[AT_POINT:], 0, flags[PENALISED], work, scalars, triangle)
    total = 0.0
    for i in range((n + 1) * (n + 1)):
        total += triangle[i]
    return 1 if isfinite(total) else 0


def arrive_there(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    share: Real,
    work: Reals,
    flags: Integers,
) -> None:
    """Go to the accepted point; the second-order term is taken where convergence is slow enough to pay for it.

    ``share`` of the promise that the step brought, negative where it was judged by the offset.
    """
    scalars = work[scalars_at(system) :]
    before = flags[HERE]
    number = 1 - before
    arrive(system, constants, number, before, flags[CURVATURE_KNOWN], work, flags)
    here = work[place_at(system, before) :]
    there = work[place_at(system, number) :]
    if share < 0.0 and not there[AT_OFFSET] <= OFFSET_DECREASE * here[AT_OFFSET]:
        no_better(system, constants, work, flags)
        return
    if share >= 0.0:
        scalars[RADIUS] = radius_after(share, scalars[RADIUS], scalars[STEP_LENGTH], flags[WHOLE])
    flags[HERE] = number
    flags[RESIDUALS_HERE] = flags[RESIDUALS_TRIED]
    flags[STOP] = flags[SLOT * number + ENDING_OF]
    if flags[PATIENCE_LEFT] > 0:
        flags[PATIENCE_LEFT] -= 1
    if system[STRICT] == 1 and flags[SLOT * number + DEFICIENT_OF] > 0:
        flags[STOP] = UNSURE
    if flags[STOP] != RUNNING or there[AT_OFFSET] <= SLOW_OFFSET * here[AT_OFFSET] or flags[PATIENCE_LEFT] > 0:
        return
    if there[AT_OFFSET] < NEAR_OFFSET:
        few = float(system[COORDINATES] + 2)
        if remaining(there[AT_OFFSET], here[AT_OFFSET], scalars[TOLERANCE_NOW]) <= few:
            return
    elif here[AT_COST] - there[AT_COST] > CREEP * here[AT_COST]:
        return
    take_curvature(system, constants, data, index, columns, work, flags)
    longest = REACH * scalars[RADIUS]
    if there[AT_LENGTH] < longest:
        longest = there[AT_LENGTH]
    if longest > scalars[RADIUS]:
        scalars[RADIUS] = longest


def take_curvature(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """The second-order term at the place of the iteration, and the place judged anew with it."""
    number = flags[HERE]
    flags[CURVATURE_KNOWN] = set_curvature(system, constants, data, index, columns, work, flags)
    judge(system, constants, number, flags[CURVATURE_KNOWN], work, flags)
    place = work[place_at(system, number) :]
    flags[PATIENCE_LEFT] = PATIENCE if place[AT_OFFSET] >= NEAR_OFFSET else 0
    flags[STOP] = flags[SLOT * number + ENDING_OF]


def no_better(system: ConstantIntegers, constants: ConstantReals, work: Reals, flags: Integers) -> None:
    """No better point: the end, unless the second-order term was too inexact for the last digits."""
    if flags[CURVATURE_KNOWN] == 0:
        flags[STOP] = ROUNDING
        return
    number = flags[HERE]
    place = work[place_at(system, number) :]
    scalars = work[scalars_at(system) :]
    flags[CURVATURE_KNOWN] = 0
    judge(system, constants, number, 0, work, flags)
    if place[AT_LENGTH] > scalars[RADIUS]:
        scalars[RADIUS] = place[AT_LENGTH]
    flags[PATIENCE_LEFT] = NEVER
    flags[STOP] = flags[SLOT * number + ENDING_OF]


def stuck(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """No trial was accepted: the end, unless Newton's step shows a way that Gauss-Newton's did not."""
    place = work[place_at(system, flags[HERE]) :]
    scalars = work[scalars_at(system) :]
    if place[AT_PREDICTED] <= UNDECIDED * place[AT_SLACK]:
        no_better(system, constants, work, flags)
    elif flags[FINITE] == 0:
        flags[STOP] = NO_FINITE_STEP
    elif flags[PATIENCE_LEFT] > 0:
        flags[STOP] = FLAT
    else:
        take_curvature(system, constants, data, index, columns, work, flags)
        flags[PATIENCE_LEFT] = PATIENCE
        if place[AT_LENGTH] > scalars[RADIUS]:
            scalars[RADIUS] = place[AT_LENGTH]


def iterate(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """Trial steps until one is accepted, or none can be; the cost never grows by more than its rounding."""
    here = work[place_at(system, flags[HERE]) :]
    scalars = work[scalars_at(system) :]
    start = scalars[RADIUS]
    radius = start
    flags[FINITE] = 1
    flags[ITERATIONS_DONE] += 1
    for _ in range(TRIAL_POINTS):
        step_within(system, constants, radius, work, flags)
        try_step(system, constants, data, index, columns, work, flags)
        if same_point(system, work[trial_at(system, flags[POINT_TRIED]) :], here[AT_POINT:]) == 1:
            break
        shorter = scalars[STEP_LENGTH] if scalars[STEP_LENGTH] < radius else radius
        flags[FINITE] = 1 if isfinite(scalars[COST_TRIED]) else 0
        if flags[FINITE] == 0:
            radius = 0.25 * shorter
            continue
        actual = here[AT_COST] - scalars[COST_TRIED]
        share = -1.0
        acceptable = 0
        decided = scalars[STEP_PREDICTED] > UNDECIDED * here[AT_SLACK]
        if decided:
            share = actual / scalars[STEP_PREDICTED]
            if share > LEAST_GAIN_RATIO:
                acceptable = 1
        elif flags[WHOLE] == 1 and actual >= -here[AT_SLACK]:
            acceptable = 1
        if acceptable == 1:
            if factor_there(system, constants, data, index, columns, work, flags) == 0:
                flags[FINITE] = 0
                radius = 0.25 * shorter
                continue
            scalars[RADIUS] = radius
            arrive_there(system, constants, data, index, columns, share, work, flags)
            return
        if not decided:
            break
        radius = shortening(system, here, work[step_at(system, 0) :], actual, work) * shorter
    scalars[RADIUS] = radius
    stuck(system, constants, data, index, columns, work, flags)
