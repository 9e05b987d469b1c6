"""Rows → kernels → whitening → losses → residuals, or the triangular factor of ``[J r]``.

Rows go through in portions that stay in the cache. Residual (row, output) of a block stands at
``(row // LANES · outputs + output) · LANES + row % LANES`` behind those of the blocks before it; lanes beyond the last
row repeat it with weight 0.
"""

from __future__ import annotations

from mbm.target.solver.description import (
    BLOCK,
    BLOCK_EQUALITY_AT,
    BLOCK_INDEX,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCK_VALUES,
    BLOCK_VARIABLES,
    BLOCK_WEIGHTS,
    BLOCKS,
    BLOCKS_AT,
    CHUNK,
    CONSTRAINTS,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_INDEX,
    DATA_PARAMETERS,
    DATA_ROWS,
    DATA_WEIGHTS,
    LANES,
    NO_LOSS,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
    UNIT_LOSS,
    UNIT_LOSS_AT,
    UNIT_MATRIX,
    UNIT_WEIGHTS,
)
from mbm.target.solver.losses import root_factor
from mbm.target.solver.united import first_apart, rows_apart, unite, united_rows
from mbm.target.solver.workspace import inputs_at, outputs_at, weights_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals, call_kernel, distinct_arrays


def portion(system: ConstantIntegers, block: ConstantIntegers) -> Integer:
    """How many kernel blocks go through at a time: as many as fill a chunk."""
    return system[CHUNK] // (LANES * block[BLOCK_OUTPUTS])


def groups_of(rows: Integer) -> Integer:
    """Kernel blocks of so many rows."""
    return (rows + LANES - 1) // LANES


def weights_width(block: ConstantIntegers) -> Integer:
    """Numbers that whiten a row; for constraints a factor and a shift for each output."""
    found = block[BLOCK_WEIGHTS]
    if found == 0:
        found = 2 * block[BLOCK_OUTPUTS]
    return found


@distinct_arrays
def load_block(
    block: ConstantIntegers,
    rows: Integer,
    parameters: ConstantReals,
    weights: ConstantReals,
    inputs: Reals,
    whitening: Reals,
) -> None:
    """Parameters and weights of one block, from row after row to lane after lane."""
    variables = block[BLOCK_VARIABLES]
    wide = block[BLOCK_PARAMETERS]
    heavy = block[BLOCK_WEIGHTS]
    for group in range(groups_of(rows)):
        for lane in range(LANES):
            row = group * LANES + lane
            live = 1.0
            if row >= rows:
                row = rows - 1
                live = 0.0
            for p in range(wide):
                inputs[(group * (variables + wide) + variables + p) * LANES + lane] = parameters[row * wide + p]
            for w in range(heavy):
                whitening[(group * heavy + w) * LANES + lane] = live * weights[row * heavy + w]


@distinct_arrays
def load_rows(
    system: ConstantIntegers, data: ConstantIntegers, parameters: ConstantReals, weights: ConstantReals, work: Reals
) -> None:
    """Everything of a data set that does not depend on the point, as the kernels and the whitening take it."""
    if LANES > 1:
        unite(system, data, parameters, weights, work)
    inputs = inputs_at(system)
    whitening = weights_at(system)
    for b in range(first_apart(system, work) if LANES > 1 else 0, system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[at + DATA_ROWS]
        load_block(
            block,
            rows,
            parameters[data[at + DATA_PARAMETERS] :],
            weights[data[at + DATA_WEIGHTS] :],
            work[inputs:],
            work[whitening:],
        )
        inputs += groups_of(rows) * LANES * (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS])
        whitening += groups_of(rows) * LANES * weights_width(block)


@distinct_arrays
def gather(
    block: ConstantIntegers, rows: Integer, index: ConstantIntegers, point: ConstantReals, inputs: Reals
) -> None:
    """Put the numbers of the point into the kernels' inputs."""
    if rows == 0:
        return
    variables = block[BLOCK_VARIABLES]
    step = block[BLOCK_INDEX]
    width = (variables + block[BLOCK_PARAMETERS]) * LANES
    for v in range(variables):
        if step == 0:
            value = point[index[v]]
            for group in range(groups_of(rows)):
                for lane in range(LANES):
                    inputs[group * width + v * LANES + lane] = value
        else:
            for group in range(groups_of(rows)):
                for lane in range(LANES):
                    row = group * LANES + lane
                    if row >= rows:
                        row = rows - 1
                    inputs[group * width + v * LANES + lane] = point[index[row * step + v]]


