"""What names mean inside a problem: unknowns, constants, cameras, definitions, and the columns of the row at hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field

from mbm.expression.nodes import Column, ColumnMember, Member, Number, Sampling
from mbm.expression.rows import Row, RowChoice
from mbm.expression.units import parse_unit
from mbm.language import faults
from mbm.language.scope import LocalScope, opened, scalar
from mbm.language.values import Array, Evaluator, Scope, StaticColumnNeeded, TableName, TextColumn, Value
from mbm.problem import faults as problem_faults
from mbm.problem.aggregates import AggregateKind
from mbm.problem.tables import ROW, CellKey, Column as TableColumn, Table
from mbm.text.types import Form, MbmError, Sequence, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Entry:
    """A name of the problem: its value (made when first needed), what it is, and where it is declared.

    ``at_step`` makes the value of a state, given what picks the member.
    """

    kind: str
    span: Span
    make: Callable[[], Value] = field(repr=False)
    at_step: Callable[[Member], Value] | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The column whose values are the steps, the table that is made of them, and that of the steps reached, where the
    column ``previous`` names the step before and ``interval`` is the time to the step.
    """

    column: str
    table: str
    reached: str
    previous: str
    interval: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Here:
    """Where a form is evaluated: for the rows of ``table``, with what picks the states' members there.

    ``interval``: the time to the step, in transitions.
    """

    table: str | None = None
    member: Member | None = None
    interval: Column | None = None


def _here(steps: Steps | None, table: Table | None, row: Row) -> Here:
    """Where forms are that stand in the ``row`` of ``table``; in transitions states are those of the step before."""
    if table is None:
        return Here()
    if steps is None or steps.column not in table.columns:
        return Here(table=table.name)
    if table.name != steps.reached:
        return Here(table=table.name, member=ColumnMember(table=table.name, column=steps.column, row=row))
    before = ColumnMember(table=table.name, column=steps.previous, row=row)
    return Here(table=table.name, member=before, interval=Column(table.name, steps.interval, row))


