"""Solves whose noise has several unknown factors: simplified Helmert iteration (`noise_ratio`)."""

from __future__ import annotations

from math import fabs

from mbm.emit.routines.rows import evaluate_row, residuals_of_row, row_scratch, takes_part
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.batch import solve_alone
from mbm.solver.decisions import NOISE_ROUNDS, SETTLED_FACTORS, noise_ratio
from mbm.solver.description import NOT_FINITE_AT_START, REASON, Problem
from mbm.solver.linear_algebra import dot, filled
from mbm.solver.workspace import Rows, Work

SCATTER = 0
"""Sum of squares without the loss of tails that were cut off."""
REDUNDANCY = 1
SQUARES = 2
FOUND = 3


def rescale(problem: Problem, rows: Rows, group: Integer, ratio: Reals) -> None:
    """Divide the weights of a group by the change of its factor, ``ratio`` (groups,)."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        if block.noise == group:
            part = rows.data.blocks[b]
            first = part.weights
            for i in range(part.rows * block.weights):
                rows.whitening[first + i] /= ratio[group]


def quadratic_form(n: Integer, matrix: ConstantReals, vector: ConstantReals) -> Real:
    """``vᵀ M v``; rows of equations are 0 in most of their coordinates."""
    total = 0.0
    for j in range(n):
        if vector[j] != 0.0:
            total += vector[j] * dot(n, matrix[j * n :], vector)
    return total


def share_of_group(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    redundancy: Integer,
    found: Reals,
) -> None:
    """What the whitened residuals of a group say of its noise: ``found`` `SCATTER`, `SQUARES`, with scratch behind.

    With ``redundancy`` 1 `REDUNDANCY`, too, which is that of Förstner (1979) and wants the derivatives. ``kappa`` is
    the share of its variance that a unit of each kind has left, where limits cut its tails off.
    """
    n = problem.n
    scratch = found[FOUND:]
    line = scratch[row_scratch(problem) :]
    filled(FOUND, 0.0, found)
    kinds = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        lines = block.outputs
        if block.noise == group:
            for row in range(rows.data.blocks[b].rows):
                if redundancy == 1:
                    evaluate_row(problem, rows, point, b, row, scratch, line, line[lines:])
                else:
                    residuals_of_row(problem, rows, point, b, row, scratch, line)
                for u in range(block.unit_count):
                    unit = block.units[u]
                    if takes_part(problem, rows, b, row, unit) == 1:
                        for i in range(unit.first, unit.last):
                            found[SCATTER] += line[i] * line[i] / kappa[kinds + u]
                            found[SQUARES] += line[i] * line[i]
                            if redundancy == 1:
                                leverage = quadratic_form(n, covariance, line[lines + i * n :])
                                found[REDUNDANCY] += max(0.0, min(1.0, 1.0 - leverage))
        kinds += block.unit_count


def factors_left(
    problem: Problem,
    rows: Rows,
    numbers: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    spare: Reals,
) -> Real:
    """The factors by which the residuals say that the noise is still wrong, into ``spare``; how far they are from 1."""
    groups = problem.noises
    found = spare[groups:]
    change = 0.0
    for g in range(groups):
        share_of_group(problem, rows, numbers, covariance, kappa, g, 1, found)
        spare[g] = noise_ratio(found[SCATTER], found[REDUNDANCY])
        change = max(change, fabs(spare[g] - 1.0))
    return change


def settle_noises(problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, spare: Reals) -> None:
    """The solve that has ended, again and again with the noise that its residuals show, until that settles.

    ``factors`` (groups,) become the factors; ``spare``: (groups,), `FOUND`, what `evaluate_row` and a row of it want.
    """
    rows = work.rows
    answer = work.answer
    groups = problem.noises
    filled(groups, 1.0, factors)
    rounds = 0
    change = 1.0
    while groups > 0 and answer.states[REASON] != NOT_FINITE_AT_START:
        settled = change <= SETTLED_FACTORS or rounds >= NOISE_ROUNDS
        rounds += 1
        change = factors_left(problem, rows, answer.numbers, answer.covariance, kappa, spare)
        if settled:
            break
        for g in range(groups):
            factors[g] = factors[g] * spare[g]
            rescale(problem, rows, g, spare)
        solve_alone(problem, rows.data, answer.numbers, work)  # also where they settle now: the last has the last ones


def spread_of_group(
    problem: Problem,
    rows: Rows,
    numbers: ConstantReals,
    covariance: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    what: Integer,
    spare: Reals,
) -> Real:
    """`SCATTER` or `SQUARES` of a group (-1: of all that has none), at the end of a solve."""
    share_of_group(problem, rows, numbers, covariance, kappa, group, 0, spare)
    return fabs(spare[what])  # it is not negative
