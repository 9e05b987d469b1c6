"""``<problem>_tables.h``, which makes the columns of a problem of CSV files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from mbm.emit.c.text import in_unit, literal, remark
from mbm.emit.foreign import Foreign, listed, told
from mbm.emit.types import Blueprint, TableShape
from mbm.machine.c import number


def tables_file(blueprint: Blueprint) -> str:
    """``<problem>_tables.h``: the problem's tables from files, and the rows of one solve from them."""
    return "\n".join([*_head(blueprint), *read_functions(blueprint), "#endif", ""])


def read_functions(blueprint: Blueprint) -> Iterator[str]:
    """What reads and frees the columns of all tables, and the rows of one key from them."""
    yield from (*_read(blueprint), *_free(blueprint), *_keys(blueprint))


def _head(blueprint: Blueprint) -> Iterator[str]:
    yield from tables_head(blueprint, ": its tables from CSV files.", len(blueprint.tables))
    yield from tables_struct(blueprint)


def tables_struct(blueprint: Blueprint) -> Iterator[str]:
    """The struct of all tables."""
    name = blueprint.identifier
    count = max(len(blueprint.tables), 1)
    yield from (
        "/* The files, and the columns that were made of them. */",
        f"struct {name}_tables {{",
        f"    struct csv files[{count}];",
        f"    {name}_data data;",
        "};",
        "",
    )


def _read(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        f"static int {name}_read_tables(struct {name}_tables *tables, char *const *paths)",
        "{",
        f"    {name}_data *data = &tables->data;",
        "",
        "    (void)paths;",
        "    (void)data;",
        "    memset(tables, 0, sizeof *tables);",
    )
    for position, table in enumerate(blueprint.tables):
        yield from table_read(table, position, "data")
    yield from ("    return 1;", "}", "")


