"""Solves whose noise has several unknown factors: simplified Helmert iteration, as `noise_factors` has it."""

from __future__ import annotations

from math import fabs, inf, isfinite

from mbm.emit.routines.rows import evaluate_next_row, residuals_of_row, row_scratch, takes_part
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.batch import solve_alone
from mbm.solver.decisions import fits_exactly, rounding_of_norm
from mbm.solver.description import NOT_FINITE_AT_START, REASON, Problem
from mbm.solver.linear_algebra import copied, dot, filled
from mbm.solver.linearisation import squares_of_terms
from mbm.solver.noise_factors import (
    BESIDE_ROUNDS,
    BETWEEN,
    LEAST_REDUNDANCY,
    NOISE_ROUNDS,
    SETTLED_FACTORS,
    SHRINKINGS,
    VANISHED,
    fading,
    is_nothing,
    leap,
    noise_ratio,
    nothing_left,
    starting,
)
from mbm.solver.workspace import Rows, Work

SCATTER = 0
"""Sum of squares without the loss of tails that were cut off."""
REDUNDANCY = 1
SQUARES = 2
COUNT = 3
TERMS = 4
"""Sum of the squares of the terms that residuals are made of, as `metric.terms_of_rows` has them."""
FOUND = 5
"""What the residuals of a group say."""

RATIO = 5
"""By how much its factor changes."""
FIRST = 6
"""Its factor after the first round."""
CHECKED = 7
"""1: it had some redundancy then …"""
UNTOLD = 8
"""… and has none now."""
EXACT = 9
"""1: it is fitted exactly."""
BEFORE = 10
"""The change before the last."""
KEPT = 11
"""Its factor while another is tried."""
STARTED = 12
"""1: the factor that it starts with is found."""
TRIED_AS_NOTHING = 13
"""1: it is fitted exactly, and was tried as nothing."""
TOLD = 14
"""Numbers that are known of a group: what its residuals say, and these."""


def rescale(problem: Problem, rows: Rows, group: Integer, ratio: Real) -> None:
    """Divide the weights of a group by the change of its factor."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        if block.noise == group:
            part = rows.data.blocks[b]
            first = part.weights
            for i in range(part.rows * block.weights):
                rows.whitening[first + i] /= ratio


def leverage(n: Integer, work: Work, slopes: ConstantReals) -> Real:
    """The share of a row with ``slopes`` (n,) that the estimates follow, by the factor of their covariance.

    The covariance itself has rounding that is as large as what is left of a row that weighs far more than all others.
    """
    total = 0.0
    for k in range(work.rank):
        along = dot(n, work.part[k * n :], slopes)
        total += along * along
    return total


def share_of_group(
    problem: Problem,
    work: Work,
    point: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    redundancy: Integer,
    found: Reals,
) -> None:
    """What the whitened residuals of a group say of its noise: ``found`` (`FOUND`,), with scratch behind.

    Its `REDUNDANCY`, that of Förstner (1979), and `TERMS` with ``redundancy`` 1 only: they want the derivatives.
    ``kappa`` is the share of its variance that a unit of each kind has left, where limits cut its tails off.
    """
    n = problem.n
    rows = work.rows
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
                    evaluate_next_row(problem, rows, point, b, row, scratch, line, line[lines:])
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
                                slopes = line[lines + i * n :]
                                found[REDUNDANCY] += max(0.0, min(1.0, 1.0 - leverage(n, work, slopes)))
                                found[TERMS] += squares_of_terms(problem, slopes, point)
        kinds += block.unit_count


def tell_groups(problem: Problem, work: Work, kappa: ConstantReals, told: Reals, spare: Reals) -> Integer:
    """What the residuals at the end of a solve say of all groups, into ``told``; 0: they are no finite numbers."""
    answer = work.answer
    if answer.states[REASON] == NOT_FINITE_AT_START:
        return 0
    sound = 1
    for g in range(problem.noises):
        share_of_group(problem, work, answer.numbers, kappa, g, 1, spare)
        copied(FOUND, spare, told[g * TOLD :])
        if not (isfinite(spare[SCATTER]) and isfinite(spare[REDUNDANCY])):
            sound = 0
    return sound


def add_column_squares(
    problem: Problem, rows: Rows, point: ConstantReals, group: Integer, scale: Real, total: Reals, scratch: Reals
) -> None:
    """Add to ``total`` (n,) the sums of the squares of a group's derivatives (-1: of all that has none), scaled."""
    n = problem.n
    line = scratch[row_scratch(problem) :]
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        if block.noise == group:
            for row in range(rows.data.blocks[b].rows):
                evaluate_next_row(problem, rows, point, b, row, scratch, line, line[block.outputs :])
                for u in range(block.unit_count):
                    unit = block.units[u]
                    if takes_part(problem, rows, b, row, unit) == 1:
                        for i in range(unit.first, unit.last):
                            slopes = line[block.outputs + i * n :]
                            for j in range(n):
                                total[j] += scale * slopes[j] * slopes[j]


