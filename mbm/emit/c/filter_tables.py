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
    lines += [
        *([] if made.window is None else ["#include <float.h>", ""]),
        "/* The columns of all files. */",
        "typedef struct {",
        *[line for table in files.tables for line in table_fields(table)],
        f"}} {name}_data;",
        "",
        *tables_struct(files),
        *read_functions(files),
        *([] if made.window is None else _windows(files, made.window)),
    ]
    return "\n".join([*lines, *_steps(made), *_in_order(made), *_next(made)])


def _stepped(made: FilterBlueprint) -> list[TableShape]:
    return [table for table in made.files.tables if table.name in made.given]


def _steps(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* The steps of a sequence: the rows of one of them, and how many of each table are gone through. */",
        f"struct {name}_steps {{",
        f"    {name}_rows here;",
        f"    long done[{len(_stepped(made))}];",
        "};",
        "",
    )


def _in_order(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* 0: the rows of a sequence are not in the order of their steps. */",
        f"static int {name}_in_order(const {name}_data *data)",
        "{",
        "    long i;",
        "",
    )
    for table in _stepped(made):
        key = _key(made, table)
        yield from (
            f"    for (i = 1; i < data->{table.identifier}_rows; i++)",
            f"        if (!({key.format('i - 1')} <= {key.format('i')})) {{",
            '            fputs("error: the rows are not in the order of ", stderr);',
            f"            fputs({literal(made.plan.key)}, stderr);",
            '            fputs("\\n", stderr);',
            "            return 0;",
            "        }",
        )
    yield from ("    return 1;", "}", "")


def _key(made: FilterBlueprint, table: TableShape) -> str:
    column = table.column(made.plan.key)
    return f"data->{table.identifier}_{column.identifier}[{{}}]"


def _next(made: FilterBlueprint) -> Iterator[str]:
    name = made.blueprint.identifier
    yield from (
        "/* The rows of the next step, in `here`; 0: there is none. */",
        f"static int {name}_next_step(const {name}_data *data, struct {name}_steps *steps)",
        "{",
        f"    {name}_rows *here = &steps->here;",
        "    int found = 0;",
        "",
    )
    for position, table in enumerate(_stepped(made)):
        key = _key(made, table).format(f"steps->done[{position}]")
        yield from (
            f"    if (steps->done[{position}] < data->{table.identifier}_rows",
            f"        && (!found || {key} < here->at)) {{",
            f"        here->at = {key};",
            "        found = 1;",
            "    }",
        )
    for position, table in enumerate(_stepped(made)):
        key = _key(made, table).format(f"steps->done[{position}]")
        yield f"    here->{table.identifier}_rows = 0;"
        for column in made.blueprint.table(table.name).columns:
            held = f"{table.identifier}_{column.identifier}"
            yield f"    here->{held} = data->{held} + steps->done[{position}];"
        yield from (
            f"    while (steps->done[{position}] < data->{table.identifier}_rows && {key} == here->at) {{",
            f"        here->{table.identifier}_rows++;",
            f"        steps->done[{position}]++;",
            "    }",
        )
    yield from ("    return found;", "}", "", "#endif", "")


def _windows(files: Blueprint, window: WindowShape) -> Iterator[str]:
    """The windows over the rows of a sequence, as `mbm.equations.windows` has them."""
    name = files.identifier
    having = [t for t in files.tables if any(c.name == window.column for c in t.columns)]
    spans = _observed(files, window) or having
    yield from (
        "/* Where the first window ends, and by how much rows may miss an end; how many windows there are. */",
        f"static long {name}_windows(const {name}_data *data, double *first, double *slack)",
        "{",
        "    double last = -HUGE_VAL;",
        "    long row;",
        "",
        "    *first = HUGE_VAL;",
    )
    for table in spans:
        cell = f"data->{table.identifier}_{table.column(window.column).identifier}[row]"
        yield from (
            f"    for (row = 0; row < data->{table.identifier}_rows; row++) {{",
            f"        *first = {cell} < *first ? {cell} : *first;",
            f"        last = {cell} > last ? {cell} : last;",
            "    }",
        )
    yield from (
        "    if (!(*first <= last))",
        "        return 0;",
        f"    *slack = {number(ROUNDING * window.step)} + 4.0 * DBL_EPSILON * fmax(fabs(*first), fabs(last));",
        f"    return (long)floor((last - *first + *slack) / {number(window.step)}) + 1;",
        "}",
        "",
        "/* The rows of the window with this end; 0: they do not fit into the memory. */",
        f"static int {name}_window(const {name}_data *data, double end, double slack, {name}_data *chosen)",
        "{",
        f"    const double begin = end - {number(window.length)} + slack;",
        "    long row, count;",
        "",
        "    *chosen = *data;",
    )

    def kept(table: TableShape) -> str:
        if table not in having:
            return ""
        cell = f"data->{table.identifier}_{table.column(window.column).identifier}[row]"
        return f"{cell} > begin && {cell} <= end + slack"

    yield from (*rows_chosen(files, kept), "    return 1;", "}", "")


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
    yield from (
        "/* All windows, one after the other. */",
        head,
        "{",
        "    double first, slack;",
        f"    const long count = {name}_windows(data, &first, &slack);",
        "    long number;",
        *((f"    {variable};",) if variable else ()),
        "",
        "    for (number = 0; number < count; number++) {",
        f"        const double end = first + (double)number * {number(window.step)};",
        f"        {name}_data own;",
        f"        if (!{name}_window(data, end, slack, &own)) {{",
        '            fputs("error: the rows of a window do not fit into the memory\\n", stderr);',
        f"            return {answers[0]};",
        "        }",
        f"        if ({' + '.join(rows) or '0'} >= {window.least})",
        f"            {call}",
        f"        {name}_free_columns(&own);",
        "    }",
        f"    return {answers[1]};",
        "}",
        "",
    )


def heads(made: FilterBlueprint, doc: str) -> Iterator[str]:
    """How a program begins that filters tables, ``doc`` in words."""
    yield from (
        *program_head(made.blueprint, doc),
        f"static {made.blueprint.identifier}_filter filter;",
        "",
    )


def begun(made: FilterBlueprint) -> Iterator[str]:
    """Statements that begin the filter of the sequence with these `data`."""
    name = made.blueprint.identifier
    yield "    memset(&steps, 0, sizeof steps);"
    for table in map(made.blueprint.table, made.beside):
        yield from (
            f"    given.{table.identifier}_{field} = data->{table.identifier}_{field};"
            for field in ("rows", *(column.identifier for column in table.columns))
        )
    yield f"    {name}_begin(&filter{', &given' if made.beside else ''});"
