"""Derivatives: rows of ``[J r]`` portion by portion, into their triangular factor or into a product ``Jᵀ v``."""

from __future__ import annotations

from mbm.target.from_python import (
    ConstantIntegers,
    ConstantReals,
    Integer,
    Reals,
    call_kernel,
    distinct_arrays,
)
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_EQUALITY_AT,
    BLOCK_JACOBIAN,
    BLOCK_NONZEROS,
    BLOCK_NONZEROS_AT,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCK_VARIABLES,
    BLOCK_WEIGHTS,
    BLOCKS,
    BLOCKS_AT,
    CHUNK,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_ROWS,
    LANES,
    NO_LOSS,
    NONZERO,
    NONZERO_OUTPUT,
    NONZERO_TANGENT,
    NONZERO_WEIGHT,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
    UNIT_LOSS,
    UNIT_LOSS_AT,
    UNIT_MATRIX,
    UNIT_WEIGHTS,
)
from mbm.target.solver.equations import (
    gather,
    groups_of,
    penalise_values,
    portion,
    root_values,
    square_of,
    weights_width,
    whiten_values,
)
from mbm.target.solver.linear_algebra import append_rows, dot, filled
from mbm.target.solver.losses import root_factor, root_slope
from mbm.target.solver.workspace import chunk_at, inputs_at, outputs_at, weights_at


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
def scatter(
    system: ConstantIntegers,
    block: ConstantIntegers,
    columns: ConstantIntegers,
    first: Integer,
    rows: Integer,
    groups: Integer,
    outputs: ConstantReals,
    whitening: ConstantReals,
    chunk: Reals,
) -> None:
    """Nonzeros of kernel blocks ``first …`` → columns of the chunk; ``rows`` are those of the block in all.

    Those of units with matrices and of constraints are not yet whitened.
    """
    lines = block[BLOCK_OUTPUTS]
    width = (lines + block[BLOCK_NONZEROS]) * LANES
    heavy = block[BLOCK_WEIGHTS] * LANES
    for k in range(block[BLOCK_NONZEROS]):
        nonzero = system[block[BLOCK_NONZEROS_AT] + k * NONZERO :]
        line = nonzero[NONZERO_OUTPUT] * LANES
        weight = nonzero[NONZERO_WEIGHT] * LANES
        values = outputs[(lines + k) * LANES :]
        if block[BLOCK_COLUMNS] == 0:
            column = columns[nonzero[NONZERO_TANGENT]]
            if column >= 0:
                place = column * system[CHUNK] + line
                if weight >= 0:
                    add_to_column(groups, lines * LANES, width, heavy, values, whitening[weight:], chunk[place:])
                else:
                    add_plain_to_column(groups, lines * LANES, width, values, chunk[place:])
        else:
            for group in range(groups):
                for lane in range(LANES):
                    row = (first + group) * LANES + lane
                    column = -1
                    if row < rows:
                        column = columns[row * block[BLOCK_COLUMNS] + nonzero[NONZERO_TANGENT]]
                    if column >= 0:
                        value = values[group * width + lane]
                        if weight >= 0:
                            factor = whitening[group * heavy + weight + lane]
                            value = factor * value if factor != 0.0 else 0.0
                        chunk[column * system[CHUNK] + group * lines * LANES + line + lane] += value


@distinct_arrays
def whiten_matrices(
    system: ConstantIntegers, block: ConstantIntegers, groups: Integer, whitening: ConstantReals, chunk: Reals
) -> None:
    """Rows of units whose weights are matrices, in place: upper or lower triangular ones, so that it can be."""
    lines = block[BLOCK_OUTPUTS]
    heavy = block[BLOCK_WEIGHTS]
    for u in range(block[BLOCK_UNITS]):
        unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
        size = unit[UNIT_LAST] - unit[UNIT_FIRST]
        if unit[UNIT_MATRIX] != 0:
            for column in range(system[COORDINATES]):
                for group in range(groups):
                    place = column * system[CHUNK] + (group * lines + unit[UNIT_FIRST]) * LANES
                    for lane in range(LANES):
                        whiten_unit(
                            size,
                            unit[UNIT_MATRIX],
                            whitening[(group * heavy + unit[UNIT_WEIGHTS]) * LANES + lane :],
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
    system: ConstantIntegers,
    block: ConstantIntegers,
    groups: Integer,
    whitening: ConstantReals,
    penalties: ConstantReals,
    chunk: Reals,
) -> None:
    """Rows of constraints times their factors; those of inequalities without a penalty are zero."""
    lines = block[BLOCK_OUTPUTS]
    for group in range(groups):
        for i in range(lines):
            for lane in range(LANES):
                factor = whitening[(group * 2 * lines + 2 * i) * LANES + lane]
                place = (group * lines + i) * LANES + lane
                if system[block[BLOCK_EQUALITY_AT] + i] == 0 and penalties[place] <= 0.0:
                    factor = 0.0
                for column in range(system[COORDINATES]):
                    at = column * system[CHUNK] + place
                    chunk[at] = factor * chunk[at] if factor != 0.0 else 0.0


