"""Kernels over tables: rows one behind the other go in and come out, kernels take blocks of lanes."""

from __future__ import annotations

from mbm.machine.kinds import LANES
from mbm.machine.records import record
from mbm.machine.words import ConstantReals, Integer, Reals, call_kernel, distinct_arrays
from mbm.solver.equations import groups_of


@record
class Table:
    """A kernel with its widths; ``first`` of its outputs go to one table and the ``others`` to a second one."""

    kernel: Integer
    """The address, as `call_kernel` takes it."""
    inputs: Integer
    first: Integer
    others: Integer
    portion: Integer
    """Blocks that are evaluated at a time."""


@distinct_arrays
def by_lanes(rows: Integer, width: Integer, given: ConstantReals, target: Reals) -> None:
    """Rows as blocks; lanes beyond the last row repeat it."""
    whole = rows // LANES
    for group in range(whole):
        for i in range(width):
            for lane in range(LANES):
                target[(group * width + i) * LANES + lane] = given[(group * LANES + lane) * width + i]
    for group in range(whole, groups_of(rows)):
        for lane in range(LANES):
            row = group * LANES + lane
            if row >= rows:
                row = rows - 1
            for i in range(width):
                target[(group * width + i) * LANES + lane] = given[row * width + i]


@distinct_arrays
def by_rows(rows: Integer, wide: Integer, width: Integer, blocks: ConstantReals, target: Reals) -> None:
    """The first ``width`` columns of blocks that are ``wide``, as rows."""
    whole = rows // LANES
    for group in range(whole):
        for o in range(width):
            for lane in range(LANES):
                target[(group * LANES + lane) * width + o] = blocks[(group * wide + o) * LANES + lane]
    for row in range(whole * LANES, rows):
        for o in range(width):
            target[row * width + o] = blocks[(whole * wide + o) * LANES + row - whole * LANES]


def evaluate_rows(
    table: Table, rows: Integer, inputs: ConstantReals, first: Reals, others: Reals, work: Reals
) -> Integer:
    """Outputs (rows, first) and (rows, others) at inputs (rows, inputs); always 0.

    ``work``: room for the inputs and outputs of a portion.
    """
    wide = table.first + table.others
    most = table.portion * LANES
    outputs = work[most * table.inputs :]
    done = 0
    while done < rows:
        count = rows - done
        if count > most:
            count = most
        by_lanes(count, table.inputs, inputs[done * table.inputs :], work)
        call_kernel(table.kernel, work, outputs, groups_of(count))
        by_rows(count, wide, table.first, outputs, first[done * table.first :])
        by_rows(count, wide, table.others, outputs[table.first * LANES :], others[done * table.others :])
        done += count
    return 0
