"""``(mean TABLE FORM)``, ``rms median min max quantile count``: aggregates over the rows of a table.

In derived quantities an aggregate is an input that is computed from all rows before; its derivatives follow from those
of FORM. In constraints it is written out row by row, since solvers see each constraint as a formula of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import reduce
from types import MappingProxyType
from typing import TypeAlias

from mbm.expression import algebra
from mbm.expression.algebra import number
from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Expression,
    LiteralMember,
    Number,
    Operation,
    RowChoice,
    leaves,
)
from mbm.language import faults as language_faults
from mbm.language.coerce import condition, scalar, static_number
from mbm.language.scope import LocalScope
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, Scope, TableName, Value
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate
from mbm.problem.elaboration import Workspace
from mbm.problem.kinds import AggregateKind
from mbm.problem.scopes import Here, ProblemScope, RowScope
from mbm.problem.tables import Table
from mbm.problem.types import Static
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

LateForm: TypeAlias = Callable[[Evaluator, Sequence, Scope], Value | None]
Elements: TypeAlias = tuple[tuple[int, ...] | None, tuple[Expression, ...]]
"""The shape of a vector or matrix (None: a number) and its elements."""


def usage(kind: AggregateKind) -> str:
    """How an aggregate is written."""
    if kind is AggregateKind.QUANTILE:
        return "(quantile TABLE q form), with q from 0 to 1"
    return "(count TABLE [condition])" if kind is AggregateKind.COUNT else f"({kind.value} TABLE form)"


def _over_rows(kind: AggregateKind) -> LateForm:
    def special(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value | None:
        world, first = evaluator.world, form.items[1] if len(form.items) > 1 else None
        if not isinstance(first, Symbol) or not isinstance(scope.lookup(first.name, first.span), TableName):
            return None
        if not isinstance(world, ProblemScope) or world.gather is None:
            raise MbmError(faults.aggregate_misplaced(form.span, kind.value))
        return world.gather(kind, form, scope)

    return special


OVER_ROWS: Mapping[str, LateForm] = MappingProxyType({kind.value: _over_rows(kind) for kind in AggregateKind})
"""Heads that make an aggregate where their first argument names a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """An aggregate as it is written."""

    kind: AggregateKind
    table: Table
    level: float
    form: Form | None
    span: Span


def _asked(work: Workspace, kind: AggregateKind, form: Sequence, scope: Scope) -> _Asked:
    arguments = form.items[2:]
    wanted = {AggregateKind.QUANTILE: (2,), AggregateKind.COUNT: (0, 1)}.get(kind, (1,))
    if len(arguments) not in wanted:
        message = f"`{kind.value}` over the rows of a table takes {wanted[-1]} more"
        raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
    level = 0.5
    if kind is AggregateKind.QUANTILE:
        level = float(static_number(work.evaluator.wanted(arguments[0], scope), arguments[0].span))
        if not 0 <= level <= 1:
            message = "a quantile lies between 0 and 1"
            raise MbmError(language_faults.bad_form(arguments[0].span, message, usage(kind)))
    last = arguments[-1] if arguments else None
    return _Asked(kind=kind, table=work.table(form.items[1]), level=level, form=last, span=form.span)


def _elements(work: Workspace, asked: _Asked, scope: Scope) -> Elements:
    """What FORM is in a row: numbers, for a count 1 where the condition holds, else 0."""
    if asked.form is None:
        return None, (number(1),)
    value, span = work.evaluator.wanted(asked.form, scope), asked.form.span
    if asked.kind is AggregateKind.COUNT:
        known = condition(value, span)
        if isinstance(known, bool):
            return None, (number(int(known)),)
        return None, (Apply(Operation.IF, (known, number(1), number(0)), span=span),)
    if isinstance(value, SCALARS):
        return None, (value,)
    if isinstance(value, Array):
        return value.shape, value.elements
    if isinstance(value, ListValue):
        return (len(value.items),), tuple(scalar(item, span) for item in value.items)
    return None, (scalar(value, span),)


def _assembled(shape: tuple[int, ...] | None, elements: tuple[Expression, ...]) -> Value:
    return elements[0] if shape is None else Array(shape, elements)