class ProblemScope:
    """The problem's own names over those of the file. Entries are added while the clauses are read, in order.

    ``gather`` makes aggregates over the rows of a table, in the clauses that may have them; ``earlier`` gives a table
    the columns of the row before. ``divided`` are the columns of ``for-each``, and what that of ``window`` is called.
    """

    def __init__(self, parent: Scope, tables: Mapping[str, Table]) -> None:
        self._parent = parent
        self.tables = tables
        self.entries: dict[str, Entry] = {}
        self.definitions: dict[str, Form] = {}
        self.derived_over: dict[str, tuple[str, Form]] = {}
        self.evaluator: Evaluator | None = None
        self.earlier: Callable[[Table], Table] | None = None
        self.gather: Callable[[AggregateKind, Sequence, Scope], Value] | None = None
        self.steps: Steps | None = None
        self.divided: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
        self._values: dict[str, Value] = {}
        self._open: list[str] = []
        self._here: Here = Here()
        self._placed = 0

    def add(self, name: str, entry: Entry) -> None:
        """Declare a name; two declarations of one name are an error."""
        other = self.entries.get(name)
        if other is not None:
            raise MbmError(faults.duplicate_definition(entry.span, name, other.span))
        self.entries[name] = entry

    def own(self, name: str, span: Span) -> Value | None:
        """The value of a name that the problem declares."""
        if name in self._values:
            return self._values[name]
        entry = self.entries.get(name)
        if entry is None:
            return None
        placed = self._placed
        with opened(self._open, name, span):
            value = entry.make() if entry.at_step is None else entry.at_step(self._step(name, span))
        if self._placed == placed:  # what mentions a state is another thing at every step
            self._values[name] = value
        return value

    @contextmanager
    def standing(self, table: Table | None, row: Row = RowChoice.EACH) -> Iterator[None]:
        """Forms inside are evaluated for rows of ``table``: states are those of the rows' steps."""
        with self.at(_here(self.steps, table, row)):
            yield

    @contextmanager
    def at(self, here: Here) -> Iterator[None]:
        """Forms inside are evaluated ``here``."""
        before, self._here = self._here, here
        try:
            yield
        finally:
            self._here = before

    @property
    def here(self) -> Here:
        """Where forms are being evaluated."""
        return self._here

    def _step(self, name: str, span: Span) -> Member:
        """What picks the member of a state ``name`` that belongs to the row at hand.

        Raises:
            MbmError: there is no such row.

        """
        self._placed += 1
        if self._here.member is None:
            column = self.steps.column if self.steps is not None else ""
            raise MbmError(problem_faults.state_without_step(span, name, column, self._here.table))
        return self._here.member

    def defined(self, name: str, scope: Scope, span: Span) -> Value | None:
        """The value in ``scope`` of a name of a ``define`` clause: columns are those of the place where it is used."""
        form = self._form_of(name, scope)
        if form is None or self.evaluator is None:
            return None
        with opened(self._open, name, span):
            return self.evaluator.wanted(form, scope)

    def defines(self, name: str) -> bool:
        """Whether a ``define`` clause, or a quantity derived for each row, has this name."""
        return name in self.definitions or name in self.derived_over

    def _form_of(self, name: str, scope: Scope) -> Form | None:
        """The form of a definition, or of a quantity derived for each row of the table whose row ``scope`` is."""
        if name in self.derived_over and isinstance(scope, RowScope):
            table, form = self.derived_over[name]
            return form if scope.table.name == table else None
        return self.definitions.get(name)

    def lookup(self, name: str, span: Span) -> Value | None:
        """A name outside of any row."""
        value = self.own(name, span)
        if value is None:
            value = self.defined(name, self, span)
        return value if value is not None else self.outer(name, span)

    def outer(self, name: str, span: Span) -> Value | None:
        """A name of the file, or a table."""
        if name in self.derived_over:
            raise MbmError(problem_faults.derived_elsewhere(span, name, self.derived_over[name][0]))
        return TableName(name) if name in self.tables else self._parent.lookup(name, span)

    def names(self) -> Iterator[str]:
        """All names of the problem, then those of the file."""
        yield from self.entries
        yield from self.definitions
        yield from self.derived_over
        yield from self._parent.names()

    def columns(self) -> None:
        """No row is at hand."""


