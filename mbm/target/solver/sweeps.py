"""All rows of ``[J r]`` portion by portion: into their triangular factor, a product ``Jᵀ v``, or sums of products."""

from __future__ import annotations

from mbm.target.solver.description import (
    BLOCK,
    BLOCK_JACOBIAN,
    BLOCK_NONZEROS,
    BLOCK_NORMAL,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_VARIABLES,
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
    SUMMED_FROM,
)
from mbm.target.solver.equations import (
    gather,
    groups_of,
    penalise_values,
    portion,
    root_values,
    weights_width,
    whiten_values,
)
from mbm.target.solver.linear_algebra import append_rows, dot, filled
from mbm.target.solver.normal_equations import add_products, add_sums, rooted
from mbm.target.solver.slopes import penalise_slopes, root_slopes, scatter, whiten_matrices
from mbm.target.solver.united import first_apart, rows_apart, united_rows
from mbm.target.solver.workspace import (
    AT_COST,
    AT_POINT,
    AT_SQUARE,
    PENALISED,
    SUMMED,
    chunk_at,
    inputs_at,
    matrix_at,
    outputs_at,
    place_at,
    scalars_at,
    step_at,
    triangle_at,
    weights_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals, call_kernel, distinct_arrays

HARMLESS = 1e6
"""A squared condition up to which sums of products give steps to 1e-9 of their length, and offsets likewise."""


@distinct_arrays
def settle_chunk(
    width: Integer, rows: Integer, stride: Integer, mode: Integer, vector: ConstantReals, chunk: Reals, target: Reals
) -> None:
    """What becomes of a full chunk: rows of the triangle, of the product with the vector, or of the sums."""
    count = rows
    while count % 4 != 0:
        for column in range(width):
            chunk[column * stride + count] = 0.0
        count += 1
    if LANES > 1 and mode == 2:
        add_products(width, count, stride, chunk, target)
        return
    if mode == 0:
        append_rows(width, count, stride, chunk, target)
    else:
        for column in range(width - 1):
            target[column] += dot(rows, chunk[column * stride :], vector)


def whiten_portion(
    system: ConstantIntegers,
    constants: ConstantReals,
    block: ConstantIntegers,
    groups: Integer,
    width: Integer,
    outputs: ConstantReals,
    weights: ConstantReals,
    right: Reals,
    chunk: Reals,
) -> None:
    """What of a portion of observations is not whitened yet, and losses; ``width`` numbers a row in ``outputs``."""
    whiten_values(system, block, groups, width, outputs, weights, right)
    whiten_matrices(system, block, groups, weights, chunk)
    root_slopes(system, constants, block, groups, right, chunk)
    root_values(system, constants, block, groups, right)


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
    """All rows of ``[J r]`` at a point, with losses; ``penalised`` 0 leaves the constraints out.

    ``mode`` 0: ``target`` becomes their triangular factor (n + 1, n + 1); 1: the product ``Jᵀ vector`` (n,) with a
    vector of residuals; 2: the upper triangle of ``[J r]ᵀ [J r]``, without its last number, is added to zeros there.
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
    there = united_rows(system, 1, point, stride, work, chunk) if LANES > 1 else 0
    settled = 0
    for b in range(first_apart(system, work) if LANES > 1 else 0, system[BLOCKS] + penalised * system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[at + DATA_ROWS]
        lines = block[BLOCK_OUTPUTS] * LANES
        width = (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS]) * LANES
        heavy = weights_width(block) * LANES
        own = columns[data[at + DATA_COLUMNS] :]
        gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
        first = 0
        if LANES > 1 and mode == 2 and block[BLOCK_NORMAL] != 0 and rows >= system[SUMMED_FROM]:
            first = groups_of(rows)
            add_sums(n, constants, system, block, own, first, work[inputs:], work[whitening:], outputs, target)
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
                whiten_portion(system, constants, block, groups, every, outputs, weights, right, chunk[there:])
            else:
                penalise_values(system, block, groups, every, outputs, weights, right)
                penalise_slopes(system, block, groups, weights, right, chunk[there:])
            there += groups * lines
            first += groups
        inputs += groups_of(rows) * width
        whitening += groups_of(rows) * heavy
    if there > 0:
        settle_chunk(n + 1, there, stride, mode, vector[settled:], chunk, target)


def summed(system: ConstantIntegers, data: ConstantIntegers) -> Integer:
    """1 where some block has rows enough for sums of products to be worth while."""
    for b in range(system[BLOCKS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        if block[BLOCK_NORMAL] != 0 and data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS] >= system[SUMMED_FROM]:
            return 1
    return 0


def set_triangle(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    number: Integer,
    work: Reals,
    flags: Integers,
) -> None:
    """The triangle of a place whose point and cost are known: from sums of products while the condition allows it."""
    n = system[COORDINATES]
    place = work[place_at(system, number) :]
    point = place[AT_POINT:]
    triangle = place[triangle_at(system) :]
    scalars = work[scalars_at(system) :]
    if flags[SUMMED] == 1:
        filled((n + 1) * (n + 1), 0.0, triangle)
        sweep(system, constants, data, index, columns, point, 2, flags[PENALISED], work, scalars, triangle)
        lower = work[matrix_at(system, 1) :]
        upper = work[matrix_at(system, 2) :]
        inverse = work[matrix_at(system, 3) :]
        place[AT_SQUARE] = rooted(n, place[AT_COST], triangle, work[step_at(system, 15) :], lower, upper, inverse)
        if place[AT_SQUARE] <= HARMLESS:
            return
        flags[SUMMED] = 0
    place[AT_SQUARE] = 0.0
    sweep(system, constants, data, index, columns, point, 0, flags[PENALISED], work, scalars, triangle)