@distinct_arrays
def whiten_values(
    system: ConstantIntegers,
    block: ConstantIntegers,
    groups: Integer,
    width: Integer,
    outputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """Outputs (``width`` numbers a row in ``outputs``) → whitened residuals without losses, 0 where the weight is 0."""
    rows = block[BLOCK_OUTPUTS]
    heavy = block[BLOCK_WEIGHTS]
    for u in range(block[BLOCK_UNITS]):
        unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
        first = unit[UNIT_FIRST]
        size = unit[UNIT_LAST] - first
        for i in range(size):
            if unit[UNIT_MATRIX] == 0:
                for group in range(groups):
                    for lane in range(LANES):
                        weight = whitening[(group * heavy + unit[UNIT_WEIGHTS] + i) * LANES + lane]
                        value = weight * outputs[(group * width + first + i) * LANES + lane]
                        target[(group * rows + first + i) * LANES + lane] = value if weight != 0.0 else 0.0
            else:
                for group in range(groups):
                    for lane in range(LANES):
                        total = 0.0
                        for j in range(size):
                            at = group * heavy + unit[UNIT_WEIGHTS] + i * size + j
                            weight = whitening[at * LANES + lane]
                            if weight != 0.0:
                                total += weight * outputs[(group * width + first + j) * LANES + lane]
                        target[(group * rows + first + i) * LANES + lane] = total


@distinct_arrays
def penalise_values(
    system: ConstantIntegers,
    block: ConstantIntegers,
    groups: Integer,
    width: Integer,
    outputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """Constraint values → penalties ``factor · c + shift``, of inequalities only where positive."""
    rows = block[BLOCK_OUTPUTS]
    for group in range(groups):
        for i in range(rows):
            for lane in range(LANES):
                factor = whitening[(group * 2 * rows + 2 * i) * LANES + lane]
                value = factor * outputs[(group * width + i) * LANES + lane]
                value += whitening[(group * 2 * rows + 2 * i + 1) * LANES + lane]
                if factor == 0.0 or (system[block[BLOCK_EQUALITY_AT] + i] == 0 and value <= 0.0):
                    value = 0.0
                target[(group * rows + i) * LANES + lane] = value


@distinct_arrays
def square_of(size: Integer, residuals: ConstantReals) -> Real:
    """The squared norm of a unit in one lane."""
    total = 0.0
    for i in range(size):
        total += residuals[i * LANES] * residuals[i * LANES]
    return total


def root_values(
    system: ConstantIntegers, constants: ConstantReals, block: ConstantIntegers, groups: Integer, residuals: Reals
) -> None:
    """Losses in square-root form, in place."""
    rows = block[BLOCK_OUTPUTS]
    for u in range(block[BLOCK_UNITS]):
        unit = system[block[BLOCK_UNITS_AT] + u * UNIT :]
        if unit[UNIT_LOSS] != NO_LOSS:
            size = unit[UNIT_LAST] - unit[UNIT_FIRST]
            scale = constants[unit[UNIT_LOSS_AT]]
            shape = constants[unit[UNIT_LOSS_AT] + 1]
            for group in range(groups):
                for lane in range(LANES):
                    own = residuals[(group * rows + unit[UNIT_FIRST]) * LANES + lane :]
                    factor = root_factor(unit[UNIT_LOSS], square_of(size, own), scale, shape)
                    for i in range(size):
                        own[i * LANES] *= factor


def residuals_at_point(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    point: ConstantReals,
    lossy: Integer,
    penalised: Integer,
    work: Reals,
    target: Reals,
) -> Integer:
    """All residuals at a point; how many numbers of ``target`` they take, a multiple of 4.

    ``lossy`` 0 leaves the losses out, ``penalised`` 0 the constraints.
    """
    inputs = inputs_at(system)
    whitening = weights_at(system)
    outputs = work[outputs_at(system) :]
    done = united_rows(system, 0, point, 0, work, target) if LANES > 1 else 0
    for b in range(first_apart(system, work) if LANES > 1 else 0, system[BLOCKS] + penalised * system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[at + DATA_ROWS]
        width = (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS]) * LANES
        heavy = weights_width(block) * LANES
        gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
        most = portion(system, block)
        first = 0
        while first < groups_of(rows):
            groups = most
            if first + groups > groups_of(rows):
                groups = groups_of(rows) - first
            call_kernel(block[BLOCK_VALUES], work[inputs + first * width :], outputs, groups)
            whitening_here = work[whitening + first * heavy :]
            if b < system[BLOCKS]:
                whiten_values(system, block, groups, block[BLOCK_OUTPUTS], outputs, whitening_here, target[done:])
                if lossy == 1:
                    root_values(system, constants, block, groups, target[done:])
            else:
                penalise_values(system, block, groups, block[BLOCK_OUTPUTS], outputs, whitening_here, target[done:])
            done += groups * LANES * block[BLOCK_OUTPUTS]
            first += groups
        inputs += groups_of(rows) * width
        whitening += groups_of(rows) * heavy
    while done % 4 != 0:
        target[done] = 0.0
        done += 1
    return done