def start_of(
    problem: Problem, rows: Rows, point: ConstantReals, group: Integer, told: ConstantReals, spare: Reals
) -> Real:  # fmt: skip
    """The factor with which a group starts (`starting`) beside what is known, ``spare`` (n,); 0: they share nothing."""
    n = problem.n
    own = spare[n:]
    filled(n, 0.0, own)
    add_column_squares(problem, rows, point, group, 1.0, own, spare[2 * n :])
    least = inf
    most = 0.0
    for j in range(n):
        if own[j] > 0.0 and spare[j] > 0.0:
            least = min(least, own[j] / spare[j])
            most = max(most, own[j] / spare[j])
    found = 0.0
    if most > 0.0:
        found = starting(least, most, told[REDUNDANCY], told[COUNT])
    return found


def start_factors(problem: Problem, work: Work, factors: Reals, told: Reals, spare: Reals) -> None:
    """The factors with which the groups start: groups whose unknowns rows of known noise share come first."""
    rows = work.rows
    point = work.answer.numbers
    n = problem.n
    filled(n, 0.0, spare)
    add_column_squares(problem, rows, point, -1, 1.0, spare, spare[2 * n :])
    for _ in range(problem.noises):
        chosen = -1
        factor = 0.0
        for g in range(problem.noises):
            if told[g * TOLD + STARTED] == 0.0 and factor == 0.0:
                factor = start_of(problem, rows, point, g, told[g * TOLD :], spare)
                if factor != 0.0 or chosen < 0:
                    chosen = g
        if factor == 0.0:
            factor = 1.0
        told[chosen * TOLD + STARTED] = 1.0
        factors[chosen] = factor
        add_column_squares(problem, rows, point, chosen, 1.0 / (factor * factor), spare, spare[2 * n :])
    moved = 0
    for g in range(problem.noises):
        if factors[g] != 1.0:
            moved = 1
            rescale(problem, rows, g, factors[g])
    if moved == 1:
        solve_alone(problem, rows.data, point, work)


def fits_rounding(told: ConstantReals) -> Integer:
    """Whether what is left of the residuals of a group is rounding of their terms."""
    return 1 if fits_exactly(told[SCATTER], rounding_of_norm(told[TERMS], told[SCATTER])) else 0


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
            if own[UNTOLD] == 1.0:
                ratio = 1.0 / factors[g]
        if (own[UNTOLD] == 0.0 and fits_rounding(own) == 1) or factors[g] * ratio < VANISHED * own[FIRST]:
            own[EXACT] = 1.0
        if own[EXACT] == 1.0:
            ratio = 1.0
        if fabs(ratio - 1.0) > SETTLED_FACTORS:
            settled = 0
        own[RATIO] = ratio
        if number % BETWEEN == BETWEEN - 1:
            own[RATIO] = ratio * leap(own[BEFORE], ratio)
        own[BEFORE] = ratio
        factors[g] = factors[g] * own[RATIO]
    return settled


def changed_factor(problem: Problem, work: Work, factors: Reals, group: Integer, ratio: Real) -> None:
    """Multiply the factor of a group."""
    factors[group] = factors[group] * ratio
    rescale(problem, work.rows, group, ratio)


def settle_beside(
    problem: Problem, work: Work, kappa: ConstantReals, group: Integer, factors: Reals, told: Reals, spare: Reals
) -> Integer:  # fmt: skip
    """Rounds for all other groups with the factor of one as it is; 0: residuals are no finite numbers."""
    sound = 1
    number = 0
    going = 1
    while going == 1 and number < BESIDE_ROUNDS:
        solve_alone(problem, work.rows.data, work.answer.numbers, work)
        sound = tell_groups(problem, work, kappa, told, spare)
        going = 0
        number += 1
        for g in range(problem.noises if sound == 1 else 0):
            own = told[g * TOLD :]
            if g != group and own[EXACT] == 0.0:
                ratio = noise_ratio(own[SCATTER], own[REDUNDANCY])
                if fabs(ratio - 1.0) > SETTLED_FACTORS:
                    going = 1
                changed_factor(problem, work, factors, g, ratio)
    return sound


def put_back(problem: Problem, work: Work, factors: Reals, told: ConstantReals) -> None:
    """The factors that were `KEPT`."""
    for g in range(problem.noises):
        rescale(problem, work.rows, g, told[g * TOLD + KEPT] / factors[g])
        factors[g] = told[g * TOLD + KEPT]


