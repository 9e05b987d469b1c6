"""How much room consensus takes for the rows at hand, and whether it is the method for them."""

from __future__ import annotations

from mbm.target.decisions import MANY_CONNECTED
from mbm.target.solver.consensus_description import BLOCKS_AT, MOST_ROWS, MOST_UNITS, RULED, RULED_TYPE
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_NONZEROS,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_TANGENTS,
    BLOCK_UNITS,
    BLOCK_VARIABLES,
    BLOCK_WEIGHTS,
    BLOCKS,
    CHUNK,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_ROWS,
    OUTPUTS,
    RESIDUALS,
)
from mbm.target.solver.description import BLOCKS_AT as SYSTEM_BLOCKS_AT
from mbm.target.words import ConstantIntegers, Integer, Integers


def side_by_side(system: ConstantIntegers, size: Integer, wide: Integers) -> None:
    """``system`` (size,) with room for all rows in one chunk, as consensus takes them."""
    for i in range(size):
        wide[i] = system[i]
    if wide[CHUNK] < system[RESIDUALS]:
        wide[CHUNK] = (system[RESIDUALS] + 3) // 4 * 4
    for b in range(system[BLOCKS] + system[CONSTRAINTS]):
        at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
        lines = system[at + BLOCK_OUTPUTS]
        needed = (lines + system[at + BLOCK_NONZEROS]) * (wide[CHUNK] // lines + 1)
        if needed > wide[OUTPUTS]:
            wide[OUTPUTS] = needed


def widest_row(system: ConstantIntegers, b: Integer) -> Integer:
    """The longest of the four lines that a row of a block has."""
    at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
    found = 0
    if system[at + BLOCK_PARAMETERS] > found:
        found = system[at + BLOCK_PARAMETERS]
    if system[at + BLOCK_WEIGHTS] > found:
        found = system[at + BLOCK_WEIGHTS]
    if system[at + BLOCK_VARIABLES] > found:
        found = system[at + BLOCK_VARIABLES]
    if system[at + BLOCK_TANGENTS] > found:
        found = system[at + BLOCK_TANGENTS]
    return found


def set_room(system: ConstantIntegers, data: ConstantIntegers, rules: Integers) -> Integer:
    """Capacities in ``rules`` for the rows of one data set; the residuals of the units that are ruled."""
    rules[MOST_UNITS] = 1
    rules[MOST_ROWS] = 1
    scalars = 0
    for b in range(system[BLOCKS]):
        at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
        rows = data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        taken = rows
        if rules[rules[BLOCKS_AT] + b * RULED + RULED_TYPE] >= 0:
            rules[MOST_UNITS] += rows * system[at + BLOCK_UNITS]
            scalars += rows * system[at + BLOCK_OUTPUTS]
            taken = system[COORDINATES]
        rules[MOST_ROWS] += (taken + 1) * widest_row(system, b)
    return scalars


def lowest_label(count: Integer, line: ConstantIntegers, label: ConstantIntegers, most: Integer) -> Integer:
    """The lowest label of the coordinates (count,) of a row; ``most`` if none of them is free."""
    found = most
    for t in range(count):
        if line[t] >= 0 and label[line[t]] < found:
            found = label[line[t]]
    return found


def connected(system: ConstantIntegers, data: ConstantIntegers, columns: ConstantIntegers, label: Integers) -> Integer:
    """1 if the equations connect all free coordinates, and these are few; ``label`` (n,) is scratch."""
    n = system[COORDINATES]
    if n > MANY_CONNECTED:
        return 0
    for j in range(n):
        label[j] = j
    changed = 1
    while changed == 1:
        changed = 0
        for b in range(system[BLOCKS] + system[CONSTRAINTS]):
            block = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK :]
            at = DATA_HEAD + b * DATA_BLOCK
            lines = data[at + DATA_ROWS]
            if block[BLOCK_COLUMNS] == 0 and lines > 1:
                lines = 1
            for row in range(lines):
                line = columns[data[at + DATA_COLUMNS] + row * block[BLOCK_COLUMNS] :]
                lowest = lowest_label(block[BLOCK_TANGENTS], line, label, n)
                for t in range(block[BLOCK_TANGENTS]):
                    if line[t] >= 0 and label[line[t]] > lowest:
                        label[line[t]] = lowest
                        changed = 1
    for j in range(n):
        if label[j] != 0:
            return 0
    return 1
