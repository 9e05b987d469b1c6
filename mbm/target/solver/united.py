"""Blocks of few rows whose rows are united in one function: their data, and whether a data set has just these rows.

In the process only, where functions are made for a problem: see `mbm.target.united`.
"""

from __future__ import annotations

from mbm.target.solver.description import DataSet, Problem
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.workspace import UNITED_NOW, united_at
from mbm.target.words import ConstantReals, Integer, Reals, call_united


def united_now(system: Problem, work: ConstantReals) -> Integer:
    """1 where the united rows of the data set are loaded."""
    if system.united_reals == 0:
        return 0
    return 1 if work[UNITED_NOW] == 1.0 else 0


def first_apart(system: Problem, work: ConstantReals) -> Integer:
    """The first block that is not united; those of constraints never are."""
    found = 0
    if united_now(system, work) == 1:
        while found < system.residual_blocks and system.united[0].rows[found] > 0:
            found += 1
    return found


def rows_apart(system: Problem, data: DataSet, b: Integer, work: ConstantReals) -> Integer:
    """The rows of a block that go through its own kernel: all, or none where they are united."""
    rows = data.blocks[b].rows
    if b < system.residual_blocks and united_now(system, work) == 1 and system.united[0].rows[b] > 0:
        rows = 0
    return rows


def unite(system: Problem, data: DataSet, parameters: ConstantReals, weights: ConstantReals, work: Reals) -> None:
    """The data of the united rows, if the data set has just these and all of them count."""
    if system.united_reals == 0:
        return
    work[UNITED_NOW] = 0.0
    there = work[united_at(system) :]
    done = 0
    for b in range(system.residual_blocks):
        rows = system.united[0].rows[b]
        if rows > 0:
            block = system.blocks[b]
            part = data.blocks[b]
            if part.rows != rows:
                return
            size = rows * block.parameters
            copied(size, parameters[part.parameters :], there[done:])
            done += size
            heavy = weights[part.weights :]
            for k in range(rows * block.weights):
                if heavy[k] == 0.0:
                    return
                there[done] = heavy[k]
                done += 1
    work[UNITED_NOW] = 1.0


def united_rows(
    system: Problem, slopes: Integer, point: ConstantReals, stride: Integer, work: Reals, target: Reals
) -> Integer:
    """The residuals of the united rows, with ``slopes`` 1 behind their derivatives; how many there are, 0: none now."""
    if united_now(system, work) == 0:
        return 0
    table = system.united[0]
    address = table.jacobian if slopes == 1 else table.values
    call_united(address, point, work[united_at(system) :], target, stride)
    return table.residuals
