"""Which coordinates are estimated, and where everything stands among the numbers and coordinates."""

from __future__ import annotations

from mbm.emit.routines.description import UNKNOWN, UNKNOWN_FAMILY, UNKNOWN_FREEDOM, UNKNOWN_SIZE
from mbm.machine.words import ConstantIntegers, Integer, Integers
from mbm.solver.description import Block


def place_unknowns(
    unknowns: ConstantIntegers, count: Integer, members: ConstantIntegers, offsets: Integers, firsts: Integers
) -> None:
    """Where the numbers and the coordinates of each unknown begin; behind the last, how many there are in all."""
    offsets[0] = 0
    firsts[0] = 0
    for u in range(count):
        offsets[u + 1] = offsets[u] + members[u] * unknowns[u * UNKNOWN + UNKNOWN_SIZE]
        firsts[u + 1] = firsts[u] + members[u] * unknowns[u * UNKNOWN + UNKNOWN_FREEDOM]


def mark_used(block: Block, rows: Integer, columns: ConstantIntegers, used: Integers) -> None:
    """Mark the coordinates that the derivatives of a block's rows belong to."""
    lines = rows
    if block.columns == 0 and rows > 1:
        lines = 1
    for k in range(block.nonzero_count):
        tangent = block.nonzeros[k].tangent
        for row in range(lines):
            used[columns[row * block.columns + tangent]] = 1


def free_coordinates(
    unknowns: ConstantIntegers,
    count: Integer,
    members: ConstantIntegers,
    firsts: ConstantIntegers,
    used: ConstantIntegers,
    fixed: ConstantIntegers,
    column: Integers,
) -> Integer:
    """How many coordinates are estimated; ``column`` gives each its place among them, -1: it stays.

    A member of a family that no equation mentions stays; an unknown of which nothing is mentioned does not.
    """
    free = 0
    for u in range(count):
        freedom = unknowns[u * UNKNOWN + UNKNOWN_FREEDOM]
        mentioned = 0
        for c in range(firsts[u], firsts[u + 1]):
            mentioned += used[c]
        for m in range(members[u]):
            first = firsts[u] + m * freedom
            own = 0
            for c in range(first, first + freedom):
                own += used[c]
            for c in range(first, first + freedom):
                column[c] = -1
                leaves = unknowns[u * UNKNOWN + UNKNOWN_FAMILY] == 1 and mentioned > 0 and own == 0
                if fixed[c] == 0 and not leaves:
                    column[c] = free
                    free += 1
    return free


def renumber(count: Integer, column: ConstantIntegers, columns: Integers) -> None:
    """Coordinates → their places among the free ones, in place."""
    for i in range(count):
        columns[i] = column[columns[i]]
