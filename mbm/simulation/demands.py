"""Whether true values meet what the problem demands: estimates that do can never reach values that do not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.layout import Layout
from mbm.expression.evaluate import evaluate
from mbm.problem.checks import used_rows
from mbm.problem.kinds import Relation
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Problem
from mbm.simulation.places import Rows

TOLERANCE = 1e-6
"""Violation, relative to the largest number in play, that rounding of typed values explains."""


@np.errstate(all="ignore")
def violated(problem: Problem, tables: Mapping[str, Table], places: Layout) -> tuple[Block, ...]:
    """The constraints that the values in ``places.start`` do not meet."""
    limit = TOLERANCE * max(1.0, float(np.abs(places.start).max(initial=0.0)))
    demands = (block for block in problem.blocks if block.role is BlockRole.CONSTRAINT)
    return tuple(block for block in demands if _worst(block, tables, places) > limit)


def _worst(block: Block, tables: Mapping[str, Table], places: Layout) -> float:
    """The largest violation of a constraint in any of its rows; infinite where it has no value."""
    table = tables[block.table] if block.table is not None else None
    mask = used_rows(block, tables)
    worst = 0.0
    for case in block.cases:
        positions = None
        if table is not None:
            positions = rows_of(case.static, table)
            positions = positions if mask is None else positions[mask[positions]]
            if not len(positions):
                continue
        rows = Rows(table=table, positions=positions, tables=tables, layout=places, numbers=places.start)
        for equation in case.equations:
            for value in evaluate(equation.components, rows.lookup({})):
                above = np.abs(value) if equation.relation is Relation.ZERO else np.asarray(value)
                worst = max(worst, float(np.where(np.isnan(above), np.inf, above).max()))
    return worst
