"""Solves whose noise has several unknown factors: simplified Helmert iteration, as `noise_factors` has it."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.emit.routines.agreement import covariance_anew
from mbm.emit.routines.rows import evaluate_row, residuals_of_row, row_scratch, takes_part
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.batch import solve_alone
from mbm.solver.description import NOT_FINITE_AT_START, REASON, Problem
from mbm.solver.linear_algebra import copied, dot, filled
from mbm.solver.noise_factors import (
    BETWEEN,
    LEAST_REDUNDANCY,
    NOISE_ROUNDS,
    OWN,
    SAME_COVARIANCES,
    SETTLED_FACTORS,
    TRIED,
    VANISHED,
    changed,
    fading,
    noise_ratio,
)
from mbm.solver.workspace import Rows, Work

SCATTER = 0
"""Sum of squares without the loss of tails that were cut off."""
REDUNDANCY = 1
SQUARES = 2
COUNT = 3
FOUND = 4
"""What the residuals of a group say."""

RATIO = 4
"""By how much its factor changes."""
FIRST = 5
"""Its factor after the first round."""
CHECKED = 6
"""1: it had some redundancy then …"""
UNTOLD = 7
"""… and has none now."""
EXACT = 8
"""1: it is fitted exactly."""
TOLD = 9
"""Numbers that are known of a group: what its residuals say, and these."""

ASSUMPTIONS = 2
"""About noise: what was never checked is larger, what is estimated as nothing is."""


def rescale(problem: Problem, rows: Rows, group: Integer, ratio: Real) -> None:
    """Divide the weights of a group by the change of its factor."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        if block.noise == group:
            part = rows.data.blocks[b]
            first = part.weights
            for i in range(part.rows * block.weights):
                rows.whitening[first + i] /= ratio


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
    """What the whitened residuals of a group say of its noise: ``found`` (`FOUND`,), with scratch behind.

    Its `REDUNDANCY` with ``redundancy`` 1 only; it is that of Förstner (1979) and wants the derivatives. ``kappa`` is
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
                        found[COUNT] += float(unit.last - unit.first)
                        for i in range(unit.first, unit.last):
                            found[SCATTER] += line[i] * line[i] / kappa[kinds + u]
                            found[SQUARES] += line[i] * line[i]
                            if redundancy == 1:
                                leverage = quadratic_form(n, covariance, line[lines + i * n :])
                                found[REDUNDANCY] += max(0.0, min(1.0, 1.0 - leverage))
        kinds += block.unit_count


def tell_groups(problem: Problem, work: Work, kappa: ConstantReals, told: Reals, spare: Reals) -> Integer:
    """What the residuals at the end of a solve say of all groups, into ``told``; 0: they are no finite numbers."""
    answer = work.answer
    sound = 0 if answer.states[REASON] == NOT_FINITE_AT_START else 1
    for g in range(problem.noises if sound == 1 else 0):
        share_of_group(problem, work.rows, answer.numbers, answer.covariance, kappa, g, 1, spare)
        copied(FOUND, spare, told[g * TOLD :])
        if not (isfinite(spare[SCATTER]) and isfinite(spare[REDUNDANCY])):
            sound = 0
    return sound


def advance(groups: Integer, number: Integer, factors: Reals, told: Reals) -> Integer:
    """The factors after round ``number``; 1: they are settled."""
    settled = 1
    for g in range(groups):
        own = told[g * TOLD :]
        ratio = noise_ratio(own[SCATTER], own[REDUNDANCY])
        own[UNTOLD] = 1.0 if own[REDUNDANCY] <= LEAST_REDUNDANCY else 0.0
        if number == 0:
            own[FIRST] = factors[g] * ratio
            own[CHECKED] = 1.0 - own[UNTOLD]
        if (own[UNTOLD] == 0.0 and own[SCATTER] == 0.0) or factors[g] * ratio < VANISHED * own[FIRST]:
            own[EXACT] = 1.0
        if own[EXACT] == 1.0:
            ratio = 1.0
        if fabs(ratio - 1.0) > SETTLED_FACTORS:
            settled = 0
        own[RATIO] = ratio
        factors[g] = factors[g] * ratio
    return settled


def fade(
    problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, told: Reals, spare: Reals
) -> None:  # fmt: skip
    """Let factors vanish that fall, and do where nothing is left (`fading`); ends with a solve if one was tried."""
    rows = work.rows
    groups = problem.noises
    for g in range(groups):
        told[g * TOLD + RATIO] = 1.0
        if told[g * TOLD + CHECKED] == 1.0:
            told[g * TOLD + RATIO] = fading(
                told[g * TOLD + SCATTER], told[g * TOLD + REDUNDANCY], told[g * TOLD + COUNT]
            )
    for g in range(groups):
        ratio = told[g * TOLD + RATIO]
        if ratio != 1.0:
            rescale(problem, rows, g, ratio)
            solve_alone(problem, rows.data, work.answer.numbers, work)
            sound = tell_groups(problem, work, kappa, told, spare)
            if sound == 1 and told[g * TOLD + SCATTER] < told[g * TOLD + REDUNDANCY]:
                factors[g] = factors[g] * ratio
            else:
                rescale(problem, rows, g, 1.0 / ratio)
                solve_alone(problem, rows.data, work.answer.numbers, work)


def settle_noises(
    problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, told: Reals, spare: Reals
) -> None:  # fmt: skip
    """The solve that has ended, again and again with the noise that its residuals show, until that settles.

    ``factors`` (groups,) become the factors, ``told`` (groups, `TOLD`) what is known of them; ``spare``: `FOUND`, what
    `evaluate_row` and a row of it want.
    """
    rows = work.rows
    groups = problem.noises
    filled(groups, 1.0, factors)
    filled(groups * TOLD, 0.0, told)
    going = 1 if groups > 0 else 0
    number = 0
    while going == 1 and number < NOISE_ROUNDS:
        going = tell_groups(problem, work, kappa, told, spare)
        if going == 1:
            if advance(groups, number, factors, told) == 1:
                going = 0
            for g in range(groups):
                rescale(problem, rows, g, told[g * TOLD + RATIO])
            solve_alone(problem, rows.data, work.answer.numbers, work)
            number += 1
            if going == 1 and number % BETWEEN == 0:
                fade(problem, work, kappa, factors, told, spare)


def assumed(told: ConstantReals, unchecked: Integer) -> Integer:
    """Whether nothing tells the noise of a group, which was never checked (``unchecked`` 1), or is nothing (0)."""
    found = 0
    if told[UNTOLD] == 1.0 and told[EXACT] == 0.0 and told[CHECKED] == 1.0 - float(unchecked):
        found = 1
    return found


def set_assumptions(problem: Problem, work: Work, told: ConstantReals, apart: Reals, covariances: Reals) -> None:
    """``covariances`` (1 + `ASSUMPTIONS`, n, n): that at the end of a solve, and those under each assumption.

    What differs by more than ``apart`` (`ASSUMPTIONS`,) is not known; 0: the assumption is not made.
    """
    n = problem.n
    rows = work.rows
    made = 0
    for which in range(ASSUMPTIONS):
        unchecked = 1 if which == 0 else 0
        apart[which] = 0.0
        for g in range(problem.noises):
            if assumed(told[g * TOLD :], unchecked) == 1:
                apart[which] = SAME_COVARIANCES if unchecked == 1 else OWN
                rescale(problem, rows, g, TRIED)
        if apart[which] != 0.0:
            made = 1
            covariance_anew(problem, work, covariances[(1 + which) * n * n :])
        for g in range(problem.noises):
            if assumed(told[g * TOLD :], unchecked) == 1:
                rescale(problem, rows, g, 1.0 / TRIED)
    if made == 1:
        covariance_anew(problem, work, work.answer.covariance)
        copied(n * n, work.answer.covariance, covariances)


def is_untold(n: Integer, apart: ConstantReals, covariances: ConstantReals, gradient: ConstantReals) -> Integer:
    """1 where a quantity with the ``gradient`` (n,) depends on noise that nothing tells, by `set_assumptions`."""
    found = 0
    for which in range(ASSUMPTIONS):
        if apart[which] != 0.0:
            given = quadratic_form(n, covariances, gradient)
            other = quadratic_form(n, covariances[(1 + which) * n * n :], gradient)
            if changed(given, other, apart[which], given) == 1:
                found = 1
    return found


def mask_untold(n: Integer, apart: ConstantReals, covariances: ConstantReals, covariance: Reals) -> None:
    """NaN for the elements of a covariance (n, n) that depend on noise that nothing tells."""
    for which in range(ASSUMPTIONS):
        other = covariances[(1 + which) * n * n :]
        for i in range(n if apart[which] != 0.0 else 0):
            for j in range(n):
                size = sqrt(covariances[i * n + i] * covariances[j * n + j])
                if changed(covariances[i * n + j], other[i * n + j], apart[which], size) == 1:
                    covariance[i * n + j] = inf - inf


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
