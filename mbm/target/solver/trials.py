"""Trial steps: where a step inside the radius leads, and what the equations say there.

As `solution.solvers.trust_region`; a second try answers the curvature met along the step (Transtrum and Sethna 2012).
"""

from __future__ import annotations

from math import isfinite

from mbm.target.decisions import BEND, CURVED_SHARE, UNDECIDED
from mbm.target.solver.description import (
    BOXED,
    COORDINATES,
    NUMBERS,
)
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.linear_algebra import (
    copied,
    damped_triangle,
    dot,
    filled,
    solve_transposed,
    solve_upper,
    times_transposed,
    times_upper,
)
from mbm.target.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.target.solver.steps import boxed_step, judge_step, land, marquardt_step
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_POINT,
    AT_PREDICTED,
    AT_SLACK,
    COST_TRIED,
    EVALUATIONS_DONE,
    FULL,
    HERE,
    IMAGE,
    METRIC,
    PENALISED,
    POINT_TRIED,
    RESIDUALS_HERE,
    RESIDUALS_TRIED,
    STEP_LENGTH,
    STEP_PREDICTED,
    STOPPED,
    WHOLE,
    factor_at,
    matrix_at,
    place_at,
    residuals_at,
    scalars_at,
    step_at,
    trial_at,
    vector_at,
)
from mbm.target.step_control import shortened
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def step_within(system: ConstantIntegers, constants: ConstantReals, radius: Real, work: Reals, flags: Integers) -> None:
    """The step inside the radius: scratch vector 0, what bounds stopped in vector 1, promise and length."""
    n = system[COORDINATES]
    place = work[place_at(system, flags[HERE]) :]
    vector = work[step_at(system, 0) :]
    stopped = work[step_at(system, 1) :]
    scalars = work[scalars_at(system) :]
    flags[WHOLE] = 0
    if place[AT_LENGTH] <= 1.1 * radius:
        flags[WHOLE] = 1
        copied(n, place[vector_at(system, FULL) :], vector)
        copied(n, place[vector_at(system, STOPPED) :], stopped)
        scalars[STEP_PREDICTED] = place[AT_PREDICTED]
        scalars[STEP_LENGTH] = place[AT_LENGTH]
        return
    if system[BOXED] == 1:
        boxed_step(system, constants, place, radius, 1, work, flags, vector, stopped, scalars)
        return
    filled(n, 0.0, stopped)
    triangle = work[matrix_at(system, 0) :]
    right = work[step_at(system, 6) :]
    row = work[step_at(system, 5) :]
    factor = place[factor_at(system) :]
    marquardt_step(n, factor, place[vector_at(system, IMAGE) :], radius, vector, triangle, right, row)
    scale = place[vector_at(system, METRIC) :]
    for j in range(n):
        vector[j] /= scale[j]
    judge_step(system, place, vector, work, scalars)


