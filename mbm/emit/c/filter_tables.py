"""``<problem>_tables.h`` of a generated filter: tables from files, their sequences, and one step after the other."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.header import table_fields
from mbm.emit.c.reading import program_head, read_functions, rows_chosen, tables_head, tables_struct
from mbm.emit.c.text import literal
from mbm.emit.filtering.types import FilterBlueprint, WindowShape
from mbm.emit.types import Blueprint, TableShape
from mbm.machine.c import number
from mbm.problem.requests import ROUNDING


def tables_file(made: FilterBlueprint) -> str:
    """``<problem>_tables.h``: tables from CSV files, the rows of one sequence, and of one step after the other."""
    files = made.files
    name = files.identifier
    lines = [*tables_head(files, ": its tables from CSV files, step by step.", len(files.tables))]
    lines += [] if made.window is None else ["#include <float.h>", ""]
    lines += ["/* The columns of all files. */", "typedef struct {"]
    lines += [line for table in files.tables for line in table_fields(table)]
    lines += [f"}} {name}_data;", "", *tables_struct(files), *read_functions(files)]
    lines += [] if made.window is None else _windows(files, made.window)
    return "\n".join([*lines, *_steps(made), *_in_order(made), *_next(made)])


def _stepped(made: FilterBlueprint) -> list[TableShape]:
    return [table for table in made.files.tables if table.name in made.given]


def _steps(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "/* The steps of a sequence: the rows of one of them, and how many of each table are gone through. */"
    yield f"struct {name}_steps {{"
    yield f"    {name}_rows here;"
    yield f"    long done[{len(_stepped(made))}];"
    yield "};"
    yield ""


def _in_order(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "/* 0: the rows of a sequence are not in the order of their steps. */"
    yield f"static int {name}_in_order(const {name}_data *data)"
    yield "{"
    yield "    long i;"
    yield ""
    for table in _stepped(made):
        key = _key(made, table)
        yield f"    for (i = 1; i < data->{table.identifier}_rows; i++)"
        yield f"        if (!({key.format('i - 1')} <= {key.format('i')})) {{"
        yield '            fputs("error: the rows are not in the order of ", stderr);'
        yield f"            fputs({literal(made.plan.key)}, stderr);"
        yield '            fputs("\\n", stderr);'
        yield "            return 0;"
        yield "        }"
    yield "    return 1;"
    yield "}"
    yield ""


def _key(made: FilterBlueprint, table: TableShape) -> str:
    column = table.column(made.plan.key)
    return f"data->{table.identifier}_{column.identifier}[{{}}]"


def _next(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield "/* The rows of the next step, in `here`; 0: there is none. */"
    yield f"static int {name}_next_step(const {name}_data *data, struct {name}_steps *steps)"
    yield "{"
    yield f"    {name}_rows *here = &steps->here;"
    yield "    int found = 0;"
    yield ""
    for position, table in enumerate(_stepped(made)):
        key = _key(made, table).format(f"steps->done[{position}]")
        yield f"    if (steps->done[{position}] < data->{table.identifier}_rows"
        yield f"        && (!found || {key} < here->at)) {{"
        yield f"        here->at = {key};"
        yield "        found = 1;"
        yield "    }"
    for position, table in enumerate(_stepped(made)):
        key = _key(made, table).format(f"steps->done[{position}]")
        yield f"    here->{table.identifier}_rows = 0;"
        for column in made.blueprint.table(table.name).columns:
            held = f"{table.identifier}_{column.identifier}"
            yield f"    here->{held} = data->{held} + steps->done[{position}];"
        yield f"    while (steps->done[{position}] < data->{table.identifier}_rows && {key} == here->at) {{"
        yield f"        here->{table.identifier}_rows++;"
        yield f"        steps->done[{position}]++;"
        yield "    }"
    yield "    return found;"
    yield "}"
    yield ""
    yield "#endif"
    yield ""


def _windows(files: Blueprint, window: WindowShape) -> Iterator[str]:
    """The windows over the rows of a sequence, as `mbm.equations.windows` has them."""
    name = files.identifier
    having = [t for t in files.tables if any(c.name == window.column for c in t.columns)]
    spans = _observed(files, window) or having
    yield "/* Where the first window ends, and by how much rows may miss an end; how many windows there are. */"
    yield f"static long {name}_windows(const {name}_data *data, double *first, double *slack)"
    yield "{"
    yield "    double last = -HUGE_VAL;"
    yield "    long row;"
    yield ""
    yield "    *first = HUGE_VAL;"
    for table in spans:
        cell = f"data->{table.identifier}_{table.column(window.column).identifier}[row]"
        yield f"    for (row = 0; row < data->{table.identifier}_rows; row++) {{"
        yield f"        *first = {cell} < *first ? {cell} : *first;"
        yield f"        last = {cell} > last ? {cell} : last;"
        yield "    }"
    yield "    if (!(*first <= last))"
    yield "        return 0;"
    yield f"    *slack = {number(ROUNDING * window.step)} + 4.0 * DBL_EPSILON * fmax(fabs(*first), fabs(last));"
    yield f"    return (long)floor((last - *first + *slack) / {number(window.step)}) + 1;"
    yield "}"
    yield ""
    yield "/* The rows of the window with this end; 0: they do not fit into the memory. */"
    yield f"static int {name}_window(const {name}_data *data, double end, double slack, {name}_data *chosen)"
    yield "{"
    yield f"    const double begin = end - {number(window.length)} + slack;"
    yield "    long row, count;"
    yield ""
    yield "    *chosen = *data;"

    def kept(table: TableShape) -> str:
        if table not in having:
            return ""
        cell = f"data->{table.identifier}_{table.column(window.column).identifier}[row]"
        return f"{cell} > begin && {cell} <= end + slack"

    yield from rows_chosen(files, kept)
    yield "    return 1;"
    yield "}"
    yield ""


def _observed(files: Blueprint, window: WindowShape) -> list[TableShape]:
    """The tables with the windows' column that observations use."""
    return [t for t in files.tables if t.name in window.observed and any(c.name == window.column for c in t.columns)]


