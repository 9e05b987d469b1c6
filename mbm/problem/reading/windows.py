"""``(window COLUMN :length L :step S [:min-rows n])``: one problem for each sliding window of the rows."""

from __future__ import annotations

from mbm.language import faults as language_faults
from mbm.language.coerce import integer
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.options import only, split_options
from mbm.problem.reading.named_columns import named_column
from mbm.problem.reading.pairs import stretch
from mbm.problem.requests import Window
from mbm.text.types import MbmError, Sequence, Symbol

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
    for table in tables:
        cells = table.columns[column]
        if cells.is_text:
            position = cells.first_text() or 0
            place = table.place(position, column)
            raise MbmError(faults.bad_time(place, column, str(cells.cell(position)), named.span))
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