@distinct_arrays
def root_slopes(
    system: ConstantIntegers,
    constants: ConstantReals,
    block: ConstantIntegers,
    groups: Integer,
    residuals: ConstantReals,
    chunk: Reals,
) -> None:
    """Rows of ``[J]`` with losses in square-root form: ``q J + 2 q' r (rᵀJ)``; ``residuals`` are the plain ones."""
    lines = block[BLOCK_OUTPUTS]
    for u in range(block[BLOCK_UNITS]):
        unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
        if unit[UNIT_LOSS] != NO_LOSS:
            size = unit[UNIT_LAST] - unit[UNIT_FIRST]
            scale = constants[unit[UNIT_LOSS_AT]]
            shape = constants[unit[UNIT_LOSS_AT] + 1]
            for group in range(groups):
                for lane in range(LANES):
                    place = (group * lines + unit[UNIT_FIRST]) * LANES + lane
                    own = residuals[place:]
                    square = square_of(size, own)
                    factor = root_factor(unit[UNIT_LOSS], square, scale, shape)
                    change = 2.0 * root_slope(unit[UNIT_LOSS], square, scale, shape, factor)
                    for column in range(system[COORDINATES]):
                        rows = chunk[column * system[CHUNK] + place :]
                        along = 0.0
                        for i in range(size):
                            along += own[i * LANES] * rows[i * LANES]
                        for i in range(size):
                            rows[i * LANES] = factor * rows[i * LANES] + change * along * own[i * LANES]


@distinct_arrays
def settle_chunk(
    width: Integer, rows: Integer, stride: Integer, mode: Integer, vector: ConstantReals, chunk: Reals, target: Reals
) -> None:
    """What becomes of a full chunk: rows of the triangle, or of the product with the vector."""
    count = rows
    while count % 4 != 0:
        for column in range(width):
            chunk[column * stride + count] = 0.0
        count += 1
    if mode == 0:
        append_rows(width, count, stride, chunk, target)
    else:
        for column in range(width - 1):
            target[column] += dot(rows, chunk[column * stride :], vector)


def sweep(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    mode: Integer,
    penalised: Integer,
    work: Reals,
    vector: ConstantReals,
    target: Reals,
) -> None:
    """All rows of ``[J r]`` at a point, with losses.

    ``mode`` 0: ``target`` becomes their triangular factor (n + 1, n + 1); 1: the product ``Jᵀ vector`` (n,) with a
    vector of residuals. ``penalised`` 0 leaves the constraints out.
    """
    n = system[COORDINATES]
    stride = system[CHUNK]
    inputs = inputs_at(system)
    whitening = weights_at(system)
    outputs = work[outputs_at(system) :]
    chunk = work[chunk_at(system) :]
    if mode == 0:
        filled((n + 1) * (n + 1), 0.0, target)
    else:
        filled(n, 0.0, target)
    there = 0
    settled = 0
    for b in range(system[BLOCKS] + penalised * system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = data[at + DATA_ROWS]
        lines = block[BLOCK_OUTPUTS] * LANES
        width = (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS]) * LANES
        heavy = weights_width(block) * LANES
        own = columns[data[at + DATA_COLUMNS] :]
        gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
        first = 0
        while first < groups_of(rows):
            groups = portion(system, block)
            if first + groups > groups_of(rows):
                groups = groups_of(rows) - first
            if there + groups * lines > stride:
                settle_chunk(n + 1, there, stride, mode, vector[settled:], chunk, target)
                settled += there
                there = 0
            call_kernel(block[BLOCK_JACOBIAN], work[inputs + first * width :], outputs, groups)
            weights = work[whitening + first * heavy :]
            for column in range(n):
                filled(groups * lines, 0.0, chunk[column * stride + there :])
            scatter(system, block, own, first, rows, groups, outputs, weights, chunk[there:])
            right = chunk[n * stride + there :]
            every = block[BLOCK_OUTPUTS] + block[BLOCK_NONZEROS]
            if b < system[BLOCKS]:
                whiten_values(system, block, groups, every, outputs, weights, right)
                whiten_matrices(system, block, groups, weights, chunk[there:])
                root_slopes(system, constants, block, groups, right, chunk[there:])
                root_values(system, constants, block, groups, right)
            else:
                penalise_values(system, block, groups, every, outputs, weights, right)
                penalise_slopes(system, block, groups, weights, right, chunk[there:])
            there += groups * lines
            first += groups
        inputs += groups_of(rows) * width
        whitening += groups_of(rows) * heavy
    if there > 0:
        settle_chunk(n + 1, there, stride, mode, vector[settled:], chunk, target)


ROUTINES = (
    add_to_column,
    add_plain_to_column,
    scatter,
    whiten_unit,
    whiten_matrices,
    penalise_slopes,
    root_slopes,
    settle_chunk,
    sweep,
)
