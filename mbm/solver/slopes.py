"""Derivatives: nonzeros of the Jacobian → whitened rows of ``[J r]``, with losses in square-root form."""

from __future__ import annotations

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals, distinct_arrays
from mbm.solver.description import NO_LOSS, Block, DataBlock, Problem
from mbm.solver.equations import square_of
from mbm.solver.losses import root_factor, root_slope
from mbm.solver.workspace import Rows


@distinct_arrays
def add_to_column(
    groups: Integer,
    rows: Integer,
    width: Integer,
    heavy: Integer,
    values: ConstantReals,
    weights: ConstantReals,
    column: Reals,
) -> None:
    """One nonzero of all rows, times its weight, into one column."""
    for group in range(groups):
        for lane in range(LANES):
            weight = weights[group * heavy + lane]
            value = weight * values[group * width + lane]
            column[group * rows + lane] += value if weight != 0.0 else 0.0


@distinct_arrays
def add_plain_to_column(groups: Integer, rows: Integer, width: Integer, values: ConstantReals, column: Reals) -> None:
    """One nonzero of all rows into one column."""
    for group in range(groups):
        for lane in range(LANES):
            column[group * rows + lane] += values[group * width + lane]


@distinct_arrays
def add_to_columns(
    block: Block,
    k: Integer,
    rows: Integer,
    columns: ConstantIntegers,
    outputs: ConstantReals,
    whitening: ConstantReals,
    stride: Integer,
    chunk: Reals,
) -> None:
    """Nonzero ``k`` of so many rows, times its weight, each into the column that its row says."""
    lines = block.outputs
    width = (lines + block.nonzero_count) * LANES
    heavy = block.weights * LANES
    step = block.columns
    nonzero = block.nonzeros[k]
    tangent = nonzero.tangent
    line = nonzero.output * LANES
    weight = nonzero.weight * LANES
    values = outputs[(lines + k) * LANES :]
    for row in range(rows):
        column = columns[row * step + tangent]
        group = row // LANES
        lane = row % LANES
        if column >= 0:
            value = values[group * width + lane]
            if weight >= 0:
                factor = whitening[group * heavy + weight + lane]
                value = factor * value if factor != 0.0 else 0.0
            chunk[column * stride + group * lines * LANES + line + lane] += value


@distinct_arrays
def scatter(
    problem: Problem,
    block: Block,
    part: DataBlock,
    first: Integer,
    groups: Integer,
    rows: Rows,
    whitening: ConstantReals,
    chunk: Reals,
) -> None:
    """Nonzeros of kernel blocks ``first …`` of the block's ``part`` of the rows → columns of the chunk.

    Those of units with matrices and of constraints are not yet whitened.
    """
    columns = rows.columns[part.columns :]
    outputs = rows.outputs
    lines = block.outputs
    width = (lines + block.nonzero_count) * LANES
    heavy = block.weights * LANES
    step = block.columns
    stride = problem.chunk
    for k in range(block.nonzero_count):
        nonzero = block.nonzeros[k]
        line = nonzero.output * LANES
        weight = nonzero.weight * LANES
        tangent = nonzero.tangent
        values = outputs[(lines + k) * LANES :]
        if step == 0:
            column = columns[tangent]
            if column >= 0:
                place = column * stride + line
                if weight >= 0:
                    add_to_column(groups, lines * LANES, width, heavy, values, whitening[weight:], chunk[place:])
                else:
                    add_plain_to_column(groups, lines * LANES, width, values, chunk[place:])
        else:
            before = first * LANES
            count = groups * LANES
            if before + count > part.rows:
                count = part.rows - before
            add_to_columns(block, k, count, columns[before * step :], outputs, whitening, stride, chunk)


@distinct_arrays
def whiten_matrices(problem: Problem, block: Block, groups: Integer, whitening: ConstantReals, chunk: Reals) -> None:
    """Rows of units whose weights are matrices, in place: upper or lower triangular ones, so that it can be."""
    lines = block.outputs
    heavy = block.weights
    for u in range(block.unit_count):
        unit = block.units[u]
        size = unit.last - unit.first
        if unit.matrix != 0:
            for column in range(problem.n):
                for group in range(groups):
                    place = column * problem.chunk + (group * lines + unit.first) * LANES
                    for lane in range(LANES):
                        whiten_unit(
                            size,
                            unit.matrix,
                            whitening[(group * heavy + unit.weights) * LANES + lane :],
                            chunk[place + lane :],
                        )


@distinct_arrays
def whiten_unit(size: Integer, kind: Integer, weights: ConstantReals, values: Reals) -> None:
    """``W v`` in place for a lower (``kind`` 1) or upper (2) triangular W, of one lane."""
    for step in range(size):
        i = size - 1 - step
        first = 0
        last = i + 1
        if kind == 2:
            i = step
            first = i
            last = size
        total = 0.0
        for j in range(first, last):
            weight = weights[(i * size + j) * LANES]
            if weight != 0.0:
                total += weight * values[j * LANES]
        values[i * LANES] = total


@distinct_arrays
def penalise_slopes(
    problem: Problem,
    block: Block,
    groups: Integer,
    whitening: ConstantReals,
    penalties: ConstantReals,
    chunk: Reals,
) -> None:
    """Rows of constraints times their factors; those of inequalities without a penalty are zero."""
    lines = block.outputs
    for group in range(groups):
        for i in range(lines):
            for lane in range(LANES):
                factor = whitening[(group * 2 * lines + 2 * i) * LANES + lane]
                place = (group * lines + i) * LANES + lane
                if block.equality[i] == 0 and penalties[place] <= 0.0:
                    factor = 0.0
                for column in range(problem.n):
                    at = column * problem.chunk + place
                    chunk[at] = factor * chunk[at] if factor != 0.0 else 0.0


@distinct_arrays
def root_slopes(
    problem: Problem,
    constants: ConstantReals,
    block: Block,
    groups: Integer,
    residuals: ConstantReals,
    chunk: Reals,
) -> None:
    """Rows of ``[J]`` with losses in square-root form: ``q J + 2 q' r (rᵀJ)``; ``residuals`` are the plain ones."""
    lines = block.outputs
    for u in range(block.unit_count):
        unit = block.units[u]
        if unit.loss != NO_LOSS:
            size = unit.last - unit.first
            scale = constants[unit.loss_at]
            shape = constants[unit.loss_at + 1]
            for group in range(groups):
                for lane in range(LANES):
                    place = (group * lines + unit.first) * LANES + lane
                    own = residuals[place:]
                    square = square_of(size, own)
                    factor = root_factor(unit.loss, square, scale, shape)
                    change = 2.0 * root_slope(unit.loss, square, scale, shape, factor)
                    for column in range(problem.n):
                        rows = chunk[column * problem.chunk + place :]
                        along = 0.0
                        for i in range(size):
                            along += own[i * LANES] * rows[i * LANES]
                        for i in range(size):
                            rows[i * LANES] = factor * rows[i * LANES] + change * along * own[i * LANES]
