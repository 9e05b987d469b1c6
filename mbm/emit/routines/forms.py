"""What the closed form that fits subsets knows of the rows at hand: `mbm.estimation.consensus.forms`, printed.

It was learnt when the solver was made, as an affine map of the parameters of a row: ``maps`` has for each type of unit
``(parameters + 1) · width`` numbers from its offset in ``map_places`` on, the constant ones last; -1: nothing is known.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.consensus_records import SIGHTS, Rules
from mbm.solver.description import Problem
from mbm.solver.workspace import Rows


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
    problem: Problem,
    rows: Rows,
    rules: Rules,
    map_places: ConstantIntegers,
    maps: ConstantReals,
    sign: Real,
    forms: Reals,
) -> None:
    """``forms`` of all units (units, width); lines of sight are of length 1, reflected by ``sign``."""
    width = rules.form_width
    units = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        first = rules.ruled[b].first_level
        count = block.parameters
        part = rows.data.blocks[b]
        if first >= 0:
            for row in range(part.rows):
                for u in range(block.unit_count):
                    own = forms[units * width :]
                    given = rows.parameters[part.parameters + row * count :]
                    known_unit(width, count, given, map_places[first + u], maps, own)
                    if rules.form == SIGHTS:
                        length = sqrt(own[3] * own[3] + own[4] * own[4] + own[5] * own[5])
                        for i in range(3, 6):
                            own[i] *= sign / length
                    units += 1
