"""The start of an iteration, and the one step of affine equations."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.target.decisions import REFINEMENTS, UNSCALED
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_OUTPUTS,
    BLOCKS,
    BLOCKS_AT,
    BOXED,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COUNT,
    DATA_HEAD,
    DATA_ROWS,
    LANES,
    LINEAR,
    NO_FINITE_STEP,
    NOT_FINITE_AT_START,
    ONE_STEP,
    RUNNING,
    STRICT,
    UNSURE,
)
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.linear_algebra import dot, filled
from mbm.target.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.target.solver.places import arrive
from mbm.target.solver.steps import project
from mbm.target.solver.sweeps import set_triangle, summed, sweep
from mbm.target.solver.trust_region import factor_there
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_POINT,
    AT_SLACK,
    COST_TRIED,
    COUNT_HERE,
    CURVATURE_KNOWN,
    DEFICIENT_OF,
    ENDING_OF,
    EVALUATIONS_DONE,
    FULL,
    HERE,
    ITERATIONS_DONE,
    METRIC,
    PATIENCE_LEFT,
    PENALISED,
    POINT_TRIED,
    RADIUS,
    RESIDUALS_HERE,
    RESIDUALS_TRIED,
    SLOT,
    STOP,
    SUMMED,
    X,
    place_at,
    residuals_at,
    scalars_at,
    step_at,
    trial_at,
    triangle_at,
    vector_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


def constraint_count(system: ConstantIntegers, data: ConstantIntegers) -> Integer:
    """Constraint values of a data set."""
    found = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        lines = system[system[BLOCKS_AT] + b * BLOCK + BLOCK_OUTPUTS]
        found += lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
    return found


def begin(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """Everything at the point that place 0 holds, put into the bounds; `STOP` says whether it is the end already."""
    n = system[COORDINATES]
    place = work[place_at(system, 0) :]
    scalars = work[scalars_at(system) :]
    point = place[AT_POINT:]
    x = work[step_at(system, 11) :]
    if system[BOXED] == 1:
        coordinates_of(system, point, x)
        project(system, constants, x)
        place_coordinates(system, x, point)
    flags[HERE] = 0
    flags[CURVATURE_KNOWN] = 0
    flags[PATIENCE_LEFT] = 0
    flags[RESIDUALS_HERE] = 0
    flags[COUNT_HERE] = data[DATA_COUNT] + flags[PENALISED] * constraint_count(system, data)
    flags[STOP] = RUNNING
    flags[EVALUATIONS_DONE] += 1
    residuals = work[residuals_at(system, 0) :]
    count = residuals_at_point(system, constants, data, index, point, 1, flags[PENALISED], work, residuals)
    place[AT_COST] = dot(count, residuals, residuals)
    triangle = place[triangle_at(system) :]
    if LANES > 1:
        flags[SUMMED] = summed(system, data)
        set_triangle(system, constants, data, index, columns, 0, work, flags)
    else:
        sweep(system, constants, data, index, columns, point, 0, flags[PENALISED], work, scalars, triangle)
    total = place[AT_COST]
    for i in range((n + 1) * (n + 1)):
        total += fabs(triangle[i])
    if not isfinite(total):
        filled((n + 1) * (n + 1), 0.0, triangle)
        flags[STOP] = NOT_FINITE_AT_START
        flags[DEFICIENT_OF] = 0
        return
    arrive(system, constants, 0, -1, 0, work, flags)
    flags[STOP] = flags[ENDING_OF]
    if system[STRICT] == 1 and flags[DEFICIENT_OF] > 0:
        flags[STOP] = UNSURE
    size = 0.0
    coordinates = place[vector_at(system, X) :]
    scale = place[vector_at(system, METRIC) :]
    for j in range(n):
        size += scale[j] * coordinates[j] * scale[j] * coordinates[j]
    size = sqrt(size)
    length = sqrt(place[AT_COST])
    scalars[RADIUS] = size if size > UNSCALED * length else length
    if system[LINEAR] == 1 and flags[PENALISED] == 0:
        scalars[RADIUS] = inf


def solve_directly(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """The minimum of affine equations in one step, with refinement."""
    scalars = work[scalars_at(system) :]
    finite = 1
    moved = 0
    flags[ITERATIONS_DONE] = 1
    for tries in range(1 + REFINEMENTS):
        here = work[place_at(system, flags[HERE]) :]
        point = work[trial_at(system, 0) :]
        retract(system, here[AT_POINT:], here[vector_at(system, FULL) :], point)
        flags[POINT_TRIED] = 0
        flags[RESIDUALS_TRIED] = (flags[RESIDUALS_HERE] + 1) % 3
        residuals = work[residuals_at(system, flags[RESIDUALS_TRIED]) :]
        count = residuals_at_point(system, constants, data, index, point, 1, 0, work, residuals)
        flags[EVALUATIONS_DONE] += 1
        cost = dot(count, residuals, residuals)
        scalars[COST_TRIED] = cost
        finite = 1 if isfinite(cost) else 0
        if finite == 0 or cost > here[AT_COST] + here[AT_SLACK]:
            break
        if factor_there(system, constants, data, index, columns, work, flags) == 0:
            break
        number = 1 - flags[HERE]
        arrive(system, constants, number, flags[HERE], 0, work, flags)
        there = work[place_at(system, number) :]
        if tries > 0 and not there[AT_LENGTH] < here[AT_LENGTH]:
            break
        flags[HERE] = number
        flags[RESIDUALS_HERE] = flags[RESIDUALS_TRIED]
        moved = 1
    flags[STOP] = ONE_STEP
    if moved == 0 and finite == 0:
        flags[STOP] = NO_FINITE_STEP
    if system[STRICT] == 1 and flags[SLOT * flags[HERE] + DEFICIENT_OF] > 0:
        flags[STOP] = UNSURE