def _free(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield from (
        "/* Frees the columns of data that were read or selected. */",
        f"static void {name}_free_columns({name}_data *data)",
        "{",
        "    (void)data;",
    )
    for table in blueprint.tables:
        yield from (f"    free((void *)data->{table.identifier}_{column.identifier});" for column in table.columns)
    yield from (
        "}",
        "",
        f"static void {name}_free_tables(struct {name}_tables *tables)",
        "{",
        "    long i;",
        f"    {name}_free_columns(&tables->data);",
        f"    for (i = 0; i < {name.upper()}_TABLES; i++)",
        "        csv_free(&tables->files[i]);",
        "}",
        "",
    )


def _keys(blueprint: Blueprint) -> Iterator[str]:
    """The rows of one data set: those that agree with a row of the table that has all keys."""
    name = blueprint.identifier
    if not blueprint.for_each:
        return
    tables = key_tables(blueprint)
    rows = " + ".join(f"data->{table.identifier}_rows" for table in tables)

    def cell(owner: TableShape | None, column: Foreign, row: str) -> str:
        own = key_tables(blueprint) if owner is None else (owner,)
        return key_cell(own, column, row)

    def same(owner: TableShape | None, columns: tuple[Foreign, ...], row: str, other: str) -> str:
        tests = []
        for column in columns:
            a, b = cell(owner, column, row), key_cell(tables, column, other)
            text = tables[0].column(column).is_text
            tests.append(f"strcmp({a}, {b}) == 0" if text else f"{a} == {b}")
        return " && ".join(tests)

    owners = listed(told("`", table.name, "`") for table in tables)
    keys = listed(blueprint.for_each)
    yield from (
        remark("The first row of ", owners, " behind `row` with keys (", keys, ") that no row before it has."),
        f"static long {name}_next_key(const {name}_data *data, long row)",
        "{",
        "    long before;",
        f"    for (row++; row < {rows}; row++) {{",
        "        /* keys often stand together: the search goes backwards */",
        "        for (before = row - 1; before >= 0; before--)",
        f"            if ({same(None, blueprint.for_each, 'row', 'before')})",
        "                break;",
        "        if (before < 0)",
        "            return row;",
        "    }",
        "    return -1;",
        "}",
        "",
        "/* The rows with the keys of a row; tables without a key stay whole. 0: they do not fit into the memory. */",
        f"static int {name}_select(const {name}_data *data, long key, {name}_data *chosen)",
        "{",
        "    long row, count;",
        "",
        "    *chosen = *data;",
    )

    def kept(each: TableShape) -> str:
        own = tuple(c for c in blueprint.for_each if any(c == column.name for column in each.columns))
        return same(each, own, "row", "key") if own else ""

    yield from (*rows_chosen(blueprint, kept), "    return 1;", "}", "")


def rows_chosen(blueprint: Blueprint, kept: Callable[[TableShape], str]) -> Iterator[str]:
    """Statements that put the rows of `data` for which a condition holds ("": all) into `chosen`."""
    for each in blueprint.tables:
        condition = kept(each)
        rows_here = f"data->{each.identifier}_rows"
        for column in each.columns:
            field = f"{each.identifier}_{column.identifier}"
            kind = "const char **" if column.is_text else "double *"
            yield from (
                "    {",
                f"        {kind}values = malloc(sizeof *values * (size_t)({rows_here} + 1));",
                f"        chosen->{field} = values;",
                "        if (values == NULL)",
                "            return 0;",
                f"        for (row = count = 0; row < {rows_here}; row++)",
            )
            if condition:
                yield f"            if ({condition})"
            yield from (
                f"                values[count++] = data->{field}[row];",
                f"        chosen->{each.identifier}_rows = count;",
                "    }",
            )


def tables_head(blueprint: Blueprint, doc: str, count: int) -> Iterator[str]:
    """How ``<problem>_tables.h`` begins, which reads so many tables."""
    name = blueprint.identifier
    yield from (
        remark(blueprint.name, doc, " Numbers are turned into SI."),
        "",
        f"#ifndef {name.upper()}__TABLES_H",
        f"#define {name.upper()}__TABLES_H",
        "",
        f'#include "{name}.h"',
        '#include "csv.h"',
        "",
        f"enum {{ {name.upper()}_TABLES = {count} }};",
        "",
    )


def program_head(blueprint: Blueprint, doc: str) -> Iterator[str]:
    """How a program begins that reads tables, ``doc`` in words."""
    yield from (
        remark(blueprint.name, ": ", doc),
        "",
        "#include <math.h>",
        "#include <stdio.h>",
        "#include <stdlib.h>",
        "#include <string.h>",
        "",
        f'#include "{blueprint.identifier}_tables.h"',
        "",
    )


def arguments_read(blueprint: Blueprint, tables: Sequence[TableShape]) -> Iterator[str]:
    """Statements of ``main`` that read the tables from the files that it is given, or say what it wants."""
    name = blueprint.identifier
    yield from (
        f"    if (argc != 1 + {name.upper()}_TABLES) {{",
        '        fputs("usage: ", stderr);',
        '        csv_show(stderr, argc > 0 ? argv[0] : "", 0);',
        *(f'        fputs(" {table.identifier.upper()}.csv", stderr);' for table in tables),
        "        putc('\\n', stderr);",
        "        return 2;",
        "    }",
        f"    if (!{name}_read_tables(&tables, argv + 1)) {{",
        f"        {name}_free_tables(&tables);",
        "        return 2;",
        "    }",
    )


def reference_read(blueprint: Blueprint) -> Iterator[str]:
    """Statements of ``main`` of a test that read ``reference.csv`` and the tables from ``paths``."""
    name = blueprint.identifier
    yield from (
        "    memset(&tables, 0, sizeof tables);",
        f'    if (!csv_read(&reference, "reference.csv") || !{name}_read_tables(&tables, paths)) {{',
        *reference_freed(blueprint, "        "),
        "        return 2;",
        "    }",
    )


def reference_freed(blueprint: Blueprint, pad: str = "    ") -> Iterator[str]:
    """Statements that free what `reference_read` read."""
    yield from (f"{pad}{blueprint.identifier}_free_tables(&tables);", f"{pad}csv_free(&reference);")


def key_tables(blueprint: Blueprint) -> tuple[TableShape, ...]:
    """The tables that have all columns of ``for-each``: their keys, one table after the other, tell the solves."""
    names = [{c.name for c in t.columns} for t in blueprint.tables]
    return tuple(t for t, held in zip(blueprint.tables, names, strict=True) if held.issuperset(blueprint.for_each))


def key_cell(tables: tuple[TableShape, ...], column: Foreign, row: str) -> str:
    """The cell of a key in a row of the tables, counted through all of them."""
    table, rest = tables[0], tables[1:]
    own = f"data->{table.identifier}_{table.column(column).identifier}[{row}]"
    if not rest:
        return own
    behind = key_cell(rest, column, f"{row} - data->{table.identifier}_rows")
    return f"({row} < data->{table.identifier}_rows ? {own} : {behind})"


def table_read(table: TableShape, position: int, into: str) -> Iterator[str]:
    """Statements that read the columns of a table ``into`` what a pointer of this name points to."""
    yield from (
        f"    if (!csv_read(&tables->files[{position}], paths[{position}]))",
        "        return 0;",
        f"    {into}->{table.identifier}_rows = tables->files[{position}].rows;",
    )
    for column in table.columns:
        held = f"{into}->{table.identifier}_{column.identifier}"
        source = literal(column.source)
        if column.is_text:
            yield f"    {held} = csv_texts(&tables->files[{position}], {source});"
        else:
            scale = f"{number(column.scale.factor)}, {number(column.scale.zero)}"
            yield f"    {held} = csv_numbers(&tables->files[{position}], {source}, {scale});"
        yield from (f"    if ({held} == NULL)", "        return 0;")


def each_data_set(blueprint: Blueprint, call: str) -> Iterator[str]:
    """Statements of ``main`` that go through the data sets; ``call`` is done with each."""
    name = blueprint.identifier
    if not blueprint.for_each:
        yield f"    {call.format(data='&tables.data')}"
        return
    yield from (
        f"    for (row = {name}_next_key(&tables.data, -1); row >= 0; row = {name}_next_key(&tables.data, row)) {{",
        f"        {name}_data chosen;",
        f"        if (!{name}_select(&tables.data, row, &chosen)) {{",
        '            fprintf(stderr, "error: the rows of a solve do not fit into the memory\\n");',
        "            return 2;",
        "        }",
        f"        {call.format(data='&chosen')}",
        f"        {name}_free_columns(&chosen);",
        "    }",
    )


def key_text(blueprint: Blueprint, pad: str) -> Iterator[str]:
    """Statements that print the keys of the rows in `data`."""
    tables = key_tables(blueprint)
    for column in blueprint.for_each:
        held = tables[0].column(column)
        # the first row of a selection has its keys
        cell = key_cell(tables, column, "0")
        if held.is_text:
            yield from (f"{pad}csv_put_text(stdout, {cell});", f"{pad}putchar(',');")
        else:
            yield f'{pad}printf("%.15g,", {in_unit(cell, held.scale)});'
