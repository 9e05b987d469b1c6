"""All rows of ``[J r]`` portion by portion: into their triangular factor, a product ``Jᵀ v``, or sums of products.

Normal equations: sums of products of the rows of ``[J r]``, and the triangular factor that follows from them.

They cost a fraction of a factor of the rows themselves, and the square of the condition in accuracy.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_kernel, call_normal, distinct_arrays
from mbm.solver.description import Block, DataBlock, DataSet, Problem
from mbm.solver.equations import (
    first_separate,
    fused_rows,
    gather,
    groups_of,
    penalise_values,
    portion,
    root_values,
    separate_rows,
    weights_width,
    whiten_values,
)
from mbm.solver.linear_algebra import append_rows, cholesky, copied, dot, filled, inverted_upper, solve_transposed
from mbm.solver.slopes import penalise_slopes, root_slopes, scatter, whiten_matrices
from mbm.solver.workspace import Linearisation, Rows, Work

TOGETHER = 256
"""Rows that go into a triangle at a time: with 25 unknowns they take 54 kB, which stay near."""

HARMLESS = 1e6
"""A squared condition up to which sums of products give steps to 1e-9 of their length, and offsets likewise."""

COLUMN = 3
"""The first mode of `sweep` that gives a column."""


@distinct_arrays
def settle_chunk(
    width: Integer,
    rows: Integer,
    stride: Integer,
    mode: Integer,
    settled: Integer,
    vector: ConstantReals,
    chunk: Reals,
    target: Reals,
) -> None:
    """What becomes of a full chunk after ``settled`` rows: rows of the triangle, of the product with the vector, of the
    sums, or of a column.
    """
    if mode >= COLUMN:
        copied(rows, chunk[(mode - COLUMN) * stride :], target[settled:])
        return
    count = rows
    while count % 4 != 0:
        for column in range(width):
            chunk[column * stride + count] = 0.0
        count += 1
    if LANES > 1 and mode == 2:
        add_products(width, count, stride, chunk, target)
        return
    if mode == 0:
        first = 0
        while first < count:
            some = count - first if count - first < TOGETHER else TOGETHER
            append_rows(width, some, stride, chunk[first:], target)
            first += TOGETHER
    else:
        for column in range(width - 1):
            target[column] += dot(rows, chunk[column * stride :], vector[settled:])


def whiten_portion(
    problem: Problem,
    rows: Rows,
    block: Block,
    groups: Integer,
    weights: ConstantReals,
    right: Reals,
    chunk: Reals,
) -> None:
    """What of a portion of observations is not whitened yet, and losses."""
    whiten_values(block, groups, block.outputs + block.nonzero_count, rows.outputs, weights, right)
    whiten_matrices(problem, block, groups, weights, chunk)
    root_slopes(problem, rows.constants, block, groups, right, chunk)
    root_values(rows.constants, block, groups, right)


def slope_portion(
    problem: Problem,
    b: Integer,
    first: Integer,
    groups: Integer,
    rows: Rows,
    inputs: ConstantReals,
    weights: ConstantReals,
    chunk: Reals,
) -> None:
    """Rows of ``[J r]`` of so many kernel blocks from ``first`` on, whose ``inputs`` and ``weights`` these are."""
    n = problem.n
    stride = problem.chunk
    block = problem.blocks[b]
    outputs = rows.outputs
    call_kernel(block.jacobian, inputs, outputs, groups)
    for column in range(n):
        filled(groups * block.outputs * LANES, 0.0, chunk[column * stride :])
    scatter(problem, block, rows.data.blocks[b], first, groups, rows, weights, chunk)
    right = chunk[n * stride :]
    if b < problem.residual_blocks:
        whiten_portion(problem, rows, block, groups, weights, right, chunk)
    else:
        penalise_values(block, groups, block.outputs + block.nonzero_count, outputs, weights, right)
        penalise_slopes(problem, block, groups, weights, right, chunk)


def sweep(
    problem: Problem,
    point: ConstantReals,
    mode: Integer,
    penalised: Integer,
    rows: Rows,
    vector: ConstantReals,
    target: Reals,
) -> None:
    """All rows of ``[J r]`` at a point, with losses; ``penalised`` 0 leaves the constraints out.

    ``mode`` 0: ``target`` becomes their triangular factor (n + 1, n + 1); 1: the product ``Jᵀ vector`` (n,) with a
    vector of residuals; 2: the upper triangle of ``[J r]ᵀ [J r]``, without its last number, is added to zeros there;
    `COLUMN` + j: column j of J, a vector of residuals.
    """
    n = problem.n
    stride = problem.chunk
    inputs = 0
    whitening = 0
    chunk = rows.chunk
    if mode < COLUMN:
        filled((n + 1) * (n + 1) if mode == 0 else n, 0.0, target)
    there = fused_rows(problem, rows, 1, point, stride, chunk) if LANES > 1 else 0
    settled = 0
    begin = first_separate(problem, rows) if LANES > 1 else 0
    for b in range(begin, problem.residual_blocks + penalised * problem.constraint_blocks):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        count = separate_rows(problem, rows, b) if LANES > 1 else part.rows
        lines = block.outputs * LANES
        width = (block.variables + block.parameters) * LANES
        heavy = weights_width(block) * LANES
        gather(block, count, rows.index[part.index :], point, rows.inputs[inputs:])
        first = 0
        if LANES > 1 and mode == 2 and block.normal != 0 and count >= problem.summed_from:
            first = groups_of(count)
            weights = rows.weights[whitening:]
            add_sums(n, block, part, first, rows, rows.inputs[inputs:], weights, target)
        while first < groups_of(count):
            groups = portion(problem, block)
            if first + groups > groups_of(count):
                groups = groups_of(count) - first
            if there + groups * lines > stride:
                settle_chunk(n + 1, there, stride, mode, settled, vector, chunk, target)
                settled += there
                there = 0
            given = rows.inputs[inputs + first * width :]
            weights = rows.weights[whitening + first * heavy :]
            slope_portion(problem, b, first, groups, rows, given, weights, chunk[there:])
            there += groups * lines
            first += groups
        inputs += groups_of(count) * width
        whitening += groups_of(count) * heavy
    if there > 0:
        settle_chunk(n + 1, there, stride, mode, settled, vector, chunk, target)


def summed(problem: Problem, data: DataSet) -> Integer:
    """1 where some block has rows enough for sums of products to be worth while."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        if block.normal != 0 and data.blocks[b].rows >= problem.summed_from:
            return 1
    return 0


