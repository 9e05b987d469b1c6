"""Solves whose noise has several unknown factors: simplified Helmert iteration (as `mbm.solution.variance`)."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.emit.routines.rows import evaluate_row, row_scratch, takes_part
from mbm.target.decisions import LEAST_REDUNDANCY, NOISE_ROUNDS, SETTLED_FACTORS
from mbm.target.solver.batch import finish_solve, go_on, start_solve
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_NOISE,
    BLOCK_OUTPUTS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
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
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

SCATTER = 0
"""Sum of squares without the loss of tails that were cut off."""
REDUNDANCY = 1
SQUARES = 2
FOUND = 3


def rescale(system: ConstantIntegers, data: ConstantIntegers, group: Integer, ratio: Reals, weights: Reals) -> None:
    """Divide the weights of a group by the change of its factor, ``ratio`` (groups,)."""
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        if system[at + BLOCK_NOISE] == group:
            head = DATA_HEAD + b * DATA_BLOCK
            first = data[head + DATA_WEIGHTS]
            for i in range(data[head + DATA_ROWS] * system[at + BLOCK_WEIGHTS]):
                weights[first + i] /= ratio[group]


def quadratic_form(n: Integer, matrix: ConstantReals, vector: ConstantReals) -> Real:
    """``vᵀ M v``."""
    total = 0.0
    for j in range(n):
        for k in range(n):
            total += vector[j] * matrix[j * n + k] * vector[k]
    return total


def share_of_group(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    scratch: Reals,
    line: Reals,
    found: Reals,
) -> None:
    """What the whitened residuals of a group say of its noise: ``found`` `SCATTER`, `REDUNDANCY` and `SQUARES`.

    ``kappa`` is the share of its variance that a unit of each kind has left, where limits cut its tails off. The
    redundancy is that of Förstner (1979).
    """
    n = system[COORDINATES]
    for i in range(FOUND):
        found[i] = 0.0
    kinds = 0
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        lines = system[at + BLOCK_OUTPUTS]
        if system[at + BLOCK_NOISE] == group:
            for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
                evaluate_row(
                    system, data, parameters, weights, index, columns, point, b, row, scratch, line, line[lines:]
                )
                for u in range(system[at + BLOCK_UNITS]):
                    unit = system[system[at + BLOCK_UNITS_AT] + u * UNIT :]
                    if takes_part(system, data, weights, b, row, unit) == 1:
                        for i in range(unit[UNIT_FIRST], unit[UNIT_LAST]):
                            leverage = quadratic_form(n, covariance, line[lines + i * n :])
                            found[SCATTER] += line[i] * line[i] / kappa[kinds + u]
                            found[REDUNDANCY] += max(0.0, min(1.0, 1.0 - leverage))
                            found[SQUARES] += line[i] * line[i]
        kinds += system[at + BLOCK_UNITS]


def factors_left(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    numbers: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    spare: Reals,
) -> Real:
    """The factors by which the residuals say that the noise is still wrong, into ``spare``; how far they are from 1."""
    groups = system[NOISES]
    found = spare[groups:]
    scratch = spare[groups + FOUND :]
    line = scratch[row_scratch(system) :]
    change = 0.0
    for g in range(groups):
        share_of_group(
            system, data, parameters, weights, index, columns, numbers, covariance, kappa, g, scratch, line, found
        )
        spare[g] = 1.0
        if found[REDUNDANCY] > LEAST_REDUNDANCY and found[SCATTER] > 0.0:
            spare[g] = sqrt(found[SCATTER] / found[REDUNDANCY])
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
    kappa: ConstantReals,
    factors: Reals,
    spare: Reals,
) -> None:
    """A solve, again and again with the factors of the noise that its residuals show until these settle.

    ``factors`` (groups,) become the factors; ``spare``: (groups,), `FOUND`, what `evaluate_row` and a row of it want.
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
            if change > SETTLED_FACTORS and rounds < NOISE_ROUNDS:
                going = 1  # also where the factors settle now: the last solve is one with the last of them
            rounds += 1
            change = factors_left(system, data, parameters, weights, index, columns, numbers, covariance, kappa, spare)
            if going == 1:
                for g in range(groups):
                    factors[g] = factors[g] * spare[g]
                    rescale(system, data, g, spare, weights)


def spread_of_group(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    numbers: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    what: Integer,
    spare: Reals,
) -> Real:
    """`SCATTER` or `SQUARES` of a group (-1: of all that has none), at the end of a solve."""
    scratch = spare[FOUND:]
    line = scratch[row_scratch(system) :]
    share_of_group(
        system, data, parameters, weights, index, columns, numbers, covariance, kappa, group, scratch, line, spare
    )
    return fabs(spare[what])  # it is not negative
