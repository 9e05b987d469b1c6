"""Derivatives: nonzeros of the Jacobian → whitened rows of ``[J r]``, with losses in square-root form."""

from __future__ import annotations

from mbm.target.solver.description import (
    BLOCK_COLUMNS,
    BLOCK_EQUALITY_AT,
    BLOCK_NONZEROS,
    BLOCK_NONZEROS_AT,
    BLOCK_OUTPUTS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCK_WEIGHTS,
    CHUNK,
    COORDINATES,
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
    square_of,
)
from mbm.target.solver.losses import root_factor, root_slope
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals, distinct_arrays


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