class RowScope:
    """The columns of one row of a table over the problem's names.

    ``static`` holds the columns whose values are known for the rows at hand; they are literals here. ``around`` is the
    scope in which ``(first TABLE FORM)`` stands: the variables of ``let`` and of functions there are visible, the
    columns of other tables are not. ``sampling`` is the time that the row stands before or after.
    """

    def __init__(
        self,
        problem: ProblemScope,
        table: Table,
        static: Mapping[str, CellKey],
        row: Row = RowChoice.EACH,
        around: Scope | None = None,
        sampling: Sampling | None = None,
    ) -> None:
        self._problem = problem
        self._sampling = sampling
        self.table = table
        self.static = static
        self._row = row
        self._around = around
        self._defined: dict[str, Value] = {}

    def lookup(self, name: str, span: Span) -> Value | None:
        """A column, or a name of the problem; a plain name that is both is ambiguous."""
        cell = self._cell(name, span)
        local = self.local(name)
        if cell is not None:
            if local is not None:
                raise MbmError(faults.ambiguous_name(span, name, self.table.name, "variable", None))
            entry = self._problem.entries.get(name)
            if entry is not None and entry.kind in ("unknown", "constant", "state"):
                raise MbmError(faults.ambiguous_name(span, name, self.table.name, entry.kind, entry.span))
            return cell
        if local is not None:
            return local
        value = self._problem.own(name, span)
        if value is None and self._problem.defines(name):
            value = self._defined.get(name)
            if value is None:
                value = self._problem.defined(name, self, span)
                if value is not None:
                    self._defined[name] = value
        if value is None and name == ROW:
            return self._row_number(span)
        return value if value is not None else self._problem.outer(name, span)

    @property
    def at_hand(self) -> bool:
        """Whether this is the row that equations speak of, not one that was chosen or is sampled."""
        return self._row is RowChoice.EACH and self._sampling is None

    def local(self, name: str) -> Value | None:
        """The variable of this name of a ``let`` or a function around the form that chose this row."""
        scope = self._around
        while isinstance(scope, LocalScope):
            if name in scope.variables:
                return scope.variables[name]
            scope = scope.parent
        return scope.local(name) if isinstance(scope, RowScope) else None

    def names(self) -> Iterator[str]:
        """The columns, then the problem's names."""
        yield from self.table.columns
        yield from self.table.groups
        yield from self._problem.names()

    def columns(self) -> tuple[str, tuple[str, ...]]:
        """Those of the table."""
        return self.table.name, tuple(self.table.columns)

    def _cell(self, name: str, span: Span) -> Value | None:
        """The cell of a column, or the vector or matrix that a group of columns holds; ``TABLE.x`` is ``x`` too."""
        for plain in (name, name.removeprefix(f"{self.table.name}.")):
            column, group = self.table.columns.get(plain), self.table.groups.get(plain)
            if column is not None:
                return self._reference(column, span)
            if group is not None:
                cells = [self._reference(self.table.columns[each], span) for each in group.columns]
                return Array(group.shape, tuple(scalar(cell, span) for cell in cells))
        return None

    def _row_number(self, span: Span) -> Value:
        if ROW in self.static:
            return Number(int(self.static[ROW]), None, span)
        return Column(self.table.name, ROW, self._row, span, sampling=self._sampling)

    def _reference(self, column: TableColumn, span: Span) -> Value:
        if column.name in self.static:
            known = self.static[column.name]
            return known if isinstance(known, str) else _stated(known, column, span)
        if column.is_text and self._sampling is not None:
            raise MbmError(faults.wrong_kind(span, "a number", f"the text column `{column.name}`"))
        if column.is_text:
            position = column.first_text()
            sample = column.texts[position] if column.texts is not None and position is not None else None
            place = self.table.place(position, column.name) if position is not None else None
            return TextColumn(self.table.name, column.name, self._row, sample, place)
        return Column(self.table.name, column.name, self._row, span, sampling=self._sampling)


class MemberScope:
    """The columns of the row that a key names in the table of a family, over the problem's names.

    The key's own column is the key: a literal, or a column of the row at hand. A column of texts makes that column
    static; ``read`` hears of the columns whose texts were asked for.
    """

    def __init__(
        self,
        problem: ProblemScope,
        table: Table,
        member: Member,
        key: str | float | Column | TextColumn,
        read: Callable[[str], None],
    ) -> None:
        self._problem = problem
        self._table = table
        self._member = member
        self._key = key
        self._read = read

    def lookup(self, name: str, span: Span) -> Value | None:
        """A column of the member's row, or a name of the problem."""
        column = self._table.columns.get(name)
        if column is None:
            return self._problem.lookup(name, span)
        if name == self._table.key:
            return Number(_exact(self._key), None, span) if isinstance(self._key, float) else self._key
        if column.is_text:
            return self._text(column, span)
        return Column(self._table.name, name, RowChoice.KEYED, span, member=self._member)

    def _text(self, column: TableColumn, span: Span) -> Value:
        if isinstance(self._key, Column | TextColumn):
            raise StaticColumnNeeded(self._key, span)
        self._read(column.name)
        row = list(self._table.keys()).index(self._key)
        return str(column.cell(row))

    def names(self) -> Iterator[str]:
        """The columns, then the problem's names."""
        yield from self._table.columns
        yield from self._problem.names()

    def columns(self) -> tuple[str, tuple[str, ...]]:
        """Those of the member's table."""
        return self._table.name, tuple(self._table.columns)


def _stated(cell: float, column: TableColumn, span: Span) -> Number:
    """A cell whose value is known, with what the column says of its unit."""
    unit = parse_unit(column.unit) if column.unit is not None else None
    if unit is None:
        return Number(_exact(cell), None, span)
    return Number(_exact(cell), unit.dimension, span, absolute=unit.zero != 0)


def _exact(value: CellKey) -> int | float:
    number = float(value)
    return int(number) if number.is_integer() else number
