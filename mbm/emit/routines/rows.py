"""Single rows of the equations: whitened residuals and derivatives, without losses."""

from __future__ import annotations

from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_INDEX,
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
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_PARAMETERS,
    DATA_ROWS,
    DATA_WEIGHTS,
    NONZERO,
    NONZERO_OUTPUT,
    NONZERO_TANGENT,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
    UNIT_MATRIX,
    UNIT_WEIGHTS,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals, call_kernel


def whiten_row(
    system: ConstantIntegers, block: ConstantIntegers, weights: ConstantReals, stride: Integer, raw: ConstantReals,
    target: Reals,
) -> None:  # fmt: skip
    """One value for each output, ``stride`` apart, times the weights of a row; 0 for units that take no part."""
    for u in range(block[BLOCK_UNITS]):
        unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
        first = unit[UNIT_FIRST]
        size = unit[UNIT_LAST] - first
        own = weights[unit[UNIT_WEIGHTS] :]
        for i in range(size):
            total = 0.0
            if own[0] != 0.0 and unit[UNIT_MATRIX] == 0:
                total = own[i] * raw[(first + i) * stride]
            elif own[0] != 0.0:
                for j in range(size):
                    if own[i * size + j] != 0.0:
                        total += own[i * size + j] * raw[(first + j) * stride]
            target[(first + i) * stride] = total


def takes_part(
    system: ConstantIntegers, data: ConstantIntegers, weights: ConstantReals, b: Integer, row: Integer,
    unit: ConstantIntegers,
) -> Integer:  # fmt: skip
    """Whether a unit counts: its first weight is not 0."""
    step = system[system[BLOCKS_AT] + b * BLOCK + BLOCK_WEIGHTS]
    found = 0
    if weights[data[DATA_HEAD + b * DATA_BLOCK + DATA_WEIGHTS] + row * step + unit[UNIT_WEIGHTS]] != 0.0:
        found = 1
    return found


def row_scratch(system: ConstantIntegers) -> Integer:
    """Reals of scratch that `evaluate_row` wants."""
    found = 0
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        lines = system[at + BLOCK_OUTPUTS]
        size = system[at + BLOCK_VARIABLES] + system[at + BLOCK_PARAMETERS] + lines + system[at + BLOCK_NONZEROS]
        size += lines * system[COORDINATES]
        if size > found:
            found = size
    return found


def evaluate_row(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    b: Integer,
    row: Integer,
    scratch: Reals,
    residuals: Reals,
    jacobian: Reals,
) -> None:
    """Row ``row`` of block ``b``: whitened residuals (outputs,) and Jacobian (outputs, n)."""
    n = system[COORDINATES]
    block = system[system[BLOCKS_AT] + b * BLOCK :]
    at = DATA_HEAD + b * DATA_BLOCK
    variables = block[BLOCK_VARIABLES]
    wide = block[BLOCK_PARAMETERS]
    lines = block[BLOCK_OUTPUTS]
    outputs = scratch[variables + wide :]
    plain = scratch[variables + wide + lines + block[BLOCK_NONZEROS] :]
    own = index[data[at + DATA_INDEX] + row * block[BLOCK_INDEX] :]
    for v in range(variables):
        scratch[v] = point[own[v]]
    given = parameters[data[at + DATA_PARAMETERS] + row * wide :]
    for p in range(wide):
        scratch[variables + p] = given[p]
    call_kernel(block[BLOCK_JACOBIAN], scratch, outputs, 1)
    heavy = weights[data[at + DATA_WEIGHTS] + row * block[BLOCK_WEIGHTS] :]
    whiten_row(system, block, heavy, 1, outputs, residuals)
    for i in range(lines * n):
        plain[i] = 0.0
        jacobian[i] = 0.0
    places = columns[data[at + DATA_COLUMNS] + row * block[BLOCK_COLUMNS] :]
    for k in range(block[BLOCK_NONZEROS]):
        nonzero = system[block[BLOCK_NONZEROS_AT] + k * NONZERO :]
        column = places[nonzero[NONZERO_TANGENT]]
        if column >= 0:
            plain[nonzero[NONZERO_OUTPUT] * n + column] += outputs[lines + k]
    for j in range(n):
        whiten_row(system, block, heavy, n, plain[j:], jacobian[j:])


def all_rows(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    slopes: Integer,
    scratch: Reals,
    line: Reals,
    target: Reals,
) -> None:
    """Residuals (m,), or with ``slopes`` 1 their Jacobian (m, n); ``line`` holds one row of either."""
    n = system[COORDINATES]
    first = 0
    for b in range(system[BLOCKS]):
        lines = system[system[BLOCKS_AT] + b * BLOCK + BLOCK_OUTPUTS]
        for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
            evaluate_row(system, data, parameters, weights, index, columns, point, b, row, scratch, line, line[lines:])
            for i in range(lines):
                if slopes == 0:
                    target[first + i] = line[i]
                else:
                    for j in range(n):
                        target[(first + i) * n + j] = line[lines + i * n + j]
            first += lines
