"""``(mean TABLE FORM)``, ``rms median min max quantile count``: aggregates over the rows of a table.

In derived quantities an aggregate is an input that is computed from all rows before; its derivatives follow from those
of FORM. In constraints it is written out row by row, since solvers see each constraint as a formula of its own. Where
``for-each`` or ``window`` divides the table, the formula is that of the most rows that a solve can have: it reads each
row by its place and knows how many there are. Rows behind the last are those of the last, and count for nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import field, replace
from functools import partial, reduce
from math import ceil, floor
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

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
    leaves,
)
from mbm.expression.rows import RowChoice
from mbm.expression.units import NONE
from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope, condition, scalar, static_number
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, Scope, StaticColumnNeeded, TableName, Value
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate, AggregateKind, WrittenOut
from mbm.problem.elaboration import Workspace
from mbm.problem.reading.declarations import read_window
from mbm.problem.requests import Window
from mbm.problem.scopes import Here, ProblemScope, RowScope
from mbm.problem.tables import ROW, Table
from mbm.problem.types import Static
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """The value of FORM in each row, and how many ``rows`` count, which are the first ones; None: all that there are.

    The first ``sure`` ones count in every solve.
    """

    values: tuple[Expression, ...]
    rows: Expression | None
    sure: int
    span: Span

    @property
    def count(self) -> Expression:
        """How many rows count."""
        return Number(len(self.values), NONE, self.span) if self.rows is None else self.rows

    def otherwise(self, other: Expression) -> tuple[Expression, ...]:
        """The values, and ``other`` in place of those that do not count."""
        return tuple(value if i < self.sure else self._chosen(i, value, other) for i, value in enumerate(self.values))

    def _chosen(self, place: int, value: Expression, other: Expression) -> Expression:
        counts = Apply(Operation.LESS, (number(place), self.count), span=self.span)
        return algebra.apply(Operation.IF, counts, value, other, span=self.span)

    def blended(self, place: int, other: Expression) -> Expression:
        """The value of a place if it counts, else ``other``: weighted by 1 and 0, which a solver of many such has made
        in a fifth of the time that choices take.
        """
        ahead = algebra.subtract(self.count, number(place), self.span)
        counts = algebra.apply(Operation.MINIMUM, number(1), ahead, span=self.span)
        counts = algebra.apply(Operation.MAXIMUM, number(0), counts, span=self.span)
        rest = algebra.multiply(algebra.subtract(number(1), counts, self.span), other, self.span)
        return algebra.add(algebra.multiply(counts, self.values[place], self.span), rest, self.span)


@dataclass(slots=True)
class Writer:
    """Writes aggregates out; the columns of ``for_each`` and the clauses ``windows`` say which tables are divided."""

    work: Workspace
    for_each: tuple[str, ...]
    windows: list[Sequence]

    def __call__(self, kind: AggregateKind, form: Sequence, scope: Scope) -> Value:
        """The formula of an aggregate."""
        work, asked = self.work, asked_for(self.work, kind, form, scope)
        table = asked.table
        window = read_window(work, self.windows, self.for_each)
        columns = self.for_each if window is None else (*self.for_each, window.column)
        divided = any(column in table.columns for column in columns)
        least, count = self._row_counts(table, window) if divided else (len(table), len(table))
        if not count and kind is not AggregateKind.COUNT:
            raise MbmError(faults.aggregate_of_nothing(form.span, table.name))
        most, _ = work.evaluator.budget.limits.written_out()
        if count > most:
            raise MbmError(faults.too_many_operations(form.span, most))
        work.reads.everything = True  # the cells decide what the formula is
        work.written_out.append(WrittenOut(kind=kind, table=table.name, span=form.span))
        try:
            rows = [self._in_row(asked, i, scope, divided=divided) for i in range(count)]
        except StaticColumnNeeded as need:
            raise MbmError(faults.cell_of_divided_rows(need.span, need.column.name, table.name)) from None
        shape = rows[0][0] if rows else None
        if any(isinstance(leaf, Column) and leaf.row is RowChoice.EACH for _, each in rows for leaf in leaves(each)):
            message = "`previous` cannot stand in an aggregate that a constraint writes out"
            raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
        if any(each[0] != shape for each in rows):
            raise MbmError(faults.unequal_branches(form.span))
        combine = partial(_quantile, level=asked.level) if kind in _ORDERED else _FORMULAS[kind]
        sure = 0 if kind is AggregateKind.COUNT and divided else least  # solves without rows have no other
        known = Column(table.name, ROW, RowChoice.COUNT, form.span) if sure < count else None
        parts = zip(*(elements for _, elements in rows), strict=True) if rows else [()]
        return assembled(
            shape, tuple(combine(_Rows(values=each, rows=known, sure=sure, span=form.span)) for each in parts)
        )

    def _row_counts(self, table: Table, window: Window | None) -> tuple[int, int]:
        """The fewest rows of a table that a solve with some of them has, and the most that one can have.

        A window may have as many as end at one of its rows.
        """
        parts: dict[tuple[object, ...], list[int]] = {}
        cells = [table.keys(column) for column in self.for_each if column in table.columns]
        for place in range(len(table)):
            parts.setdefault(tuple(each[place] for each in cells), []).append(place)
        if window is None or window.column not in table.columns:
            counts = [len(places) for places in parts.values()]
            return min(counts, default=0), max(counts, default=0)
        most = 0
        for places in parts.values():
            times = np.sort(table.numbers(window.column)[places])
            first = np.searchsorted(times, times - window.length, side="left")
            most = max(most, int(np.max(np.searchsorted(times, times, side="right") - first)))
        return min(most, 1), most

    def _in_row(self, asked: Asked, place: int, scope: Scope, *, divided: bool) -> Elements:
        """What FORM is in one row, with its cells unless the table is ``divided``; states are those of its step."""
        world, table = self.work.scope, asked.table
        if divided:
            with world.standing(table, place):
                return elements_of(self.work, asked, RowScope(world, table, {}, place, scope))
        cells = {ROW: float(table.rows[place]), **{name: c.cell(place) for name, c in table.columns.items()}}
        known = world.steps is not None and world.steps.column in cells
        member = LiteralMember(key=cells[world.steps.column]) if world.steps is not None and known else None
        with world.at(Here(table=table.name, member=member)):
            return elements_of(self.work, asked, RowScope(world, table, cells, RowChoice.EACH, scope))


def _sum(rows: _Rows) -> Expression:
    return algebra.total(rows.otherwise(number(0)), rows.span) if rows.values else Number(0, None, rows.span)


def _mean(rows: _Rows) -> Expression:
    return algebra.divide(_sum(rows), rows.count, rows.span)


def _rms(rows: _Rows) -> Expression:
    squares = tuple(algebra.multiply(value, value, rows.span) for value in rows.values)
    return algebra.apply(Operation.SQRT, _mean(replace(rows, values=squares)), span=rows.span)


def _extreme(operation: Operation) -> Callable[[_Rows], Expression]:
    """The least or greatest of all: those behind the last row are the last one's."""
    return lambda rows: reduce(lambda a, b: algebra.apply(operation, a, b, span=rows.span), rows.values)