def set_triangle(
    problem: Problem,
    place: Linearisation,
    work: Work,
) -> None:
    """The triangle of a place whose point and cost are known: from sums of products while the condition allows it."""
    n = problem.n
    triangle = place.triangle
    if work.summed == 1:
        filled((n + 1) * (n + 1), 0.0, triangle)
        sweep(problem, place.point, 2, work.penalised, work.rows, work.rows.constants, triangle)
        lower = work.lower
        upper = work.inner
        inverse = work.inverse
        place.squared_condition = rooted(n, place.cost, triangle, work.row, lower, upper, inverse)
        if place.squared_condition <= HARMLESS:
            return
        work.summed = 0
    place.squared_condition = 0.0
    sweep(problem, place.point, 0, work.penalised, work.rows, work.rows.constants, triangle)


def add_sums(
    n: Integer,
    block: Block,
    part: DataBlock,
    groups: Integer,
    rows: Rows,
    inputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """The normal equations of a block, added to the upper triangle (n + 1, n + 1)."""
    columns = rows.columns[part.columns :]
    sums = rows.outputs
    tangents = block.tangents
    lower = tangents * (tangents + 1) // 2
    losses = rows.constants[block.units[0].loss_at :]
    filled(lower + tangents + 2, 0.0, sums)
    call_normal(block.normal, inputs, whitening, losses, sums, groups)
    for a in range(tangents):
        row = columns[a]
        if row >= 0:
            target[row * (n + 1) + n] += sums[lower + a]
            for b in range(a + 1):
                column = columns[b]
                value = sums[a * (a + 1) // 2 + b]
                if column == row and a != b:
                    target[row * (n + 1) + row] += 2.0 * value
                elif column >= row:
                    target[row * (n + 1) + column] += value
                elif column >= 0:
                    target[column * (n + 1) + row] += value


@distinct_arrays
def add_products(width: Integer, rows: Integer, stride: Integer, chunk: ConstantReals, target: Reals) -> None:
    """The products of the columns of a chunk, added to the upper triangle (width, width)."""
    for i in range(width - 1):
        for j in range(i, width):
            target[i * width + j] += dot(rows, chunk[i * stride :], chunk[j * stride :])


@distinct_arrays
def rooted(n: Integer, cost: Real, triangle: Reals, scale: Reals, lower: Reals, upper: Reals, inverse: Reals) -> Real:
    """The products in ``triangle`` (n + 1, n + 1) → the factor of ``[J r]``; its squared condition, column by column
    scaled to one, or more. Infinite where they are not positive definite: then the products stay.

    ``cost`` is ``rᵀr``; ``scale`` (n,) and the matrices (n, n) are scratch.
    """
    width = n + 1
    for j in range(n):
        if not triangle[j * width + j] > 0.0:
            return inf
        scale[j] = sqrt(triangle[j * width + j])
    for i in range(n):
        for j in range(i + 1):
            lower[i * n + j] = triangle[j * width + i] / scale[j] / scale[i]
    if cholesky(n, lower) == 0:
        return inf
    for i in range(n):
        for j in range(n):
            upper[i * n + j] = lower[j * n + i] if j >= i else 0.0
    inverted_upper(n, upper, inverse)
    for i in range(n):
        for j in range(n):
            triangle[i * width + j] = upper[i * n + j] * scale[j]
        scale[i] = triangle[i * width + n] / scale[i]
        triangle[n * width + i] = 0.0
    solve_transposed(n, upper, scale)
    rest = cost
    for i in range(n):
        triangle[i * width + n] = scale[i]
        rest -= scale[i] * scale[i]
    triangle[n * width + n] = sqrt(rest) if rest > 0.0 else 0.0
    return float(n) * dot(n * n, inverse, inverse)
