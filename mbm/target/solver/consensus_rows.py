"""Rows at a point as consensus takes them: all of ``[J r]`` side by side, squared norms of units, weights by unit."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.solver.consensus_description import COMPONENTS, PLACE, place_vector_at, simple_at
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_JACOBIAN,
    BLOCK_NONZEROS,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_VARIABLES,
    BLOCKS,
    BLOCKS_AT,
    BOUNDS_AT,
    CHUNK,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_ROWS,
    LANES,
    PLACES_AT,
)
from mbm.target.solver.equations import gather, groups_of, weights_width, whiten_values
from mbm.target.solver.linear_algebra import copied, filled
from mbm.target.solver.manifolds import retract
from mbm.target.solver.slopes import scatter, whiten_matrices
from mbm.target.solver.workspace import inputs_at, outputs_at, weights_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals, call_kernel, distinct_arrays


def linearised(
    system: ConstantIntegers,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    work: Reals,
    chunk: Reals,
) -> Integer:
    """Whitened residuals and derivatives without losses: ``chunk`` holds n columns of J and one of r, CHUNK apart.

    How many numbers of a column are taken is given, a multiple of 4. Constraints are left out.
    """
    n = system[COORDINATES]
    stride = system[CHUNK]
    inputs = inputs_at(system)
    whitening = weights_at(system)
    outputs = work[outputs_at(system) :]
    there = 0
    for b in range(system[BLOCKS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = data[at + DATA_ROWS]
        groups = groups_of(rows)
        lines = block[BLOCK_OUTPUTS] * LANES
        if groups > 0:
            gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
            call_kernel(block[BLOCK_JACOBIAN], work[inputs:], outputs, groups)
            weights = work[whitening:]
            for column in range(n):
                filled(groups * lines, 0.0, chunk[column * stride + there :])
            own = columns[data[at + DATA_COLUMNS] :]
            scatter(system, block, own, 0, rows, groups, outputs, weights, chunk[there:])
            every = block[BLOCK_OUTPUTS] + block[BLOCK_NONZEROS]
            whiten_values(system, block, groups, every, outputs, weights, chunk[n * stride + there :])
            whiten_matrices(system, block, groups, weights, chunk[there:])
        there += groups * lines
        inputs += groups * LANES * (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS])
        whitening += groups * LANES * weights_width(block)
    while there % 4 != 0:
        for column in range(n + 1):
            chunk[column * stride + there] = 0.0
        there += 1
    return there


@distinct_arrays
def square_each(count: Integer, values: ConstantReals, squares: Reals) -> None:
    """The square of each; infinite where that is not finite."""
    for i in range(count):
        square = values[i] * values[i]
        squares[i] = square if isfinite(square) else inf


def unit_squares(
    rules: ConstantIntegers, places: ConstantIntegers, units: Integer, residuals: ConstantReals, squares: Reals
) -> None:
    """Squared norms (U,) of the units; infinite where one is not finite."""
    if places[simple_at(rules)] == 1:
        square_each(units, residuals, squares)
        return
    components = places[place_vector_at(rules, COMPONENTS) :]
    place = places[place_vector_at(rules, PLACE) :]
    for u in range(units):
        own = residuals[place[u] :]
        total = own[0] * own[0]
        for i in range(1, components[u]):
            total += own[i * LANES] * own[i * LANES]
        squares[u] = total if isfinite(total) else inf


def unruled_square(
    rules: ConstantIntegers, places: ConstantIntegers, count: Integer, residuals: ConstantReals, ruled: ConstantReals
) -> Real:
    """The sum of the squares that no rule touches; ``ruled`` is 1 for the others. Infinite if one is not finite."""
    total = 0.0
    if places[simple_at(rules)] == 1:
        return total
    for i in range(count):
        if ruled[i] == 0.0:
            total += residuals[i] * residuals[i]
    return total if isfinite(total) else inf


def spread_weights(
    rules: ConstantIntegers,
    places: ConstantIntegers,
    units: Integer,
    count: Integer,
    weights: ConstantReals,
    by_row: Reals,
) -> None:
    """Weights (U,) by unit as weights by residual, 1 where no rule acts."""
    if places[simple_at(rules)] == 1:
        copied(units, weights, by_row)
        filled(count - units, 1.0, by_row[units:])
        return
    components = places[place_vector_at(rules, COMPONENTS) :]
    place = places[place_vector_at(rules, PLACE) :]
    filled(count, 1.0, by_row)
    for u in range(units):
        for i in range(components[u]):
            by_row[place[u] + i * LANES] = weights[u]


@distinct_arrays
def weigh_columns(
    columns: Integer, stride: Integer, count: Integer, weights: ConstantReals, chunk: Reals, target: Reals
) -> None:
    """``target`` = weight · column; both are zero where the weight is."""
    for column in range(columns):
        for i in range(count):
            weight = weights[i]
            value = chunk[column * stride + i] if weight != 0.0 else 0.0
            chunk[column * stride + i] = value
            target[column * stride + i] = weight * value


def moved(
    system: ConstantIntegers, constants: ConstantReals, point: ConstantReals, step: ConstantReals, target: Reals
) -> None:
    """The point after a step (n,), put back inside the bounds."""
    retract(system, point, step, target)
    n = system[COORDINATES]
    for j in range(n):
        place = system[system[PLACES_AT] + j]
        if place >= 0:
            if target[place] < constants[BOUNDS_AT + j]:
                target[place] = constants[BOUNDS_AT + j]
            if target[place] > constants[BOUNDS_AT + n + j]:
                target[place] = constants[BOUNDS_AT + n + j]