def fade(
    problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, told: Reals, spare: Reals
) -> None:  # fmt: skip
    """Let factors vanish that fall, and do where nothing is left (`fading`); ends with a solve if one was tried."""
    groups = problem.noises
    for g in range(groups):
        own = told[g * TOLD :]
        own[RATIO] = 1.0
        if own[CHECKED] == 1.0:
            own[RATIO] = fading(own[SCATTER], own[REDUNDANCY], own[COUNT])
    for g in range(groups):
        ratio = told[g * TOLD + RATIO]
        if ratio != 1.0:
            for k in range(groups):
                told[k * TOLD + KEPT] = factors[k]
            changed_factor(problem, work, factors, g, ratio)
            sound = settle_beside(problem, work, kappa, g, factors, told, spare)
            if sound == 1 and is_nothing(told[g * TOLD + SCATTER], told[g * TOLD + REDUNDANCY]) == 1:
                changed_factor(problem, work, factors, g, nothing_left(told[g * TOLD + REDUNDANCY]))
            else:
                put_back(problem, work, factors, told)
            solve_alone(problem, work.rows.data, work.answer.numbers, work)


def told_beside(problem: Problem, told: ConstantReals) -> Integer:
    """Whether some noise is stated, or told by residuals."""
    found = 0
    for b in range(problem.residual_blocks):
        if problem.blocks[b].noise < 0:
            found = 1
    for g in range(problem.noises):
        if told[g * TOLD + EXACT] == 0.0 and told[g * TOLD + UNTOLD] == 0.0:
            found = 1
    return found


def forgo(
    problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, told: Reals, spare: Reals
) -> Integer:  # fmt: skip
    """Whether a group that is fitted exactly is nothing beside noise that is told; once for each."""
    groups = problem.noises
    done = 0
    beside = told_beside(problem, told)
    for g in range(groups):
        own = told[g * TOLD :]
        if beside == 1 and done == 0 and own[EXACT] == 1.0 and own[TRIED_AS_NOTHING] == 0.0:
            own[TRIED_AS_NOTHING] = 1.0
            for k in range(groups):
                told[k * TOLD + KEPT] = factors[k]
            number = 0
            while number < SHRINKINGS:
                left = own[REDUNDANCY]
                changed_factor(problem, work, factors, g, nothing_left(left))
                solve_alone(problem, work.rows.data, work.answer.numbers, work)
                sound = tell_groups(problem, work, kappa, told, spare)
                number += 1
                if sound == 0 or own[REDUNDANCY] > 0.5 * left:
                    number = SHRINKINGS
                elif own[REDUNDANCY] <= LEAST_REDUNDANCY:
                    number = SHRINKINGS
                    done = 1
            for k in range(groups):
                if told[k * TOLD + UNTOLD] == 1.0 and told[k * TOLD + REDUNDANCY] > LEAST_REDUNDANCY:
                    done = 0
            if done == 1:
                own[EXACT] = 0.0
            else:
                put_back(problem, work, factors, told)
                solve_alone(problem, work.rows.data, work.answer.numbers, work)
    return done


def settle_noises(
    problem: Problem, work: Work, kappa: ConstantReals, factors: Reals, told: Reals, spare: Reals
) -> Integer:  # fmt: skip
    """The solve that has ended, again and again with the noise that its residuals show; 0: that has not settled.

    ``factors`` (groups,) become the factors, ``told`` (groups, `TOLD`) what is known of them; ``spare``: `FOUND` or two
    vectors (n,), what `evaluate_next_row` and a row of it want.
    """
    rows = work.rows
    groups = problem.noises
    filled(groups, 1.0, factors)
    filled(groups * TOLD, 0.0, told)
    going = 1 if groups > 0 else 0
    if going == 1:
        going = tell_groups(problem, work, kappa, told, spare)
    if going == 1:
        start_factors(problem, work, factors, told, spare)
    number = 0
    while going == 1 and number < NOISE_ROUNDS:
        going = tell_groups(problem, work, kappa, told, spare)
        if going == 1:
            settled = advance(groups, number, factors, told)
            for g in range(groups):
                rescale(problem, rows, g, told[g * TOLD + RATIO])
            solve_alone(problem, rows.data, work.answer.numbers, work)
            number += 1
            if settled == 1:
                going = forgo(problem, work, kappa, factors, told, spare)
            elif number % BETWEEN == 0:
                fade(problem, work, kappa, factors, told, spare)
    return 1 - going


def spread_of_group(
    problem: Problem,
    work: Work,
    numbers: ConstantReals,
    kappa: ConstantReals,
    group: Integer,
    what: Integer,
    spare: Reals,
) -> Real:
    """`SCATTER`, 0 where it is rounding, or `SQUARES` of a group (-1: of all that has none), at the end of a solve."""
    share_of_group(problem, work, numbers, kappa, group, 1 if what == SCATTER else 0, spare)
    if what == SCATTER and fits_rounding(spare) == 1:
        return 0.0
    return fabs(spare[what])  # it is not negative
