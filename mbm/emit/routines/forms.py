"""What the closed form that fits subsets knows of the rows at hand: `mbm.solution.native.consensus_forms`, printed.

It was learnt when the solver was made, as an affine map of the parameters of a row: ``maps`` has for each type of unit
``(parameters + 1) · width`` numbers from its offset in ``map_places`` on, the constant ones last; -1: nothing is known.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.target.solver.consensus_description import (
    BLOCKS_AT,
    FORM,
    FORM_WIDTH,
    RULED,
    RULED_TYPE,
    SIGHTS,
)
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_PARAMETERS,
    BLOCK_UNITS,
    BLOCKS,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_PARAMETERS,
    DATA_ROWS,
)
from mbm.target.solver.description import BLOCKS_AT as SYSTEM_BLOCKS_AT
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals


def known_unit(
    width: Integer, count: Integer, given: ConstantReals, at: Integer, maps: ConstantReals, target: Reals
) -> None:
    """What is known of a unit (width,) of a row with the parameters ``given`` (count,)."""
    for w in range(width):
        total = inf - inf
        if at >= 0:
            total = maps[at + count * width + w]
            for p in range(count):
                total += given[p] * maps[at + p * width + w]
        target[w] = total


def known_units(
    system: ConstantIntegers,
    data: ConstantIntegers,
    rules: ConstantIntegers,
    map_places: ConstantIntegers,
    maps: ConstantReals,
    sign: Real,
    parameters: ConstantReals,
    forms: Reals,
) -> None:
    """``forms`` of all units (units, width); lines of sight are of length 1, turned by ``sign``."""
    width = rules[FORM_WIDTH]
    units = 0
    for b in range(system[BLOCKS]):
        at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
        first = rules[rules[BLOCKS_AT] + b * RULED + RULED_TYPE]
        count = system[at + BLOCK_PARAMETERS]
        begin = data[DATA_HEAD + b * DATA_BLOCK + DATA_PARAMETERS]
        if first >= 0:
            for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
                for u in range(system[at + BLOCK_UNITS]):
                    own = forms[units * width :]
                    known_unit(width, count, parameters[begin + row * count :], map_places[first + u], maps, own)
                    if rules[FORM] == SIGHTS:
                        length = sqrt(own[3] * own[3] + own[4] * own[4] + own[5] * own[5])
                        for i in range(3, 6):
                            own[i] *= sign / length
                    units += 1
