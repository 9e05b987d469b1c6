"""Blocks of few rows whose rows are united in one function: their data, and whether a data set has just these rows.

In the process only, where functions are made for a problem: see `mbm.target.united`.
"""

from __future__ import annotations

from mbm.target.solver.description import (
    BLOCK,
    BLOCK_PARAMETERS,
    BLOCK_WEIGHTS,
    BLOCKS,
    BLOCKS_AT,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_PARAMETERS,
    DATA_ROWS,
    DATA_WEIGHTS,
    UNITED_AT,
    UNITED_JACOBIAN,
    UNITED_RESIDUALS,
    UNITED_ROWS,
    UNITED_VALUES,
)
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.workspace import UNITED_NOW, scalars_at, united_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals, call_united


def united_now(system: ConstantIntegers, work: ConstantReals) -> Integer:
    """1 where the united rows of the data set are loaded."""
    if system[UNITED_AT] == 0:
        return 0
    return 1 if work[scalars_at(system) + UNITED_NOW] == 1.0 else 0


def first_apart(system: ConstantIntegers, work: ConstantReals) -> Integer:
    """The first block that is not united; those of constraints never are."""
    found = 0
    if united_now(system, work) == 1:
        while found < system[BLOCKS] and system[system[UNITED_AT] + UNITED_ROWS + found] > 0:
            found += 1
    return found


def rows_apart(system: ConstantIntegers, data: ConstantIntegers, b: Integer, work: ConstantReals) -> Integer:
    """The rows of a block that go through its own kernel: all, or none where they are united."""
    rows = data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
    if b < system[BLOCKS] and united_now(system, work) == 1 and system[system[UNITED_AT] + UNITED_ROWS + b] > 0:
        rows = 0
    return rows


def unite(
    system: ConstantIntegers, data: ConstantIntegers, parameters: ConstantReals, weights: ConstantReals, work: Reals
) -> None:
    """The data of the united rows, if the data set has just these and all of them count."""
    if system[UNITED_AT] == 0:
        return
    work[scalars_at(system) + UNITED_NOW] = 0.0
    there = work[united_at(system) :]
    done = 0
    for b in range(system[BLOCKS]):
        rows = system[system[UNITED_AT] + UNITED_ROWS + b]
        if rows > 0:
            block = system[system[BLOCKS_AT] + b * BLOCK :]
            at = DATA_HEAD + b * DATA_BLOCK
            if data[at + DATA_ROWS] != rows:
                return
            size = rows * block[BLOCK_PARAMETERS]
            copied(size, parameters[data[at + DATA_PARAMETERS] :], there[done:])
            done += size
            heavy = weights[data[at + DATA_WEIGHTS] :]
            for k in range(rows * block[BLOCK_WEIGHTS]):
                if heavy[k] == 0.0:
                    return
                there[done] = heavy[k]
                done += 1
    work[scalars_at(system) + UNITED_NOW] = 1.0


def united_rows(
    system: ConstantIntegers, slopes: Integer, point: ConstantReals, stride: Integer, work: Reals, target: Reals
) -> Integer:
    """The residuals of the united rows, with ``slopes`` 1 behind their derivatives; how many there are, 0: none now."""
    if united_now(system, work) == 0:
        return 0
    table = system[system[UNITED_AT] :]
    address = table[UNITED_JACOBIAN] if slopes == 1 else table[UNITED_VALUES]
    call_united(address, point, work[united_at(system) :], target, stride)
    return table[UNITED_RESIDUALS]
