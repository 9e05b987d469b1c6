"""The arrays ``problem`` and ``constants`` of the solver, completed for the data at hand.

What does not depend on data stands in ``problem`` already: the blocks with their units and nonzeros.
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
from mbm.machine.records import slot, view
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.description import BOUNDS_AT, NO_LOSS, NUMBER, TOLERANCE, DataSet, Problem
from mbm.solver.linear_algebra import filled


def set_capacities(problem: Problem, data: DataSet) -> Integer:
    """Capacities for the rows of one data set; the residuals that count (m,)."""
    problem.most_residuals = 4
    problem.most_inputs = 0
    problem.most_weights = 0
    problem.most_multipliers = 0
    problem.most_outputs = 0
    count = 0
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        rows = data.blocks[b].rows
        outputs = block.outputs
        problem.most_residuals += rows * outputs
        problem.most_inputs += rows * (block.variables + block.parameters)
        wide = problem.chunk // outputs * (outputs + block.nonzero_count)
        if wide > problem.most_outputs:
            problem.most_outputs = wide
        if b < problem.residual_blocks:
            problem.most_weights += rows * block.weights
            count += rows * outputs
        else:
            problem.most_weights += 2 * rows * outputs
            problem.most_multipliers += rows * outputs
    return count


def set_coordinates(
    numbers: Integers,
    prefix: Integer,
    unknowns: ConstantIntegers,
    count: Integer,
    members: ConstantIntegers,
    offsets: ConstantIntegers,
    firsts: ConstantIntegers,
    column: ConstantIntegers,
) -> None:
    """The tables of free coordinates and of pieces, behind the first ``prefix`` integers."""
    problem = view(Problem, numbers)
    problem.numbers = offsets[count]
    free = problem.n
    numbers[slot(Problem, "number_of")] = prefix
    numbers[slot(Problem, "positive")] = prefix + free
    numbers[slot(Problem, "components")] = prefix + 2 * free
    problem.component_count = 0
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
                        problem.number_of[column[coordinate]] = place
                        problem.positive[column[coordinate]] = unknowns[own + UNKNOWN_POSITIVE]
                else:
                    set_component(problem, kind, place, column[coordinate:])


def set_component(problem: Problem, kind: Integer, place: Integer, column: ConstantIntegers) -> None:
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
            problem.number_of[column[t]] = -1
            problem.positive[column[t]] = 0
    if some == 1:
        piece = problem.components[problem.component_count]
        problem.component_count += 1
        piece.kind = kind
        piece.number_0 = place
        piece.number_1 = place + 1 if size > 1 else 0
        piece.number_2 = place + 2 if size > 2 else 0
        piece.number_3 = place + 3 if size > 3 else 0
        piece.column_0 = column[0]
        piece.column_1 = column[1] if tangents > 1 else -1
        piece.column_2 = column[2] if tangents > 2 else -1


def set_constants(
    problem: Problem,
    constants: Reals,
    coordinates: Integer,
    column: ConstantIntegers,
    lower: ConstantReals,
    upper: ConstantReals,
    tolerance: Real,
    losses: ConstantReals,
) -> None:
    """Tolerance, bounds of the free coordinates, and the parameters of the losses behind them."""
    free = problem.n
    filled(BOUNDS_AT, 0.0, constants)
    constants[TOLERANCE] = tolerance
    problem.boxed = 0
    for c in range(coordinates):
        if column[c] >= 0:
            constants[BOUNDS_AT + column[c]] = lower[c]
            constants[BOUNDS_AT + free + column[c]] = upper[c]
            positive = problem.positive[column[c]] == 1
            if isfinite(lower[c]) or isfinite(upper[c]) or positive:
                problem.boxed = 1
    if problem.boxed == 1:
        problem.direct = 0
    number = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            unit = block.units[u]
            if unit.loss != NO_LOSS:
                unit.loss_at = BOUNDS_AT + 2 * free + 2 * number
                constants[BOUNDS_AT + 2 * free + 2 * number] = losses[2 * number]
                constants[BOUNDS_AT + 2 * free + 2 * number + 1] = losses[2 * number + 1]
                number += 1
