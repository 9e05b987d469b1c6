"""What all clauses share while a problem is elaborated: scopes, rows grouped by static columns, errors.

How much of a problem is compiled is bounded (`Extent`). The rows of a table share one equation, however many they are:
what is counted is written out in the problem, by hand, by ``for`` and ``sum``, or by rows that need equations of their
own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from typing import TypeAlias, TypeVar

import numpy as np

from mbm.expression.nodes import (
    CONDITIONS,
    Apply,
    Component,
    Expression,
    Number,
    Operation,
    externals,
    leaves,
    postorder,
)
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.limits import Limits
from mbm.language.scope import condition, scalar, vector
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, Scope, StaticColumnNeeded, Value, describe
from mbm.problem import faults
from mbm.problem.aggregates import WrittenOut
from mbm.problem.clauses import ANY_NAME, STATES, declared_names
from mbm.problem.elaborated import Consulted, Grouping
from mbm.problem.previous import column_before, has_before
from mbm.problem.rows import MAXIMUM_REPORTED, decided, static_cells
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.tables import CellKey, Format, Table
from mbm.problem.types import Block, Derived, Equation, RowValues, Static, ValueCase
from mbm.text.faults import MOST_FAULTS, worth_reading
from mbm.text.reader import read
from mbm.text.types import Bracket, Diagnostic, Form, Keyword, MbmError, Sequence, Source, Span, Symbol
from mbm.values import dataclass

EQUATION, CHOICE = 20, 3
"""Operations that an equation counts for by itself, and a condition or a choice by one: so much longer they take."""

_CHOICES = CONDITIONS | {Operation.IF}


class Extent:
    """Equations and operations so far. Local to one elaboration."""

    def __init__(self, limits: Limits) -> None:
        self._most_equations, self._most_operations = limits.written_out()
        self._equations = 0
        self._operations = 0

    def add(self, made: Block | Derived) -> None:
        """Count what an observation, prior, constraint or derived quantity holds.

        Raises:
            MbmError: too-much-to-compile.

        """
        if isinstance(made, Block):
            cases = [tuple(n for e in case.equations for n in (*e.stated, *_written(e))) for case in made.cases]
        else:
            cases = [case.values for case in made.cases]
        self.more(len(cases), made.span)
        self._operations += EQUATION * len(cases)
        for nodes in cases:
            self._operate(nodes, made.span)

    def more(self, equations: int, span: Span) -> None:
        """Count groups of rows that each have equations of their own.

        Raises:
            MbmError: too-much-to-compile.

        """
        self._equations += equations
        if self._equations > self._most_equations:
            raise MbmError(faults.too_many_equations(span, self._most_equations))

    def _operate(self, nodes: tuple[Expression, ...], span: Span) -> None:
        made = [node.operation for node in postorder(nodes) if isinstance(node, Apply)]
        self._operations += len(made) + (CHOICE - 1) * sum(operation in _CHOICES for operation in made)
        if self._operations > self._most_operations:
            raise MbmError(faults.too_many_operations(span, self._most_operations))


def _written(equation: Equation) -> tuple[Expression, ...]:
    """What mbm writes out for the errors of an equation."""
    return () if equation.likelihood is None else equation.likelihood.residuals


_ENDING = (language_faults.TOO_MANY_STEPS, faults.TOO_MUCH_TO_COMPILE)
"""Errors after which nothing more is looked at: what goes too far in one clause would do so in the others."""

_PER_STEP = (faults.STATE_WITHOUT_STEP, faults.DERIVED_ELSEWHERE)
"""Errors of forms outside of any row that may have a value at every step."""

Routines: TypeAlias = Callable[[], tuple[str, ...]]
"""The names of the registered closed forms: a call, since most problems name none and need not load them."""

T = TypeVar("T")


@dataclass(slots=True)
class Reads:
    """The values of the tables that decided something so far; ``filtered``: every ``:where`` has been applied."""

    groupings: dict[Grouping, None] = field(default_factory=dict)
    keyed: dict[str, None] = field(default_factory=dict)
    everything: bool = False
    filtered: bool = False

    def grouped(self, table: str, columns: Iterable[str], when: RowValues | None) -> None:
        """Rows were told apart by columns of a table."""
        self.groupings[Grouping(table=table, columns=tuple(columns), when=when, filtered=self.filtered)] = None

    def consulted(self) -> Consulted:
        """All of them."""
        return Consulted(groupings=tuple(self.groupings), keyed=tuple(self.keyed), everything=self.everything)


@dataclass(slots=True)
class Workspace:
    """The elaboration at work: local to one call, handed from clause to clause. ``diagnostics`` collects the errors.

    ``formats`` has what a data clause may say of each format; ``routines`` gives the names of the registered closed
    forms, which may be asked for as methods; ``reads`` keeps account of the values that decided something, ``extent``
    of what there is to compile; ``written_out`` are the aggregates in constraints. ``uncertain`` are the names of
    numbers of constants with a standard deviation, ``made`` has those that are made of others. ``drawing``:
    distributions may be without a variance.
    """

    evaluator: Evaluator
    scope: ProblemScope
    tables: dict[str, Table]
    formats: Mapping[str, Format] = field(default_factory=dict)
    routines: Routines = tuple
    diagnostics: list[Diagnostic] = field(default_factory=list)
    undeclared: set[str] = field(default_factory=set)
    written_out: list[WrittenOut] = field(default_factory=list)
    uncertain: set[str] = field(default_factory=set)
    made: dict[str, Expression] = field(default_factory=dict)
    drawing: bool = False
    reads: Reads = field(default_factory=Reads)
    extent: Extent = field(init=False)

    def __post_init__(self) -> None:
        self.extent = Extent(self.evaluator.budget.limits)

    @contextmanager
    def collecting(self, declares: Form | None = None) -> Iterator[None]:
        """Errors inside are kept, so that one run reports what several clauses have wrong.

        ``declares`` is a declaration, or the clause of states or a camera: that its names are unknown then is no news.
        """
        try:
            yield
        except MbmError as error:
            found = [d for d in error.diagnostics if not self._follows(d)]
            if declares is not None:
                self.undeclared |= declared_names(declares)
            self._keep(found)
            if any(d.code in _ENDING for d in found):
                raise MbmError(*self.diagnostics) from None
        except StaticColumnNeeded as need:
            self._keep([language_faults.not_static(need.span, f"column `{need.column.name}`")])

    def _keep(self, found: list[Diagnostic]) -> None:
        """Collect what is not known yet; nobody reads hundreds of errors, so looking for more ends some time."""
        known = {(d.code, d.place, d.message) for d in self.diagnostics}
        self.diagnostics.extend(d for d in found if (d.code, d.place, d.message) not in known)
        if len(self.diagnostics) > MOST_FAULTS:
            raise MbmError(*worth_reading(self.diagnostics, ended=True)) from None

    def _follows(self, diagnostic: Diagnostic) -> bool:
        """Whether an error only repeats that a declaration failed."""
        if diagnostic.code == faults.NO_STATES:
            return STATES in self.undeclared
        place = diagnostic.place if diagnostic.code == language_faults.UNKNOWN_NAME else None
        return isinstance(place, Span) and bool(self.undeclared & {place.text, ANY_NAME})

    def finish(self) -> None:
        """Raise what was collected."""
        if self.diagnostics:
            raise MbmError(*worth_reading(self.diagnostics))

    def table(self, form: Form) -> Table:
        """The table that a symbol names."""
        if not isinstance(form, Symbol) or form.name not in self.tables:
            shown = form.name if isinstance(form, Symbol) else form.span.text
            raise MbmError(faults.unknown_table(form.span, shown, tuple(self.tables)))
        return self.tables[form.name]

    def cases(
        self,
        table: Table | None,
        evaluate: Callable[[Scope], T],
        span: Span,
        when: RowValues | None = None,
        around: Scope | None = None,
    ) -> list[tuple[Static, T]]:
        """``evaluate`` once for each group of rows that need a compilation: one, unless columns are static.

        The values of rows that ``when`` does not keep decide nothing. ``around`` is where the form stands, if that is
        inside another: its variables are seen.
        """
        if table is None:
            self.evaluator.budget.reset(span)
            try:
                with self.scope.standing(None):
                    return [((), evaluate(self.scope))]
            except StaticColumnNeeded as need:
                raise MbmError(language_faults.not_static(need.span, f"column `{need.column.name}`")) from None
        every = np.arange(len(table)) if when is None else np.flatnonzero(decided(when, self.tables)[:, 0])
        columns: dict[str, None] = {}
        pending: list[tuple[Static, np.ndarray]] = [((), every)]
        found: list[tuple[Static, T]] = []
        most, _ = self.evaluator.budget.limits.written_out()
        while pending:
            static, rows = pending.pop()
            self.evaluator.budget.reset(span)
            scope = RowScope(self.scope, table, dict(static), around=around)
            try:
                with self.scope.standing(table):
                    found.append((static, evaluate(scope)))
            except StaticColumnNeeded as need:
                columns[need.column.name] = None
                pending.extend(reversed(self._split(self.tables.get(table.name, table), static, rows, need)))
            if len(found) + len(pending) > most:
                raise MbmError(faults.too_many_static_values(span, table.name, most))
        if columns:
            self.reads.grouped(table.name, columns, when)
        self.reads.everything |= not found  # which columns rows would be told apart by, only rows can say
        return found

    def cases_at_steps(
        self, table: Table | None, evaluate: Callable[[Scope], T], span: Span
    ) -> tuple[Table | None, list[tuple[Static, T]]]:
        """``cases``, for the table of steps where none is given and a state is mentioned; with the table taken."""
        try:
            return table, self.cases(table, evaluate, span)
        except MbmError as error:
            per_step = any(d.code in _PER_STEP for d in error.diagnostics)
            if table is not None or self.scope.steps is None or not per_step:
                raise
        every = self.tables[self.scope.steps.table]
        return every, self.cases(every, evaluate, span)

    def case_of_first(self, table: Table, evaluate: Callable[[Scope], T], span: Span) -> list[tuple[Static, T]]:
        """``evaluate`` once, for the first row of a table."""
        self.evaluator.budget.reset(span)
        try:
            with self.scope.standing(table, RowChoice.FIRST):
                return [((), evaluate(RowScope(self.scope, table, {}, RowChoice.FIRST)))]
        except StaticColumnNeeded as need:
            raise MbmError(language_faults.not_static(need.span, f"column `{need.column.name}`")) from None

    def _split(
        self, table: Table, static: Static, rows: np.ndarray, need: StaticColumnNeeded
    ) -> list[tuple[Static, np.ndarray]]:
        name = need.column.name
        if need.column.table != table.name or need.column.row is not RowChoice.EACH or name in dict(static):
            raise MbmError(language_faults.not_static(need.span, f"column `{name}` of `{need.column.table}`"))
        cells = static_cells(table, name)
        rows = rows[has_before(table)[rows]] if column_before(name) is not None else rows
        gaps = [int(r) for r in rows if isinstance(cells[r], float) and not math.isfinite(cells[r])]
        if gaps:
            found = [(table.place(row, name), float(cells[row])) for row in gaps[:MAXIMUM_REPORTED]]
            raise MbmError(*(faults.not_finite_cell(place, name, value, need.span) for place, value in found))
        groups: dict[CellKey, list[int]] = {}
        for row in rows:
            groups.setdefault(cells[row], []).append(int(row))
        return [((*static, (name, value)), np.asarray(group)) for value, group in groups.items()]

    def values(
        self, form: Form, table: Table | None, shape: tuple[int, ...], *, wanted: str, broadcast: bool = True
    ) -> RowValues:
        """A form per row as numbers of a shape; a scalar stands for every component. Unknowns may not occur."""
        return self.evaluated(form, table, lambda v: shaped(v, shape, form.span, broadcast=broadcast), wanted=wanted)

    def evaluated(
        self, form: Form, table: Table | None, taken: Callable[[Value], tuple[Expression, ...]], *, wanted: str
    ) -> RowValues:
        """A form per row as the numbers that ``taken`` makes of its value. Unknowns may not occur."""
        return self.row_values(form, table, lambda scope: self.evaluated_here(form, scope, taken, wanted=wanted))

    def evaluated_here(
        self, form: Form, scope: Scope, taken: Callable[[Value], tuple[Expression, ...]], *, wanted: str
    ) -> tuple[Expression, ...]:
        """The numbers of the row at hand."""
        elements = taken(self.evaluator.wanted(form, scope))
        self.refuse_unknowns(elements, form.span, wanted)
        return elements

    def conditions(self, form: Form, table: Table | None, count: int, *, wanted: str) -> RowValues:
        """A condition per row (or one for each of ``count`` components) as numbers 0 and 1."""
        return self.row_values(form, table, lambda scope: self.conditions_here(form, scope, count, wanted=wanted))

    def conditions_here(self, form: Form, scope: Scope, count: int, *, wanted: str) -> tuple[Expression, ...]:
        """The conditions of the row at hand."""
        items = self._condition_items(form, scope, count)
        if len(items) != count:
            conditions = f"a list of {len(items)} conditions"
            raise MbmError(language_faults.length_clash(form.span, conditions, f"{count} components"))
        found = tuple(_as_expression(condition(item, form.span), form.span) for item in items)
        self.refuse_unknowns(found, form.span, wanted)
        return found

    def row_values(
        self, form: Form, table: Table | None, evaluate: Callable[[Scope], tuple[Expression, ...]]
    ) -> RowValues:
        """What ``evaluate`` makes of ``form`` in the scope of each row."""
        cases = self.cases(table, evaluate, form.span)
        return RowValues(
            table=table.name if table is not None else None,
            cases=tuple(ValueCase(static=s, values=v) for s, v in cases),
            span=form.span,
        )

    def _condition_items(self, form: Form, scope: Scope, count: int) -> tuple[Value, ...]:
        """One condition for all components, or a vector (or list) of them: ``[false true false]``, arrays by rows."""
        if isinstance(form, Sequence) and form.items:
            rows = [each for each in form.items if isinstance(each, Sequence) and each.bracket is Bracket.SQUARE]
            if form.bracket is Bracket.SQUARE and len(rows) == len(form.items):
                return tuple(self.evaluator.wanted(item, scope) for row in rows for item in row.items)
            first = form.items[0]
            literal = isinstance(first, Symbol) and first.name in ("true", "false")
            if form.bracket is Bracket.SQUARE or literal:
                return tuple(self.evaluator.wanted(item, scope) for item in form.items)
        value = self.evaluator.wanted(form, scope)
        return value.items if isinstance(value, ListValue) else (value,) * count

    def refuse_unknowns(self, nodes: tuple[Expression, ...], span: Span, wanted: str) -> None:
        """``wanted`` has to be known before the solve: no unknown, and nothing that only a solve computes."""
        external = next(externals(nodes), None)
        if external is not None:
            raise MbmError(faults.external_misplaced(external, wanted))
        for leaf in leaves(nodes):
            if isinstance(leaf, Component):
                raise MbmError(faults.depends_on_unknown(leaf.span or span, wanted, leaf.unknown))


def _as_expression(value: bool | Apply, span: Span) -> Expression:
    return Number(int(value), None, span) if isinstance(value, bool) else value


def shaped(value: Value, shape: tuple[int, ...], span: Span, *, broadcast: bool = True) -> tuple[Expression, ...]:
    """The components of a number, vector or matrix, row by row; a scalar broadcasts."""
    size = int(np.prod(shape)) if shape else 1
    if not shape:
        return (scalar(value, span),)
    if broadcast and isinstance(value, SCALARS):
        return (scalar(value, span),) * size
    if len(shape) == 1:
        return vector(value, span, shape[0]).elements
    if isinstance(value, ListValue):
        value = Array((len(value.items), shape[1]), tuple(e for v in value.items for e in vector(v, span).elements))
    if not isinstance(value, Array) or value.shape != shape:
        raise MbmError(language_faults.length_clash(span, describe(value), f"shape {shape[0]}×{shape[1]}"))
    return value.elements


def pair_of(form: Form, what: str) -> tuple[Form, Form]:
    """The two forms of ``(lo hi)``."""
    if not isinstance(form, Sequence) or len(form.items) != 2 or any(isinstance(i, Keyword) for i in form.items):
        raise MbmError(language_faults.bad_form(form.span, f"`{what}` wants two ends", f"{what} (lo hi)"))
    return form.items[0], form.items[1]


def given_value(work: Workspace, name: str, text: str) -> Value:
    """The value of a text given from outside for a name."""
    source = Source(f"<{name}>", text)
    forms = read(source)
    if len(forms) != 1:
        span = Span(source=source, start=0, end=len(text))
        raise MbmError(language_faults.wrong_kind(span, "one value", f"{len(forms)} forms"))
    return work.evaluator.wanted(forms[0], work.scope)
