"""What equations say in many solves, not whitened: for those who ask for residuals as they were measured."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.at_rows import AtRows
from mbm.equations.solves import Lines
from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Columns
from mbm.estimation.search.solution import RawRows
from mbm.expression.evaluate import Values
from mbm.problem.types import BlockRole, Problem


@np.errstate(all="ignore")
def raw_rows(problem: Problem, stack: Stack, which: range, columns: Columns) -> Iterator[RawRows]:
    """What the equations of observations say at the ends of some solves, measured values taken as exact."""
    stack = stack.exactly()
    portion = Portion(stack, which)
    for number, each in enumerate(portion.lines):
        group, solve, slots = each.group, each.solve, each.slots
        owner = group.kernel.owner
        if problem.blocks[owner].role is not BlockRole.OBSERVATION or not len(solve):
            continue
        rows = rows_of(problem, stack, each, columns.points)
        every = np.ones(slots.shape, dtype=bool)
        yield RawRows(
            owner=owner,
            case=group.kernel.case,
            solve=solve,
            values=portion.values(number, columns.points),
            counting=every if columns.counting is None else columns.counting[solve[:, None], slots],
            behind=rows.behind(),
            rows=np.ones(len(solve), dtype=np.int64) if rows.table is None else rows.table.rows[rows.positions],
        )


def rows_of(problem: Problem, stack: Stack, lines: Lines, points: Floats) -> AtRows:
    """The rows of a group that some solves have, at one of the ``points`` (K, N) for each."""
    table = problem.blocks[lines.group.kernel.owner].table

    def numbers(places: Indices | int) -> Values:
        return np.asarray(points[lines.solve, places])

    return AtRows(
        count=len(lines.solve),
        group=lines.group,
        lines=lines.place,
        layout=stack.equations.layout,
        table=None if table is None else stack.tables[table],
        positions=lines.positions,
        tables=stack.tables,
        numbers=numbers,
        pick=stack.arranged.pick,
    )
