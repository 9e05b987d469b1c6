"""Values and derivatives of the constraints at a point, and the units in which their violations count."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.target.decisions import EPSILON, ROUNDING_ERRORS
from mbm.target.solver.beginning import constraint_count
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_JACOBIAN,
    BLOCK_NONZEROS,
    BLOCK_NONZEROS_AT,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_VARIABLES,
    BLOCKS,
    BLOCKS_AT,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_ROWS,
    LANES,
    NONZERO,
    NONZERO_OUTPUT,
    NONZERO_TANGENT,
    PLACES_AT,
)
from mbm.target.solver.equations import gather, groups_of, portion
from mbm.target.solver.linear_algebra import filled
from mbm.target.solver.united import rows_apart
from mbm.target.solver.workspace import (
    NORMS,
    ROUNDINGS,
    UNITS,
    VALUES,
    X,
    inputs_at,
    multipliers_at,
    outputs_at,
    slopes_at,
    vector_at,
)
from mbm.target.words import (
    ConstantIntegers,
    ConstantReals,
    Integer,
    Reals,
    call_kernel,
    distinct_arrays,
)


@distinct_arrays
def add_slopes(
    system: ConstantIntegers,
    block: ConstantIntegers,
    columns: ConstantIntegers,
    first: Integer,
    rows: Integer,
    outputs: ConstantReals,
    values: Reals,
    slopes: Reals,
) -> None:
    """Values and derivatives of the constraints of one portion: row by row, output by output."""
    n = system[COORDINATES]
    lines = block[BLOCK_OUTPUTS]
    width = lines + block[BLOCK_NONZEROS]
    for row in range(rows):
        group = row // LANES
        lane = row % LANES
        for i in range(lines):
            values[row * lines + i] = outputs[(group * width + i) * LANES + lane]
        for k in range(block[BLOCK_NONZEROS]):
            nonzero = system[block[BLOCK_NONZEROS_AT] + k * NONZERO :]
            column = columns[(first + row) * block[BLOCK_COLUMNS] + nonzero[NONZERO_TANGENT]]
            if column >= 0:
                value = outputs[(group * width + lines + k) * LANES + lane]
                slopes[(row * lines + nonzero[NONZERO_OUTPUT]) * n + column] += value


def linearise(
    system: ConstantIntegers,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    work: Reals,
) -> None:
    """Values and slopes of all constraints at a point."""
    n = system[COORDINATES]
    values = work[multipliers_at(system, VALUES) :]
    slopes = work[slopes_at(system) :]
    outputs = work[outputs_at(system) :]
    filled(constraint_count(system, data) * n, 0.0, slopes)
    inputs = inputs_at(system)
    done = 0
    for b in range(system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[at + DATA_ROWS]
        width = (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS]) * LANES
        if b >= system[BLOCKS]:
            gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
            first = 0
            while first < rows:
                count = portion(system, block) * LANES
                if first + count > rows:
                    count = rows - first
                call_kernel(block[BLOCK_JACOBIAN], work[inputs + first // LANES * width :], outputs, groups_of(count))
                own = columns[data[at + DATA_COLUMNS] :]
                add_slopes(system, block, own, first, count, outputs, values[done:], slopes[done * n :])
                done += count * block[BLOCK_OUTPUTS]
                first += count
        inputs += groups_of(rows) * width


def set_units(
    system: ConstantIntegers, data: ConstantIntegers, place: ConstantReals, first: Integer, work: Reals
) -> None:
    """Units and roundings of the constraints at a place; at ``first`` its norms alone are the measure."""
    n = system[COORDINATES]
    norms = place[vector_at(system, NORMS) :]
    x = place[vector_at(system, X) :]
    units = work[multipliers_at(system, UNITS) :]
    values = work[multipliers_at(system, VALUES) :]
    roundings = work[multipliers_at(system, ROUNDINGS) :]
    slopes = work[slopes_at(system) :]
    for c in range(constraint_count(system, data)):
        square = 0.0
        terms = fabs(values[c])
        longest = 0.0
        for j in range(n):
            slope = fabs(slopes[c * n + j])
            size = fabs(x[j]) if system[system[PLACES_AT] + j] >= 0 else 1.0
            terms += slope * size
            if slope > longest:
                longest = slope
            if norms[j] > 0.0:
                square += slope / norms[j] * (slope / norms[j])
        if first == 1:
            units[c] = sqrt(square) if square > 0.0 else longest
            if not units[c] > 0.0:
                units[c] = 1.0
        roundings[c] = ROUNDING_ERRORS * EPSILON * terms