def each_window(
    made: FilterBlueprint, head: str, call: str, answers: tuple[str, str], variable: str = ""
) -> Iterator[str]:
    """A function that does something with all windows of `data`: ``call`` with the rows `own` of each.

    Its ``answers`` are where memory fails, and at the end.
    """
    files, window = made.files, made.window
    if window is None:
        return
    name = files.identifier
    rows = [f"own.{table.identifier}_rows" for table in _observed(files, window)]
    yield "/* All windows, one after the other. */"
    yield head
    yield "{"
    yield "    double first, slack;"
    yield f"    const long count = {name}_windows(data, &first, &slack);"
    yield "    long number;"
    yield from (f"    {variable};",) if variable else ()
    yield ""
    yield "    for (number = 0; number < count; number++) {"
    yield f"        const double end = first + (double)number * {number(window.step)};"
    yield f"        {name}_data own;"
    yield f"        if (!{name}_window(data, end, slack, &own)) {{"
    yield '            fputs("error: the rows of a window do not fit into the memory\\n", stderr);'
    yield f"            return {answers[0]};"
    yield "        }"
    yield f"        if ({' + '.join(rows) or '0'} >= {window.least})"
    yield f"            {call}"
    yield f"        {name}_free_columns(&own);"
    yield "    }"
    yield f"    return {answers[1]};"
    yield "}"
    yield ""


def heads(made: FilterBlueprint, doc: str) -> Iterator[str]:
    """How a program begins that filters tables, ``doc`` in words."""
    yield from program_head(made.blueprint, doc)
    yield f"static {made.blueprint.identifier}_filter filter;"
    yield ""


def begun(made: FilterBlueprint) -> Iterator[str]:
    """Statements that begin the filter of the sequence with these `data`."""
    name = made.blueprint.identifier
    yield "    memset(&steps, 0, sizeof steps);"
    for table in map(made.blueprint.table, made.beside):
        for field in ("rows", *(column.identifier for column in table.columns)):
            yield f"    given.{table.identifier}_{field} = data->{table.identifier}_{field};"
    yield f"    {name}_begin(&filter{', &given' if made.beside else ''});"
