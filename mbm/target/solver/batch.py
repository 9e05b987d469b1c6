"""Solves from beginning to end, one after the other: what is called from outside."""

from __future__ import annotations

from mbm.target.decisions import PUSHED
from mbm.target.solver.beginning import begin, constraint_count, solve_directly
from mbm.target.solver.constraints import begin_rounds, next_round, set_held
from mbm.target.solver.covariance import set_covariance, undetermined
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCKS,
    BLOCKS_AT,
    BOUNDS_AT,
    CONDITION,
    CONSTRAINTS,
    COORDINATES,
    COST,
    DATA_BLOCK,
    DATA_COUNT,
    DATA_HEAD,
    DEFICIENT,
    DIRECT,
    EVALUATIONS,
    FREEDOM,
    ITERATIONS,
    LANES,
    MAX_ITERATIONS,
    MULTIPLIERS,
    NO_LOSS,
    NOT_FINITE_AT_START,
    NUMBERS,
    OFFSET,
    PLAIN_COST,
    POSITIVE_AT,
    REASON,
    RESULTS,
    ROUNDS,
    RUNNING,
    STATES,
    STEPS,
    TOLERANCE,
    UNIT,
    UNIT_LOSS,
    UNSURE,
    VIOLATION,
)
from mbm.target.solver.equations import load_rows, residuals_at_point
from mbm.target.solver.linear_algebra import copied, dot, filled
from mbm.target.solver.pushing import release_idle
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.trust_region import iterate
from mbm.target.solver.workspace import (
    AT_COST,
    AT_OFFSET,
    AT_POINT,
    AT_SQUARE,
    DEFICIENT_OF,
    EVALUATIONS_DONE,
    FREE,
    FULL,
    HELD,
    HERE,
    ITERATIONS_DONE,
    LAMBDA,
    LOADED,
    LOOSE,
    PENALISED,
    RANK,
    ROUND,
    SLOT,
    STOP,
    STOPPED,
    TOLERANCE_NOW,
    TOUCHED,
    WORST,
    X,
    multipliers_at,
    place_at,
    residuals_at,
    scalars_at,
    step_at,
    triangle_at,
    vector_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals

SURE = 1e4
"""A squared condition up to which sums of products give variances to 1e-10: with errors of a few eps √rows."""


def start_solve(
    system: ConstantIntegers,
    constants: ConstantReals,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    data: ConstantIntegers,
    loaded: Integer,
    start: ConstantReals,
    work: Reals,
    flags: Integers,
) -> None:
    """Everything at the start of a solve; ``loaded`` 1: the rows of the data set are in ``work`` already."""
    if loaded == 0:
        load_rows(system, data, parameters, weights, work)
    copied(system[NUMBERS], start, work[place_at(system, 0) + AT_POINT :])
    flags[ITERATIONS_DONE] = 0
    flags[EVALUATIONS_DONE] = 0
    flags[ROUND] = 0
    flags[PENALISED] = 0
    work[scalars_at(system) + TOLERANCE_NOW] = constants[TOLERANCE]
    if system[CONSTRAINTS] > 0:
        begin_rounds(system, constants, data, index, columns, work, flags)
    else:
        begin(system, constants, data, index, columns, work, flags)
        if system[DIRECT] == 1 and flags[STOP] != NOT_FINITE_AT_START and flags[STOP] != UNSURE:
            solve_directly(system, constants, data, index, columns, work, flags)


def go_on(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    most: Integer,
    work: Reals,
    flags: Integers,
) -> Integer:
    """Up to ``most`` further iterations; 1 where the solve is at its end, 0 where there is more to do."""
    last = flags[ITERATIONS_DONE] + most
    going = 1
    while going == 1:
        while flags[STOP] == RUNNING and flags[ITERATIONS_DONE] < system[ITERATIONS]:
            if flags[ITERATIONS_DONE] >= last:
                return 0
            iterate(system, constants, data, index, columns, work, flags)
        if flags[STOP] == RUNNING:
            flags[STOP] = MAX_ITERATIONS
        going = 0
        if system[CONSTRAINTS] > 0 and flags[PENALISED] == 1:
            going = next_round(system, constants, data, index, columns, work, flags)
    return 1


def set_sides(system: ConstantIntegers, constants: ConstantReals, place: ConstantReals, sides: Integers) -> None:
    """-1 and +1 for coordinates held at their lower and upper bound, else 0.

    A `positive` coordinate whose undamped step still goes all the way to zero is at its lower bound.
    """
    n = system[COORDINATES]
    x = place[vector_at(system, X) :]
    free = place[vector_at(system, FREE) :]
    full = place[vector_at(system, FULL) :]
    stopped = place[vector_at(system, STOPPED) :]
    for j in range(n):
        sides[j] = 0
        if free[j] == 0.0 and x[j] >= constants[BOUNDS_AT + n + j]:
            sides[j] = 1
        if free[j] == 0.0 and x[j] <= constants[BOUNDS_AT + j]:
            sides[j] = -1
        if system[system[POSITIVE_AT] + j] != 0 and stopped[j] != 0.0 and full[j] < 0.0:
            sides[j] = -1


def lossy(system: ConstantIntegers) -> Integer:
    """1 where some unit has a loss."""
    for b in range(system[BLOCKS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        for u in range(block[BLOCK_UNITS]):
            if system[block[BLOCK_UNITS_AT] + u * UNIT + UNIT_LOSS] != NO_LOSS:
                return 1
    return 0


def finish_solve(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
    numbers: Reals,
    results: Reals,
    states: Integers,
    sides: Integers,
    triangle: Reals,
    covariance: Reals,
    multipliers: Reals,
) -> None:
    """The answer of a solve that has ended."""
    n = system[COORDINATES]
    here = work[place_at(system, flags[HERE]) :]
    copied(system[NUMBERS], here[AT_POINT:], numbers)
    states[REASON] = flags[STOP]
    states[STEPS] = flags[ITERATIONS_DONE]
    states[EVALUATIONS] = flags[EVALUATIONS_DONE]
    states[ROUNDS] = flags[ROUND]
    states[DEFICIENT] = 1 if flags[SLOT * flags[HERE] + DEFICIENT_OF] > 0 else 0
    results[OFFSET] = here[AT_OFFSET]
    results[COST] = here[AT_COST]
    results[VIOLATION] = 0.0
    filled(system[MULTIPLIERS], 0.0, multipliers)
    copied((n + 1) * (n + 1), here[triangle_at(system) :], triangle)
    residuals = work[residuals_at(system, 0) :]
    point = here[AT_POINT:]
    count = constraint_count(system, data)
    if flags[STOP] == NOT_FINITE_AT_START:
        for j in range(n):
            sides[j] = 0
        states[FREEDOM] = 0
        states[DEFICIENT] = 1
        results[PLAIN_COST] = here[AT_COST]
        results[CONDITION] = undetermined(n, sides, covariance)
        filled(n, 1.0, work[step_at(system, TOUCHED) :])
        flags[RANK] = 0
        flags[LOOSE] = 0
        return
    set_sides(system, constants, here, sides)
    if flags[PENALISED] == 1:
        size = residuals_at_point(system, constants, data, index, point, 1, 0, work, residuals)
        results[COST] = dot(size, residuals, residuals)
        sweep(system, constants, data, index, columns, point, 0, 0, work, constants, triangle)
        results[VIOLATION] = work[scalars_at(system) + WORST]
        set_held(system, data, results[COST], work)
        copied(count, work[multipliers_at(system, LAMBDA) :], multipliers)
    else:
        if LANES > 1 and here[AT_SQUARE] > SURE:
            sweep(system, constants, data, index, columns, point, 0, 0, work, constants, triangle)
        # constraints push as well, and say so themselves
        release_idle(n, triangle, here[vector_at(system, X) :], results[COST], sides)
    results[PLAIN_COST] = results[COST]
    if lossy(system) == 1:
        size = residuals_at_point(system, constants, data, index, point, 0, 0, work, residuals)
        results[PLAIN_COST] = dot(size, residuals, residuals)
    count = count if flags[PENALISED] == 1 else 0
    held = work[multipliers_at(system, HELD) :]
    results[CONDITION] = set_covariance(system, triangle, sides, count, held, work, flags, covariance)
    states[FREEDOM] = data[DATA_COUNT] - flags[RANK]
    if flags[PENALISED] == 1 and states[FREEDOM] <= 0 and results[COST] > PUSHED * PUSHED:
        # Residuals are perpendicular to all columns at a minimum: what remains of so few leaves a column too many.
        results[CONDITION] = undetermined(n, sides, covariance)
    states[DEFICIENT] = 0 if results[CONDITION] < 1e300 else 1


def solve_many(
    system: ConstantIntegers,
    constants: ConstantReals,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    data: ConstantIntegers,
    which: ConstantIntegers,
    starts: ConstantReals,
    first: Integer,
    last: Integer,
    work: Reals,
    flags: Integers,
    numbers: Reals,
    results: Reals,
    states: Integers,
    sides: Integers,
    triangles: Reals,
    covariances: Reals,
    multipliers: Reals,
) -> None:
    """Solves ``first … last`` of a batch, each from beginning to end, with the scratch of one thread."""
    n = system[COORDINATES]
    stride = DATA_HEAD + DATA_BLOCK * (system[BLOCKS] + system[CONSTRAINTS])
    flags[LOADED] = -1
    for k in range(first, last):
        own = data[which[k] * stride :]
        loaded = 1 if flags[LOADED] == which[k] else 0
        start = starts[k * system[NUMBERS] :]
        start_solve(system, constants, parameters, weights, index, columns, own, loaded, start, work, flags)
        flags[LOADED] = which[k]
        go_on(system, constants, own, index, columns, system[ITERATIONS] + 1, work, flags)
        finish_solve(
            system,
            constants,
            own,
            index,
            columns,
            work,
            flags,
            numbers[k * system[NUMBERS] :],
            results[k * RESULTS :],
            states[k * STATES :],
            sides[k * n :],
            triangles[k * (n + 1) * (n + 1) :],
            covariances[k * n * n :],
            multipliers[k * system[MULTIPLIERS] :],
        )
