"""The columns by which all tables are chosen from: ``column``, or ``table.column`` for the column of that name.

``(window COLUMN :length L :step S [:min-rows n])`` makes one problem for each sliding window of the rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mbm.expression.nodes import Constant, Number, nearest
from mbm.expression.units import parse_unit
from mbm.language import faults as language_faults
from mbm.language.coerce import integer
from mbm.language.values import describe
from mbm.problem import faults
from mbm.problem.clauses import only, split_options
from mbm.problem.elaboration import Workspace
from mbm.problem.requests import Window
from mbm.problem.tables import Table
from mbm.problem.zero_points import stated_difference
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol

USAGE = "(window column :length l :step s [:min-rows n])"
MOST_ROWS_WANTED = 1_000_000_000


def read_window(work: Workspace, clauses: list[Sequence], for_each: tuple[str, ...]) -> Window | None:
    """The window that a problem asks for; ``for_each`` are the columns that choose rows besides."""
    clause = only(clauses, "window")
    if clause is None:
        return None
    options = split_options(clause.items[1:], clause.span, owner="`window`", known=("length", "step", "min-rows"))
    if len(options.positional) != 1 or not isinstance(options.positional[0], Symbol):
        raise MbmError(language_faults.bad_form(clause.span, "`window` names one column", USAGE))
    named = options.positional[0]
    length, step = options.get("length"), options.get("step")
    if length is None or step is None:
        raise MbmError(language_faults.bad_form(clause.span, "`window` wants a length and a step", USAGE))
    column = named_column(work, named)
    tables = tuple(table for table in work.tables.values() if column in table.columns)
    refuse_texts(tables, column, named.span)
    if column in for_each:
        raise MbmError(language_faults.duplicate_definition(named.span, column, clause.span))
    rows = options.get("min-rows")
    wanted = "a whole number (`:min-rows`)"
    count = 1 if rows is None else integer(work.evaluator.wanted(rows, work.scope), rows.span, wanted)
    if not 1 <= count <= MOST_ROWS_WANTED:
        where = rows.span if rows is not None else clause.span
        raise MbmError(language_faults.bad_form(where, "`:min-rows` is a whole number from 1 on", USAGE))
    return Window(
        column=column,
        length=stretch(work, length, tables, column, ":length"),
        step=stretch(work, step, tables, column, ":step"),
        min_rows=count,
        span=clause.items[0].span,
    )


def named_column(work: Workspace, form: Symbol) -> str:
    """The name of the column.

    Raises:
        MbmError: no table has it, or not the one that is named.

    """
    if any(form.name in table.columns for table in work.tables.values()):
        return form.name
    name, _, column = form.name.partition(".")
    table = work.tables.get(name) if column else None
    if table is None:
        every = tuple(dict.fromkeys(c for each in work.tables.values() for c in each.columns))
        raise MbmError(faults.unknown_column(form.span, form.name, "any table", every))
    if column not in table.columns:
        raise MbmError(faults.unknown_column(form.span, column, name, tuple(table.columns)))
    return column


def names_in(clauses: Iterable[Sequence], head: str) -> tuple[str, ...]:
    """The names of columns in the clauses with a head, as they are written."""
    return tuple(form.name for c in clauses if c.head == head for form in c.items[1:] if isinstance(form, Symbol))


def meant(names: Iterable[str], tables: Mapping[str, Table]) -> tuple[str, ...]:
    """What columns are called in ``tables``, the pairs not yet among them: ``run`` for ``P.A.run``.

    A joined column keeps the name before it; names of no column stay as they are.
    """
    known = {column for table in tables.values() for column in table.columns}
    return tuple(next((end for end in _ends(name) if end in known), name) for name in names)


def _ends(name: str) -> Iterable[str]:
    """The name, and what is left of it without the first part, the first two …"""
    parts = name.split(".")
    return (".".join(parts[i:]) for i in range(len(parts)))


def stretch(work: Workspace, form: Form, tables: tuple[Table, ...], column: str, what: str) -> float:
    """A length of time (or of whatever the column measures) above zero, in SI, that goes with the column's unit."""
    value = work.evaluator.wanted(form, work.scope)
    if not isinstance(value, Number | Constant):
        raise MbmError(language_faults.wrong_kind(form.span, "a number known while compiling", describe(value)))
    for table in tables:
        unit = table.columns[column].unit if column in table.columns else None
        known = parse_unit(unit) if unit is not None else None
        if known is not None and value.dimension is not None and value.dimension != known.dimension:
            left = f"`{form.span.text}`, {value.dimension.describe()},"
            right = f"column `{column}` of `{table.name}`, {known.dimension.describe()}"
            raise MbmError(faults.unit_clash(form.span, left, right, ()))
    stated_difference(value, form.span)
    number = nearest(value.value)
    if not 0 < number < float("inf"):
        raise MbmError(language_faults.bad_form(form.span, f"`{what}` is a number above zero", f"{what} 1s"))
    return number


def refuse_texts(tables: Iterable[Table], column: str, span: Span) -> None:
    """Refuse texts in a column of times.

    Raises:
        MbmError: bad-time.

    """
    for table in tables:
        cells = table.columns[column]
        if cells.is_text:
            position = cells.first_text() or 0
            raise MbmError(faults.bad_time(table.place(position, column), column, str(cells.cell(position)), span))
