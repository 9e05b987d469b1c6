"""The covariance of estimates with losses: the sandwich ``H⁻¹ G H⁻¹`` of `mbm.solver.loss_spread`."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.emit.routines.rows import evaluate_row, row_scratch, takes_part
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.covariance import undetermined
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
from mbm.solver.loss_spread import curvature_factor, loss_trace, spread_factor
from mbm.solver.losses import loss_weight
from mbm.solver.workspace import Rows

TOTAL = 0
TRACES = 1
SQUARED_TRACES = 2
SPREAD = 3
COUNT = 4
STATED = 5
SUMS = 6

LEAST_PIVOT = 1e-15
"""Of a matrix scaled to a unit diagonal: below, it is singular but for rounding."""


def same_loss(constants: ConstantReals, unit: Unit, other: Unit) -> Integer:
    """Whether two units have the same loss."""
    if unit.loss != other.loss:
        return 0
    if unit.loss == NO_LOSS:
        return 1
    a = unit.loss_at
    b = other.loss_at
    return 1 if constants[a] == constants[b] and constants[a + 1] == constants[b + 1] else 0


def first_with_loss(problem: Problem, constants: ConstantReals, number: Integer, own: Integer) -> Integer:
    """Whether no unit before unit ``own`` of block ``number`` has the same loss."""
    unit = problem.blocks[number].units[own]
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            if b == number and u == own:
                return 1
            if same_loss(constants, block.units[u], unit) == 1:
                return 0
    return 1


def add_to_pool(
    unit: Unit,
    n: Integer,
    constants: ConstantReals,
    stated: Integer,
    residuals: ConstantReals,
    slopes: ConstantReals,
    sums: Reals,
    information: Reals,
) -> None:
    """Add what a unit with ``residuals`` (size,) and ``slopes`` (size, n) gives to the sums."""
    size = unit.last - unit.first
    kind = unit.loss
    square = dot(size, residuals, residuals)
    weight = 1.0
    trace = float(size)
    if kind != NO_LOSS:
        scale = constants[unit.loss_at]
        shape = constants[unit.loss_at + 1]
        weight = loss_weight(kind, square, scale, shape)
        trace = loss_trace(kind, square, scale, shape, size)
    sums[TOTAL] += float(size) * weight
    if stated == 1:
        sums[STATED] += float(size) * weight
    sums[SPREAD] += weight * weight * square
    sums[COUNT] += float(size)
    sums[TRACES] += trace
    sums[SQUARED_TRACES] += trace * trace / float(size)
    for i in range(size):
        for j in range(n):
            add_multiple(n, weight * slopes[i * n + j], slopes[i * n :], information[j * n :])


def pool(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    loss: Unit,
    sums: Reals,
    information: Reals,
    scratch: Reals,
) -> None:
    """The sums over all units with the loss of the unit ``loss``, and A (n, n)."""
    n = problem.n
    line = scratch[row_scratch(problem) :]
    filled(SUMS, 0.0, sums)
    filled(n * n, 0.0, information)
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
                        slopes = line[lines + unit.first * n :]
                        add_to_pool(unit, n, rows.constants, stated, line[unit.first :], slopes, sums, information)


def inverted(n: Integer, matrix: Reals, scale: Reals, inverse: Reals) -> Integer:
    """The inverse of a symmetric positive definite matrix, scaled to a unit diagonal; 0 where it is none.

    ``matrix`` becomes its factor.
    """
    for i in range(n):
        if not matrix[i * n + i] > 0.0:
            return 0
        scale[i] = 1.0 / sqrt(matrix[i * n + i])
    for i in range(n):
        for j in range(n):
            matrix[i * n + j] *= scale[i] * scale[j]
    if cholesky(n, matrix) == 0:
        return 0
    for i in range(n):
        if not matrix[i * n + i] * matrix[i * n + i] > LEAST_PIVOT:
            return 0
    filled(n * n, 0.0, inverse)
    for i in range(n):
        row = inverse[i * n :]
        row[i] = scale[i]
        solve_lower(n, matrix, row)
        solve_lower_transposed(n, matrix, row)
        for j in range(n):
            row[j] *= scale[j]
    return 1


def inverted_along(
    n: Integer, rank: Integer, factor: ConstantReals, matrix: Reals, scale: Reals, part: Reals, inverse: Reals
) -> Integer:
    """``Fᵀ (F M Fᵀ)⁻¹ F`` of a symmetric M (n, n), F (rank, n): the inverse in the directions of F; 0: there is none.

    ``matrix`` and ``part`` (n, n) are scratch afterwards.
    """
    product(rank, n, n, factor, matrix, part)
    for a in range(rank):
        for b in range(rank):
            matrix[a * rank + b] = dot(n, part[a * n :], factor[b * n :])
    if inverted(rank, matrix, scale, part) == 0:
        return 0
    product(rank, rank, n, part, factor, matrix)
    sum_of_products(rank, n, factor, matrix, inverse)
    return 1


def freed_of(n: Integer, sides: ConstantIntegers, matrix: Reals) -> None:
    """Rows and columns of coordinates that a bound holds become those of the identity."""
    for i in range(n):
        for j in range(n):
            if sides[i] != 0 or sides[j] != 0:
                matrix[i * n + j] = 1.0 if i == j else 0.0


def sandwich(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    sides: ConstantIntegers,
    rank: Integer,
    directions: ConstantReals,
    spare: Reals,
    covariance: Reals,
) -> Integer:
    """The covariance (n, n), 0 for what bounds hold; answers 0 where there is none.

    ``rank`` below the number of coordinates: it is that in the ``directions`` (rank, n); -1: in all.
    ``spare``: four matrices (n, n), a vector (n,), `SUMS` sums, and what a row wants.
    """
    n = problem.n
    curvature = spare[0:]
    spread = spare[n * n :]
    inverse = spare[2 * n * n :]
    information = spare[3 * n * n :]
    sums = spare[4 * n * n :]
    scale = spare[4 * n * n + SUMS :]
    scratch = spare[4 * n * n + SUMS + n :]
    filled(n * n, 0.0, curvature)
    filled(n * n, 0.0, spread)
    good = 1
    for around in range(2):
        for b in range(problem.residual_blocks):
            block = problem.blocks[b]
            for u in range(block.unit_count):
                unit = block.units[u]
                if first_with_loss(problem, rows.constants, b, u) == 1:
                    pool(problem, rows, point, unit, sums, information, scratch)
                    slope = 1.0
                    if unit.loss != NO_LOSS:
                        slope = curvature_factor(sums[TRACES], sums[TOTAL])
                    factor = slope
                    if around == 1 and unit.loss != NO_LOSS:
                        factor = spread_of_loss(share_of_loss(n, slope, inverse, information, sides), sums)
                    target = curvature if around == 0 else spread
                    add_multiple(n * n, factor, information, target)
        if around == 0:
            if rank < 0:
                freed_of(n, sides, curvature)
                good = inverted(n, curvature, scale, inverse)
            else:
                good = inverted_along(n, rank, directions, curvature, scale, information, inverse)
            if good == 0:
                undetermined(n, sides, covariance)
                return 0
    put_between(n, sides, inverse, spread, information, covariance)
    return good


def put_between(
    n: Integer,
    sides: ConstantIntegers,
    inverse: ConstantReals,
    spread: ConstantReals,
    spare: Reals,
    covariance: Reals,
) -> None:
    """``inverse spread inverse`` (n, n) of the coordinates that no bound holds; 0 for the others.

    The inverse has nothing between the one and the others.
    """
    product(n, n, n, inverse, spread, spare)
    product(n, n, n, spare, inverse, covariance)
    for i in range(n):
        for j in range(n):
            if sides[i] != 0 or sides[j] != 0:
                covariance[i * n + j] = 0.0


def share_of_loss(
    n: Integer, slope: Real, inverse: ConstantReals, information: ConstantReals, sides: ConstantIntegers
) -> Real:
    """The unknowns that a loss's units determine: ``slope tr H⁻¹A`` of the coordinates that no bound holds."""
    share = 0.0
    for i in range(n):
        for j in range(n):
            if sides[i] == 0 and sides[j] == 0:
                share += slope * inverse[i * n + j] * information[j * n + i]
    return share


def spread_of_loss(share: Real, sums: ConstantReals) -> Real:
    """The factor of A in G."""
    found = spread_factor(
        share, sums[TOTAL], sums[TRACES], sums[SQUARED_TRACES], sums[SPREAD], sums[COUNT], sums[STATED]
    )
    return fabs(found)  # it is not negative
