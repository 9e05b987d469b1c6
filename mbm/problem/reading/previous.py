"""``(previous FORM)``: FORM with the columns of the row before."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope
from mbm.language.values import Evaluator, Scope, Value
from mbm.problem.previous import column_before, looks_back, name_before, row_before, with_rows_before
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.tables import Column as TableColumn
from mbm.problem.tables import Table
from mbm.problem.types import Block
from mbm.text.types import MbmError, Sequence, Span
from mbm.values import dataclass

USAGE = "(previous form), where the row of a table is at hand"


class EarlierScope(RowScope):
    """The columns of the row before, over the problem's names."""

    def _reference(self, column: TableColumn, span: Span) -> Value:
        return super()._reference(self.table.columns[name_before(column.name)], span)

    def _row_number(self, span: Span) -> Value:
        return super()._reference(self.table.columns[row_before()], span)


def previous(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value | None:
    """The form, in a problem."""
    world = evaluator.world
    if not isinstance(world, ProblemScope) or world.earlier is None:
        return None
    if len(form.items) != 2:
        raise MbmError(language_faults.bad_form(form.span, "`previous` takes one form", USAGE))
    inner = scope
    while isinstance(inner, LocalScope):
        inner = inner.parent
    if not isinstance(inner, RowScope) or isinstance(inner, EarlierScope) or not inner.at_hand:
        raise MbmError(language_faults.bad_form(form.span, "there is no row at hand that another could precede", USAGE))
    table = world.earlier(inner.table)
    return evaluator.wanted(form.items[1], EarlierScope(world, table, inner.static, around=scope))


@dataclass(slots=True)
class Earlier:
    """Gives tables the columns of the row before when they are asked for.

    ``tables`` are those at work, ``unfiltered`` the same with all rows, ``keys`` what divides them.
    """

    tables: dict[str, Table]
    unfiltered: dict[str, Table]
    keys: tuple[str, ...] = ()
    asked: dict[str, None] = field(default_factory=dict)

    def __call__(self, table: Table) -> Table:
        """The table, with the columns of the row before."""
        name = table.name
        if name not in self.asked:
            self.asked[name] = None
            whole = self.unfiltered.get(name, table)
            self.unfiltered[name] = with_rows_before(whole, self.keys)
            own = self.tables.get(name, table)
            added = self.unfiltered[name].take(np.searchsorted(self.unfiltered[name].rows, own.rows))
            columns = {n: c for n, c in added.columns.items() if column_before(n) is not None}
            provenance = self.unfiltered[name].provenance
            made = Table(
                name=name,
                columns={**own.columns, **columns},
                rows=own.rows,
                provenance=provenance,
                key=own.key,
                groups=own.groups,
            )
            self.tables[name] = made
        return self.tables[name]


def looking_back(block: Block) -> Block:
    """The block; if it mentions the row before, the first rows of keys are unused."""
    nodes = [n for case in block.cases for e in case.equations for n in e.stated]
    nodes += [n for case in (block.when.cases if block.when is not None else ()) for n in case.values]
    return replace(block, earlier=looks_back(nodes, (case.static for case in block.cases)))