def bend_step(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> Integer:
    """The step with the curvature answered that showed at its end, scratch vector 3; 0 where the answer is too long.

    Half the geodesic acceleration of Transtrum and Sethna (2012), from the trial point instead of an extra one.
    """
    n = system[COORDINATES]
    place = work[place_at(system, flags[HERE]) :]
    factor = place[factor_at(system) :]
    image = place[vector_at(system, IMAGE) :]
    scale = place[vector_at(system, METRIC) :]
    vector = work[step_at(system, 0) :]
    scaled = work[step_at(system, 2) :]
    bent = work[step_at(system, 3) :]
    gradient = work[step_at(system, 4) :]
    moved = work[step_at(system, 9) :]
    back = work[step_at(system, 10) :]
    residuals = work[residuals_at(system, flags[RESIDUALS_TRIED]) :]
    sweep(system, constants, data, index, columns, place[AT_POINT:], 1, flags[PENALISED], work, residuals, gradient)
    for j in range(n):
        scaled[j] = scale[j] * vector[j]
    times_upper(n, factor, scaled, moved)
    size = dot(n, scaled, scaled)
    damping = 0.0
    if size > 0.0:
        damping = -(dot(n, moved, moved) + dot(n, moved, image)) / size
        if not damping > 0.0:
            damping = 0.0
    for j in range(n):
        moved[j] += image[j]
    times_transposed(n, factor, moved, back)
    for j in range(n):
        bent[j] = gradient[j] / scale[j] - back[j]
    triangle = work[matrix_at(system, 0) :]
    damped_triangle(n, factor, image, damping, triangle, work[step_at(system, 6) :], work[step_at(system, 5) :])
    solve_transposed(n, triangle, bent)
    solve_upper(n, triangle, bent)
    scalars = work[scalars_at(system) :]
    most = BEND * scalars[STEP_LENGTH]
    if not dot(n, bent, bent) <= most * most:
        return 0
    for j in range(n):
        bent[j] = (scaled[j] - bent[j]) / scale[j]
    return 1


def try_step(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """Evaluate the step, and once more with the curvature answered where it brought too little."""
    place = work[place_at(system, flags[HERE]) :]
    vector = work[step_at(system, 0) :]
    scalars = work[scalars_at(system) :]
    point = work[trial_at(system, 0) :]
    retract(system, place[AT_POINT:], vector, point)
    if system[BOXED] == 1:
        x = work[step_at(system, 11) :]
        coordinates_of(system, point, x)
        land(system, constants, vector, work[step_at(system, 1) :], x)
        place_coordinates(system, x, point)
    flags[POINT_TRIED] = 0
    flags[RESIDUALS_TRIED] = (flags[RESIDUALS_HERE] + 1) % 3
    residuals = work[residuals_at(system, flags[RESIDUALS_TRIED]) :]
    count = residuals_at_point(system, constants, data, index, point, 1, flags[PENALISED], work, residuals)
    flags[EVALUATIONS_DONE] += 1
    cost = dot(count, residuals, residuals)
    scalars[COST_TRIED] = cost
    if not isfinite(cost) or system[BOXED] == 1 or not scalars[STEP_PREDICTED] > UNDECIDED * place[AT_SLACK]:
        return
    if place[AT_COST] - cost >= CURVED_SHARE * scalars[STEP_PREDICTED]:
        return
    if bend_step(system, constants, data, index, columns, work, flags) == 0:
        return
    curved = work[trial_at(system, 1) :]
    retract(system, place[AT_POINT:], work[step_at(system, 3) :], curved)
    there = work[residuals_at(system, (flags[RESIDUALS_HERE] + 2) % 3) :]
    count = residuals_at_point(system, constants, data, index, curved, 1, flags[PENALISED], work, there)
    flags[EVALUATIONS_DONE] += 1
    lower = dot(count, there, there)
    if lower < cost:
        scalars[COST_TRIED] = lower
        flags[POINT_TRIED] = 1
        flags[RESIDUALS_TRIED] = (flags[RESIDUALS_HERE] + 2) % 3


def same_point(system: ConstantIntegers, a: ConstantReals, b: ConstantReals) -> Integer:
    """1 where two points are equal to the last bit."""
    for i in range(system[NUMBERS]):
        if a[i] != b[i]:
            return 0
    return 1


def shortening(
    system: ConstantIntegers, place: ConstantReals, vector: ConstantReals, actual: Real, work: Reals
) -> Real:
    """MINPACK's shortening after a growing cost: half of where the parabola through slope and value is least."""
    if actual >= 0.0:
        return shortened(0.0, actual)
    n = system[COORDINATES]
    scale = place[vector_at(system, METRIC) :]
    scaled = work[step_at(system, 9) :]
    moved = work[step_at(system, 10) :]
    for j in range(n):
        scaled[j] = scale[j] * vector[j]
    times_upper(n, place[factor_at(system) :], scaled, moved)
    return shortened(dot(n, moved, place[vector_at(system, IMAGE) :]), actual)
