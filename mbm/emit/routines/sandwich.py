"""The covariance of estimates with losses: the sandwich ``H⁻¹ G H⁻¹`` of `mbm.solver.loss_spread`."""

from __future__ import annotations

from mbm.emit.routines.rows import evaluate_row, row_scratch, takes_part
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals
from mbm.solver.covariance import undetermined
from mbm.solver.decisions import EXHAUSTED
from mbm.solver.description import NO_LOSS, Problem, Unit
from mbm.solver.linear_algebra import (
    add_multiple,
    cholesky,
    dot,
    filled,
    product,
    solve_lower,
    solve_lower_transposed,
    sum_of_products,
)
from mbm.solver.loss_pools import SUMS, TOTAL, TRACES, add_to_sums, first_with_loss, same_loss, spread_of_loss
from mbm.solver.loss_spread import curvature_factor
from mbm.solver.workspace import Work


def add_to_pool(
    unit: Unit,
    rank: Integer,
    constants: ConstantReals,
    stated: Integer,
    residuals: ConstantReals,
    along: ConstantReals,
    sums: Reals,
    information: Reals,
) -> None:
    """Add what a unit with ``residuals`` (size,) and derivatives ``along`` (size, rank) gives to the sums."""
    size = unit.last - unit.first
    weight = add_to_sums(unit, constants, stated, dot(size, residuals, residuals), sums)
    for i in range(size):
        row = along[i * rank :]
        for a in range(rank):
            add_multiple(rank, weight * row[a], row, information[a * rank :])


def pool(
    problem: Problem,
    work: Work,
    point: ConstantReals,
    loss: Unit,
    sums: Reals,
    information: Reals,
    scratch: Reals,
) -> None:
    """The sums over all units with the loss of the unit ``loss``, and A (r, r) along the r rows of `part`."""
    n = problem.n
    rows = work.rows
    rank = work.rank
    line = scratch[row_scratch(problem) :]
    filled(SUMS, 0.0, sums)
    filled(rank * rank, 0.0, information)
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        lines = block.outputs
        stated = 1 if block.noise < 0 else 0
        for u in range(block.unit_count):
            unit = block.units[u]
            if same_loss(rows.constants, unit, loss) == 1:
                for row in range(rows.data.blocks[b].rows):
                    if takes_part(problem, rows, b, row, unit) == 1:
                        evaluate_row(problem, rows, point, b, row, scratch, line, line[lines:])
                        for i in range(unit.last - unit.first):
                            slopes = line[lines + (unit.first + i) * n :]
                            for a in range(rank):
                                scratch[i * rank + a] = dot(n, slopes, work.part[a * n :])
                        own = line[unit.first :]
                        add_to_pool(unit, rank, rows.constants, stated, own, scratch, sums, information)


def inverted(n: Integer, matrix: Reals, inverse: Reals) -> Integer:
    """The inverse of a symmetric matrix (n, n) that is positive definite beyond rounding of the identity; 0: it is not.

    ``matrix`` becomes its factor.
    """
    if cholesky(n, matrix) == 0:
        return 0
    filled(n * n, 0.0, inverse)
    trace = 0.0
    for i in range(n):
        row = inverse[i * n :]
        row[i] = 1.0
        solve_lower(n, matrix, row)
        solve_lower_transposed(n, matrix, row)
        trace += row[i]
    return 1 if trace * EXHAUSTED < 1.0 else 0


def sandwich(
    problem: Problem, work: Work, point: ConstantReals, sides: ConstantIntegers, spare: Reals, covariance: Reals
) -> Integer:
    """The covariance (n, n) in the directions that are determined; answers 0 where losses leave some of them free.

    It is calculated along the rows (r, n) of `part`, the factor of `set_covariance`, in which the normal equations are
    the identity. ``spare``: four matrices (n, n), `SUMS` sums, and what a row wants.
    """
    n = problem.n
    rank = work.rank
    curvature = spare[0:]
    spread = spare[n * n :]
    inverse = spare[2 * n * n :]
    information = spare[3 * n * n :]
    sums = spare[4 * n * n :]
    scratch = spare[4 * n * n + SUMS :]
    constants = work.rows.constants
    filled(rank * rank, 0.0, curvature)
    filled(rank * rank, 0.0, spread)
    for around in range(2):
        for b in range(problem.residual_blocks):
            block = problem.blocks[b]
            for u in range(block.unit_count):
                unit = block.units[u]
                if first_with_loss(problem, constants, b, u) == 1:
                    pool(problem, work, point, unit, sums, information, scratch)
                    slope = 1.0
                    if unit.loss != NO_LOSS:
                        slope = curvature_factor(sums[TRACES], sums[TOTAL])
                    factor = slope
                    if around == 1 and unit.loss != NO_LOSS:
                        factor = spread_of_loss(slope * dot(rank * rank, inverse, information), sums)
                    target = curvature if around == 0 else spread
                    add_multiple(rank * rank, factor, information, target)
        if around == 0 and inverted(rank, curvature, inverse) == 0:
            undetermined(n, sides, covariance)
            return 0
    product(rank, rank, rank, inverse, spread, information)
    product(rank, rank, rank, information, inverse, spread)
    product(rank, rank, n, spread, work.part, information)
    sum_of_products(rank, n, work.part, information, covariance)
    return 1
