"""What the closed form that fits subsets knows of the rows at hand, as `mbm.solver.known_rows` has it."""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Real, Reals
from mbm.solver.consensus_records import SIGHTS, Rules
from mbm.solver.description import Problem
from mbm.solver.known_rows import known_unit
from mbm.solver.workspace import Rows


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