def _quantile(rows: _Rows, level: float) -> Expression:
    """Linear between the values in their order: of value k the part 1 − |h − k|, where h = level·(rows − 1).

    Where not all count, ⌊level·(those that do not)⌋ of these are the least and the others the greatest of all: h then
    lies within 1 below level·(all − 1), and two or three of the values in their order decide.
    """
    span, ordered = rows.span, list(rows.values)
    at = level * (len(ordered) - 1)
    places = range(max(floor(at) - (rows.rows is not None), 0), ceil(at) + 1)
    if rows.rows is None:
        shares: list[Expression] = [Number(max(0.0, 1 - abs(at - k)), NONE, span) for k in places]
    else:
        share, lacking = Number(level, NONE), algebra.subtract(number(len(ordered)), rows.rows, span)
        low = algebra.apply(Operation.FLOOR, algebra.multiply(share, lacking, span), span=span)
        least, greatest = (_FORMULAS[kind](rows) for kind in (AggregateKind.MINIMUM, AggregateKind.MAXIMUM))
        for i in range(rows.sure, len(ordered)):
            more = floor(level * (len(ordered) - i)) > floor(level * (len(ordered) - i - 1))
            ordered[i] = rows.blended(i, least if more else greatest)
        within = algebra.multiply(share, algebra.subtract(rows.rows, number(1), span), span)
        distances = [algebra.subtract(algebra.add(low, within, span), number(k), span) for k in places]
        nearness = [algebra.subtract(number(1), algebra.apply(Operation.ABS, d, span=span), span) for d in distances]
        shares = [algebra.apply(Operation.MAXIMUM, number(0), each, span=span) for each in nearness]
    for lower, upper in exchanges(len(ordered)):
        pair = ordered[lower], ordered[upper]
        ordered[lower] = algebra.apply(Operation.MINIMUM, *pair, span=span)
        ordered[upper] = algebra.apply(Operation.MAXIMUM, *pair, span=span)
    return algebra.dot(tuple(shares), tuple(ordered[k] for k in places), span)


