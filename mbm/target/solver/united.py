"""Blocks of few rows whose rows are united in one function: their data, and whether a data set has just these rows.

In the process only, where functions are made for a problem: see `mbm.target.united`.
"""

from __future__ import annotations

from mbm.target.solver.description import Problem
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.workspace import Rows
from mbm.target.words import ConstantReals, Integer, Reals, call_united


def first_apart(system: Problem, rows: Rows) -> Integer:
    """The first block that is not united; those of constraints never are."""
    found = 0
    if rows.united == 1:
        while found < system.residual_blocks and system.united[0].rows[found] > 0:
            found += 1
    return found


def rows_apart(system: Problem, rows: Rows, b: Integer) -> Integer:
    """The rows of a block that go through its own kernel: all, or none where they are united."""
    if b < system.residual_blocks and rows.united == 1 and system.united[0].rows[b] > 0:
        return 0
    return rows.data.blocks[b].rows


def unite(system: Problem, rows: Rows) -> None:
    """The data of the united rows, if the data set has just these and all of them count."""
    rows.united = 0
    if system.united_reals == 0:
        return
    there = rows.united_data
    done = 0
    for b in range(system.residual_blocks):
        count = system.united[0].rows[b]
        if count > 0:
            block = system.blocks[b]
            part = rows.data.blocks[b]
            if part.rows != count:
                return
            size = count * block.parameters
            copied(size, rows.parameters[part.parameters :], there[done:])
            done += size
            heavy = rows.whitening[part.weights :]
            for k in range(count * block.weights):
                if heavy[k] == 0.0:
                    return
                there[done] = heavy[k]
                done += 1
    rows.united = 1


def united_rows(
    system: Problem, rows: Rows, slopes: Integer, point: ConstantReals, stride: Integer, target: Reals
) -> Integer:
    """The residuals of the united rows, with ``slopes`` 1 behind their derivatives; how many there are, 0: none now."""
    if rows.united == 0:
        return 0
    table = system.united[0]
    address = table.jacobian if slopes == 1 else table.values
    call_united(address, point, rows.united_data, target, stride)
    return table.residuals
