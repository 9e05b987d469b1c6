"""How much room consensus takes for the rows at hand, and whether it is the method for them."""

from __future__ import annotations

from mbm.machine.records import view
from mbm.machine.words import ConstantIntegers, Integer, Integers
from mbm.solver.consensus_records import Rules, take_sizes
from mbm.solver.consensus_subset import copied_integers
from mbm.solver.decisions import MANY_CONNECTED
from mbm.solver.description import DataSet, Problem
from mbm.solver.linear_algebra import numbered


def side_by_side(numbers: ConstantIntegers, size: Integer, copy: Integers) -> None:
    """A problem (size,) with room for all rows in one chunk, as consensus takes them."""
    copied_integers(size, numbers, copy)
    problem = view(Problem, numbers)
    wide = view(Problem, copy)
    if wide.chunk < problem.most_residuals:
        wide.chunk = (problem.most_residuals + 3) // 4 * 4
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        lines = block.outputs
        needed = (lines + block.nonzero_count) * (wide.chunk // lines + 1)
        if needed > wide.most_outputs:
            wide.most_outputs = needed


def widest_row(problem: Problem, b: Integer) -> Integer:
    """The longest of the four lines that a row of a block has."""
    block = problem.blocks[b]
    found = 0
    if block.parameters > found:
        found = block.parameters
    if block.weights > found:
        found = block.weights
    if block.variables > found:
        found = block.variables
    if block.tangents > found:
        found = block.tangents
    return found


def set_room(wide: Problem, data: DataSet, rules: Rules) -> Integer:
    """Capacities in ``rules`` for the rows of one data set; the residuals of the units that are ruled."""
    take_sizes(wide, rules)
    rules.most_units = 1
    rules.most_rows = 1
    scalars = 0
    for b in range(wide.residual_blocks):
        block = wide.blocks[b]
        rows = data.blocks[b].rows
        taken = rows
        if rules.ruled[b].first_level >= 0:
            rules.most_units += rows * block.unit_count
            scalars += rows * block.outputs
            taken = wide.n
        rules.most_rows += (taken + 1) * widest_row(wide, b)
    return scalars


def lowest_label(count: Integer, line: ConstantIntegers, label: ConstantIntegers, most: Integer) -> Integer:
    """The lowest label of the coordinates (count,) of a row; ``most`` if none of them is free."""
    found = most
    for t in range(count):
        if line[t] >= 0 and label[line[t]] < found:
            found = label[line[t]]
    return found


def connected(problem: Problem, data: DataSet, columns: ConstantIntegers, label: Integers) -> Integer:
    """1 if the equations connect all free coordinates, and these are few; ``label`` (n,) is scratch."""
    n = problem.n
    if n > MANY_CONNECTED:
        return 0
    numbered(n, label)
    changed = 1
    while changed == 1:
        changed = 0
        for b in range(problem.residual_blocks + problem.constraint_blocks):
            block = problem.blocks[b]
            part = data.blocks[b]
            lines = part.rows
            if block.columns == 0 and lines > 1:
                lines = 1
            for row in range(lines):
                line = columns[part.columns + row * block.columns :]
                lowest = lowest_label(block.tangents, line, label, n)
                for t in range(block.tangents):
                    if line[t] >= 0 and label[line[t]] > lowest:
                        label[line[t]] = lowest
                        changed = 1
    for j in range(n):
        if label[j] != 0:
            return 0
    return 1
