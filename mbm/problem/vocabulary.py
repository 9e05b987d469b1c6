"""What knows the problem: ``(first TABLE FORM)``, ``(last TABLE FORM)``, ``(sample …)``; ``(dt)``,
``(rate x)``; and ``(previous FORM)``, FORM with the columns of the row before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from types import MappingProxyType

import numpy as np

from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope
from mbm.language.values import Builtin, Call, Evaluator, FunctionTable, Macro, Scope, SpecialForm, Value
from mbm.problem import faults
from mbm.problem.previous import column_before, looks_back, name_before, row_before, with_rows_before
from mbm.problem.sampling import sample
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.sequence.types import RATE
from mbm.problem.tables import Column as TableColumn, Table
from mbm.problem.types import Block
from mbm.text.types import MbmError, Sequence, Span, Symbol
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


def _chosen(row: RowChoice) -> SpecialForm:
    def special(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
        usage = f"({row.value} TABLE form)"
        if len(form.items) != 3 or not isinstance(form.items[1], Symbol):
            raise MbmError(language_faults.bad_form(form.span, f"`{row.value}` takes a table and a form", usage))
        world, name = evaluator.world, form.items[1]
        tables = world.tables if isinstance(world, ProblemScope) else {}
        if not isinstance(world, ProblemScope) or name.name not in tables:
            raise MbmError(faults.unknown_table(name.span, name.name, tuple(tables)))
        table = tables[name.name]
        with world.standing(table, row):
            return evaluator.wanted(form.items[2], RowScope(world, table, {}, row, scope))

    return special


SPECIAL_FORMS: Mapping[str, SpecialForm] = MappingProxyType(
    {**{choice.value: _chosen(choice) for choice in (RowChoice.FIRST, RowChoice.LAST)}, "sample": sample}
)
"""Added to the special forms while a problem is compiled."""


def _interval(call: Call) -> Value:
    world = call.evaluator.world
    interval = world.here.interval if isinstance(world, ProblemScope) else None
    if interval is None:
        message = "`(dt)` is the time to the step that a transition reaches"
        raise MbmError(language_faults.bad_form(call.span, message, "(= (next x) (+ x (* (dt) v)) :sigma q)"))
    return interval


class _Rate(Macro):
    """``(rate x)``."""

    __slots__ = ()
    name, usage = "rate", "(rate x)"
    doc = "The rate of a state that goes on with constant velocity, per unit of the steps' column in SI."

    def call(self, call: Call) -> Value:
        """The state that ``constant-velocity`` adds."""
        world, forms = call.evaluator.world, call.forms
        if len(forms) != 1 or not isinstance(forms[0], Symbol):
            raise MbmError(language_faults.bad_form(call.span, "`rate` takes the name of a state", "(rate x)"))
        name = forms[0].name + RATE
        if not isinstance(world, ProblemScope) or name not in world.entries:
            raise MbmError(faults.state_without_rate(forms[0].span, forms[0].name))
        return call.evaluator.wanted(Symbol(name=name, span=call.span), call.scope)


FUNCTIONS: FunctionTable = MappingProxyType(
    {
        "dt": Builtin("dt", "(dt)", "The time to the step that a transition reaches.", 0, 0, _interval),
        "rate": _Rate(),
    }
)
"""Functions of problems with states; a definition of the user's goes before."""