@dataclass(slots=True)
class Gatherer:
    """Makes the aggregates of derived quantities; ``found`` are those so far."""

    work: Workspace
    found: list[Aggregate] = field(default_factory=list)

    def __call__(self, kind: AggregateKind, form: Sequence, scope: Scope) -> Value:
        """The value of an aggregate: the numbers that stand for it."""
        work, asked = self.work, _asked(self.work, kind, form, scope)
        outer = _of_the_row(scope)

        def rows(inner: Scope) -> Elements:
            found = _elements(work, asked, inner)
            if any(id(leaf) in outer for leaf in leaves(found[1])):
                message = "a value of the row at hand cannot stand inside an aggregate, which has rows of its own"
                raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
            return found

        cases = work.cases(asked.table, rows, form.span, around=scope)
        shapes = {shape for _, (shape, _) in cases}
        if len(shapes) > 1:
            raise MbmError(faults.unequal_branches(form.span))
        shape = next(iter(shapes), None)
        size = len(cases[0][1][1]) if cases else 1
        made = [self._aggregate(asked, [(static, each[i]) for static, (_, each) in cases]) for i in range(size)]
        return _assembled(shape, tuple(Component(a.name, (), None, a.angle, form.span) for a in made))

    def _aggregate(self, asked: _Asked, cases: list[tuple[Static, Expression]]) -> Aggregate:
        name = plain = f"{asked.kind.value}({asked.table.name})"
        taken, count = {each.name for each in self.found}, 2
        while name in taken:
            name, count = f"{plain[:-1]}, {count})", count + 1
        made = Aggregate(
            name=name,
            kind=asked.kind,
            table=asked.table.name,
            cases=tuple(cases),
            level=asked.level,
            angle=bool(cases) and asked.kind is not AggregateKind.COUNT and all(value.angle for _, value in cases),
            span=asked.span,
        )
        self.found.append(made)
        return made


def _of_the_row(scope: Scope) -> set[int]:
    """The columns of the row at hand that variables around hold."""
    found: set[int] = set()
    while isinstance(scope, LocalScope):
        for value in scope.variables.values():
            nodes = value.elements if isinstance(value, Array) else (value,) if isinstance(value, SCALARS) else ()
            found.update(id(leaf) for leaf in leaves(nodes) if isinstance(leaf, Column) and leaf.row is RowChoice.EACH)
        scope = scope.parent
    return found


@dataclass(slots=True)
class Writer:
    """Writes aggregates out, row by row; ``single``: the problem is one solve, so that its rows are known."""

    work: Workspace
    single: bool

    def __call__(self, kind: AggregateKind, form: Sequence, scope: Scope) -> Value:
        """The formula of an aggregate in the columns' values."""
        work, asked = self.work, _asked(self.work, kind, form, scope)
        if not self.single:
            raise MbmError(faults.aggregate_of_parts(form.span, kind.value))
        combine = _FORMULAS.get(kind)
        if combine is None:
            raise MbmError(faults.aggregate_in_constraint(form.span, kind.value))
        table, count = asked.table, len(asked.table)
        if not count and kind is not AggregateKind.COUNT:
            raise MbmError(faults.aggregate_of_nothing(form.span, kind.value, table.name))
        most, _ = work.evaluator.budget.limits.written_out()
        if count > most:
            raise MbmError(faults.too_many_operations(form.span, most))
        work.reads.everything = True  # the cells decide what the formula is
        work.written_out.append(form.span)
        rows = [self._of_row(asked, _cells(table, i), scope) for i in range(count)]
        shape = rows[0][0] if rows else None
        if any(isinstance(leaf, Column) and leaf.row is RowChoice.EACH for _, each in rows for leaf in leaves(each)):
            message = "`previous` cannot stand in an aggregate that a constraint writes out"
            raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
        if any(each[0] != shape for each in rows):
            raise MbmError(faults.unequal_branches(form.span))
        columns = zip(*(elements for _, elements in rows), strict=True) if rows else [()]
        return _assembled(shape, tuple(combine(tuple(each), form.span) for each in columns))

    def _of_row(self, asked: _Asked, cells: dict[str, str | float], scope: Scope) -> Elements:
        """What FORM is in the row with these cells, where states are those of the row's step."""
        world, table = self.work.scope, asked.table
        known = world.steps is not None and world.steps.column in cells
        member = LiteralMember(key=cells[world.steps.column]) if world.steps is not None and known else None
        with world.at(Here(table=table.name, member=member)):
            return _elements(self.work, asked, RowScope(world, table, cells, RowChoice.EACH, scope))


def _cells(table: Table, position: int) -> dict[str, str | float]:
    return {"row": float(table.rows[position]), **{name: c.cell(position) for name, c in table.columns.items()}}


def _mean(values: tuple[Expression, ...], span: Span) -> Expression:
    return algebra.divide(algebra.total(values, span), number(len(values)), span)


def _rms(values: tuple[Expression, ...], span: Span) -> Expression:
    return algebra.apply(Operation.SQRT, _mean(tuple(algebra.multiply(v, v, span) for v in values), span), span=span)


def _count(values: tuple[Expression, ...], span: Span) -> Expression:
    return algebra.total(values, span) if values else Number(0, None, span)


def _extreme(operation: Operation) -> Callable[[tuple[Expression, ...], Span], Expression]:
    return lambda values, span: reduce(lambda a, b: algebra.apply(operation, a, b, span=span), values)


_FORMULAS: Mapping[AggregateKind, Callable[[tuple[Expression, ...], Span], Expression]] = MappingProxyType(
    {
        AggregateKind.MEAN: _mean,
        AggregateKind.RMS: _rms,
        AggregateKind.MINIMUM: _extreme(Operation.MINIMUM),
        AggregateKind.MAXIMUM: _extreme(Operation.MAXIMUM),
        AggregateKind.COUNT: _count,
    }
)
"""Aggregates that are a formula; medians and quantiles would be one for each order of the rows."""
