"""The arrays ``system`` and ``constants`` of the solver, completed for the data at hand.

What does not depend on data stands in ``system`` already: the blocks with their units and nonzeros.
"""

from __future__ import annotations

from math import isfinite

from mbm.emit.routines.description import (
    PART,
    PART_COORDINATE,
    PART_KIND,
    PART_NUMBER,
    UNKNOWN,
    UNKNOWN_FREEDOM,
    UNKNOWN_PIECES,
    UNKNOWN_PIECES_AT,
    UNKNOWN_POSITIVE,
    UNKNOWN_SIZE,
)
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_NONZEROS,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCK_VARIABLES,
    BLOCK_WEIGHTS,
    BLOCKS,
    BLOCKS_AT,
    BOUNDS_AT,
    BOXED,
    CHUNK,
    CONSTRAINTS,
    COORDINATES,
    CURVED,
    CURVED_AT,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_ROWS,
    DIRECT,
    INPUTS,
    MULTIPLIERS,
    NO_LOSS,
    NUMBER,
    NUMBERS,
    OUTPUTS,
    PIECE,
    PIECE_COLUMNS,
    PIECE_KIND,
    PIECE_NUMBERS,
    PLACES_AT,
    POSITIVE_AT,
    RESIDUALS,
    TOLERANCE,
    UNIT,
    UNIT_LOSS,
    UNIT_LOSS_AT,
    WEIGHTS,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def set_capacities(system: Integers, data: ConstantIntegers) -> Integer:
    """Capacities for the rows of one data set; the residuals that count (m,)."""
    system[RESIDUALS] = 4
    system[INPUTS] = 0
    system[WEIGHTS] = 0
    system[MULTIPLIERS] = 0
    system[OUTPUTS] = 0
    count = 0
    for b in range(system[BLOCKS] + system[CONSTRAINTS]):
        at = system[BLOCKS_AT] + b * BLOCK
        rows = data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        outputs = system[at + BLOCK_OUTPUTS]
        system[RESIDUALS] += rows * outputs
        system[INPUTS] += rows * (system[at + BLOCK_VARIABLES] + system[at + BLOCK_PARAMETERS])
        wide = system[CHUNK] // outputs * (outputs + system[at + BLOCK_NONZEROS])
        if wide > system[OUTPUTS]:
            system[OUTPUTS] = wide
        if b < system[BLOCKS]:
            system[WEIGHTS] += rows * system[at + BLOCK_WEIGHTS]
            count += rows * outputs
        else:
            system[WEIGHTS] += 2 * rows * outputs
            system[MULTIPLIERS] += rows * outputs
    return count


def set_coordinates(
    system: Integers,
    prefix: Integer,
    free: Integer,
    unknowns: ConstantIntegers,
    count: Integer,
    members: ConstantIntegers,
    offsets: ConstantIntegers,
    firsts: ConstantIntegers,
    column: ConstantIntegers,
) -> None:
    """The tables of free coordinates and of pieces, behind the first ``prefix`` integers."""
    system[NUMBERS] = offsets[count]
    system[COORDINATES] = free
    system[PLACES_AT] = prefix
    system[POSITIVE_AT] = prefix + free
    system[CURVED_AT] = prefix + 2 * free
    system[CURVED] = 0
    for u in range(count):
        own = u * UNKNOWN
        for m in range(members[u]):
            number = offsets[u] + m * unknowns[own + UNKNOWN_SIZE]
            first = firsts[u] + m * unknowns[own + UNKNOWN_FREEDOM]
            for p in range(unknowns[own + UNKNOWN_PIECES]):
                part = unknowns[own + UNKNOWN_PIECES_AT] + p * PART
                kind = unknowns[part + PART_KIND]
                place = number + unknowns[part + PART_NUMBER]
                coordinate = first + unknowns[part + PART_COORDINATE]
                if kind == NUMBER:
                    if column[coordinate] >= 0:
                        system[prefix + column[coordinate]] = place
                        system[prefix + free + column[coordinate]] = unknowns[own + UNKNOWN_POSITIVE]
                else:
                    set_piece(system, prefix, free, kind, place, column[coordinate:])


def set_piece(
    system: Integers, prefix: Integer, free: Integer, kind: Integer, place: Integer, column: ConstantIntegers
) -> None:
    """A quaternion, direction or scale whose numbers begin at ``place``, if some of its coordinates are free."""
    size = 1
    tangents = 1
    if kind == 2:
        size = 4
        tangents = 3
    if kind == 3:
        size = 3
        tangents = 2
    some = 0
    for t in range(tangents):
        if column[t] >= 0:
            some = 1
            system[prefix + column[t]] = -1
            system[prefix + free + column[t]] = 0
    if some == 1:
        at = system[CURVED_AT] + system[CURVED] * PIECE
        system[CURVED] += 1
        system[at + PIECE_KIND] = kind
        for i in range(4):
            system[at + PIECE_NUMBERS + i] = place + i if i < size else 0
        for t in range(3):
            system[at + PIECE_COLUMNS + t] = column[t] if t < tangents else -1


def set_constants(
    system: Integers,
    constants: Reals,
    coordinates: Integer,
    column: ConstantIntegers,
    lower: ConstantReals,
    upper: ConstantReals,
    tolerance: Real,
    losses: ConstantReals,
) -> None:
    """Tolerance, bounds of the free coordinates, and the parameters of the losses behind them."""
    free = system[COORDINATES]
    for i in range(BOUNDS_AT):
        constants[i] = 0.0
    constants[TOLERANCE] = tolerance
    system[BOXED] = 0
    for c in range(coordinates):
        if column[c] >= 0:
            constants[BOUNDS_AT + column[c]] = lower[c]
            constants[BOUNDS_AT + free + column[c]] = upper[c]
            positive = system[system[POSITIVE_AT] + column[c]] == 1
            if isfinite(lower[c]) or isfinite(upper[c]) or positive:
                system[BOXED] = 1
    if system[BOXED] == 1:
        system[DIRECT] = 0
    number = 0
    for b in range(system[BLOCKS]):
        at = system[BLOCKS_AT] + b * BLOCK
        for u in range(system[at + BLOCK_UNITS]):
            unit = system[at + BLOCK_UNITS_AT] + u * UNIT
            if system[unit + UNIT_LOSS] != NO_LOSS:
                system[unit + UNIT_LOSS_AT] = BOUNDS_AT + 2 * free + 2 * number
                constants[BOUNDS_AT + 2 * free + 2 * number] = losses[2 * number]
                constants[BOUNDS_AT + 2 * free + 2 * number + 1] = losses[2 * number + 1]
                number += 1