def exchanges(count: int) -> Iterator[tuple[int, int]]:
    """Pairs of places that sort any ``count`` values where the lesser of each goes to the first: Batcher's merge sort.

    Source: Knuth, The Art of Computer Programming 3, section 5.2.2, algorithm M.
    """
    width = 1
    while width < count:
        apart = width
        while apart:
            for start in range(apart % width, count - apart, 2 * apart):
                for lower in range(start, min(start + apart, count - apart)):
                    if lower // (2 * width) == (lower + apart) // (2 * width):
                        yield lower, lower + apart
            apart //= 2
        width *= 2


_ORDERED = frozenset({AggregateKind.MEDIAN, AggregateKind.QUANTILE})
"""Aggregates of the values in their order."""

_FORMULAS: Mapping[AggregateKind, Callable[[_Rows], Expression]] = MappingProxyType(
    {
        AggregateKind.MEAN: _mean,
        AggregateKind.RMS: _rms,
        AggregateKind.MINIMUM: _extreme(Operation.MINIMUM),
        AggregateKind.MAXIMUM: _extreme(Operation.MAXIMUM),
        AggregateKind.COUNT: _sum,
    }
)
"""All other aggregates."""


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
class Asked:
    """An aggregate as it is written."""

    kind: AggregateKind
    table: Table
    level: float
    form: Form | None
    span: Span


def asked_for(work: Workspace, kind: AggregateKind, form: Sequence, scope: Scope) -> Asked:
    """The aggregate that ``form`` says."""
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
    return Asked(kind=kind, table=work.table(form.items[1]), level=level, form=last, span=form.span)


def elements_of(work: Workspace, asked: Asked, scope: Scope) -> Elements:
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


def assembled(shape: tuple[int, ...] | None, elements: tuple[Expression, ...]) -> Value:
    """The value that elements make."""
    return elements[0] if shape is None else Array(shape, elements)


@dataclass(slots=True)
class Gatherer:
    """Makes the aggregates of derived quantities; ``found`` are those so far."""

    work: Workspace
    found: list[Aggregate] = field(default_factory=list)

    def __call__(self, kind: AggregateKind, form: Sequence, scope: Scope) -> Value:
        """The value of an aggregate: the numbers that stand for it."""
        work, asked = self.work, asked_for(self.work, kind, form, scope)
        outer = _of_the_row(scope)

        def rows(inner: Scope) -> Elements:
            found = elements_of(work, asked, inner)
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
        return assembled(shape, tuple(Component(a.name, (), None, a.angle, form.span) for a in made))

    def _aggregate(self, asked: Asked, cases: list[tuple[Static, Expression]]) -> Aggregate:
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
