"""What the closed form that fits subsets knows of the rows at hand, as `mbm.solver.range_form` has it."""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Real, Reals
from mbm.solver.consensus_records import SIGHTS, Rules
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import filled
from mbm.solver.range_form import know_rows
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
            given = rows.parameters[part.parameters :]
            step = block.unit_count * width
            for u in range(block.unit_count):
                own = forms[units * width + u * width :]
                at = map_places[first + u]
                if at < 0:
                    for row in range(part.rows):
                        filled(width, inf - inf, own[row * step :])
                else:
                    know_rows(width, count, part.rows, given, maps[at:], maps[at + count * width :], step, own)
                if rules.form == SIGHTS:
                    for row in range(part.rows):
                        line = own[row * step :]
                        length = sqrt(line[3] * line[3] + line[4] * line[4] + line[5] * line[5])
                        for i in range(3, 6):
                            line[i] *= sign / length
            units += part.rows * block.unit_count
