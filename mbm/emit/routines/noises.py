"""Solves whose noise has several unknown factors: simplified Helmert iteration (as `mbm.solution.variance`)."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.emit.routines.rows import evaluate_row, row_scratch
from mbm.target.solver.batch import finish_solve, go_on, start_solve
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_NOISE,
    BLOCK_OUTPUTS,
    BLOCK_WEIGHTS,
    BLOCKS,
    BLOCKS_AT,
    COORDINATES,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_ROWS,
    DATA_WEIGHTS,
    ITERATIONS,
    NOISES,
    NOT_FINITE_AT_START,
    NUMBERS,
    REASON,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

ROUNDS_AT_MOST = 200
SETTLED = 1e-9
"""Relative change of every factor that ends the rounds."""
LEAST_REDUNDANCY = 1e-9
"""A group with less redundancy than this is not checked by anything."""


def rescale(system: ConstantIntegers, data: ConstantIntegers, group: Integer, ratio: Reals, weights: Reals) -> None:
    """Divide the weights of a group by the change of its factor, ``ratio`` (groups,)."""
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        if system[at + BLOCK_NOISE] == group:
            head = DATA_HEAD + b * DATA_BLOCK
            first = data[head + DATA_WEIGHTS]
            for i in range(data[head + DATA_ROWS] * system[at + BLOCK_WEIGHTS]):
                weights[first + i] /= ratio[group]


def share_of_group(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    covariance: ConstantReals,
    group: Integer,
    scratch: Reals,
    line: Reals,
    found: Reals,
) -> None:
    """The sum of squares of a group's whitened residuals, and its redundancy (Förstner 1979): ``found`` 0 and 1."""
    n = system[COORDINATES]
    found[0] = 0.0
    found[1] = 0.0
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        lines = system[at + BLOCK_OUTPUTS]
        if system[at + BLOCK_NOISE] == group:
            for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
                evaluate_row(
                    system, data, parameters, weights, index, columns, point, b, row, scratch, line, line[lines:]
                )
                for i in range(lines):
                    slopes = line[lines + i * n :]
                    leverage = 0.0
                    for j in range(n):
                        for k in range(n):
                            leverage += slopes[j] * covariance[j * n + k] * slopes[k]
                    found[0] += line[i] * line[i]
                    found[1] += max(0.0, min(1.0, 1.0 - leverage))


def factors_left(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    numbers: ConstantReals,
    covariance: ConstantReals,
    spare: Reals,
) -> Real:
    """The factors by which the residuals say that the noise is still wrong, into ``spare``; how far they are from 1."""
    groups = system[NOISES]
    found = spare[groups:]
    scratch = spare[groups + 2 :]
    line = scratch[row_scratch(system) :]
    change = 0.0
    for g in range(groups):
        share_of_group(system, data, parameters, weights, index, columns, numbers, covariance, g, scratch, line, found)
        spare[g] = 1.0
        if found[1] > LEAST_REDUNDANCY and found[0] > 0.0:
            spare[g] = sqrt(found[0] / found[1])
        change = max(change, fabs(spare[g] - 1.0))
    return change


def solve_noises(
    system: ConstantIntegers,
    constants: ConstantReals,
    parameters: ConstantReals,
    weights: Reals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    data: ConstantIntegers,
    start: ConstantReals,
    work: Reals,
    flags: Integers,
    numbers: Reals,
    results: Reals,
    states: Integers,
    sides: Integers,
    triangle: Reals,
    covariance: Reals,
    multipliers: Reals,
    factors: Reals,
    spare: Reals,
) -> None:
    """A solve, again and again with the factors of the noise that its residuals show until these settle.

    ``factors`` (groups,) become the factors; ``spare``: (groups,) and what `evaluate_row` and a row of it want.
    """
    groups = system[NOISES]
    for g in range(groups):
        factors[g] = 1.0
    for i in range(system[NUMBERS]):
        numbers[i] = start[i]
    rounds = 0
    change = 1.0
    going = 1
    while going == 1:
        start_solve(system, constants, parameters, weights, index, columns, data, 0, numbers, work, flags)
        go_on(system, constants, data, index, columns, system[ITERATIONS] + 1, work, flags)
        finish_solve(
            system,
            constants,
            data,
            index,
            columns,
            work,
            flags,
            numbers,
            results,
            states,
            sides,
            triangle,
            covariance,
            multipliers,
        )
        going = 0
        if groups > 0 and states[REASON] != NOT_FINITE_AT_START:
            if change > SETTLED and rounds < ROUNDS_AT_MOST:
                going = 1  # also where the factors settle now: the last solve is one with the last of them
            rounds += 1
            change = factors_left(system, data, parameters, weights, index, columns, numbers, covariance, spare)
            if going == 1:
                for g in range(groups):
                    factors[g] = factors[g] * spare[g]
                    rescale(system, data, g, spare, weights)


ROUTINES = (rescale, share_of_group, factors_left, solve_noises)
