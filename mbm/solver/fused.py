"""Blocks of few rows whose rows are fused in one function: their data, and whether a data set has just these rows.

In the process only, where functions are made for a problem: see `mbm.machine.fused`.
"""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals, call_fused
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied
from mbm.solver.workspace import Rows


def first_separate(problem: Problem, rows: Rows) -> Integer:
    """The first block that is not fused; those of constraints never are."""
    found = 0
    if rows.fused == 1:
        while found < problem.residual_blocks and problem.fused[0].rows[found] > 0:
            found += 1
    return found


def separate_rows(problem: Problem, rows: Rows, b: Integer) -> Integer:
    """The rows of a block that go through its own kernel: all, or none where they are fused."""
    if b < problem.residual_blocks and rows.fused == 1 and problem.fused[0].rows[b] > 0:
        return 0
    return rows.data.blocks[b].rows


def fuse(problem: Problem, rows: Rows) -> None:
    """The data of the fused rows, if the data set has just these and all of them count."""
    rows.fused = 0
    if problem.fused_reals == 0:
        return
    there = rows.fused_data
    done = 0
    for b in range(problem.residual_blocks):
        count = problem.fused[0].rows[b]
        if count > 0:
            block = problem.blocks[b]
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
    rows.fused = 1


def fused_rows(
    problem: Problem, rows: Rows, slopes: Integer, point: ConstantReals, stride: Integer, target: Reals
) -> Integer:
    """The residuals of the fused rows, with ``slopes`` 1 behind their derivatives; how many there are, 0: none now."""
    if rows.fused == 0:
        return 0
    table = problem.fused[0]
    address = table.jacobian if slopes == 1 else table.values
    call_fused(address, point, rows.fused_data, target, stride)
    return table.residuals
