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
    yield "/* The files, and the columns that were made of them. */"
    yield f"struct {name}_tables {{"
    yield f"    struct csv files[{count}];"
    yield f"    {name}_data data;"
    yield "};"
    yield ""


def _read(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield f"static int {name}_read_tables(struct {name}_tables *tables, char *const *paths)"
    yield "{"
    yield f"    {name}_data *data = &tables->data;"
    yield ""
    yield "    (void)paths;"
    yield "    (void)data;"
    yield "    memset(tables, 0, sizeof *tables);"
    for position, table in enumerate(blueprint.tables):
        yield from table_read(table, position, "data")
    yield "    return 1;"
    yield "}"
    yield ""


def _free(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    yield "/* Frees the columns of data that were read or selected. */"
    yield f"static void {name}_free_columns({name}_data *data)"
    yield "{"
    yield "    (void)data;"
    for table in blueprint.tables:
        for column in table.columns:
            yield f"    free((void *)data->{table.identifier}_{column.identifier});"
    yield "}"
    yield ""
    yield f"static void {name}_free_tables(struct {name}_tables *tables)"
    yield "{"
    yield "    long i;"
    yield f"    {name}_free_columns(&tables->data);"
    yield f"    for (i = 0; i < {name.upper()}_TABLES; i++)"
    yield "        csv_free(&tables->files[i]);"
    yield "}"
    yield ""


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
    yield remark("The first row of ", owners, " behind `row` with keys (", keys, ") that no row before it has.")
    yield f"static long {name}_next_key(const {name}_data *data, long row)"
    yield "{"
    yield "    long before;"
    yield f"    for (row++; row < {rows}; row++) {{"
    yield "        /* keys often stand together: the search goes backwards */"
    yield "        for (before = row - 1; before >= 0; before--)"
    yield f"            if ({same(None, blueprint.for_each, 'row', 'before')})"
    yield "                break;"
    yield "        if (before < 0)"
    yield "            return row;"
    yield "    }"
    yield "    return -1;"
    yield "}"
    yield ""
    yield "/* The rows with the keys of a row; tables without a key stay whole. 0: they do not fit into the memory. */"
    yield f"static int {name}_select(const {name}_data *data, long key, {name}_data *chosen)"
    yield "{"
    yield "    long row, count;"
    yield ""
    yield "    *chosen = *data;"

    def kept(each: TableShape) -> str:
        own = tuple(c for c in blueprint.for_each if any(c == column.name for column in each.columns))
        return same(each, own, "row", "key") if own else ""

    yield from rows_chosen(blueprint, kept)
    yield "    return 1;"
    yield "}"
    yield ""


def rows_chosen(blueprint: Blueprint, kept: Callable[[TableShape], str]) -> Iterator[str]:
    """Statements that put the rows of `data` for which a condition holds ("": all) into `chosen`."""
    for each in blueprint.tables:
        condition = kept(each)
        rows_here = f"data->{each.identifier}_rows"
        for column in each.columns:
            field = f"{each.identifier}_{column.identifier}"
            kind = "const char **" if column.is_text else "double *"
            yield "    {"
            yield f"        {kind}values = malloc(sizeof *values * (size_t)({rows_here} + 1));"
            yield f"        chosen->{field} = values;"
            yield "        if (values == NULL)"
            yield "            return 0;"
            yield f"        for (row = count = 0; row < {rows_here}; row++)"
            if condition:
                yield f"            if ({condition})"
            yield f"                values[count++] = data->{field}[row];"
            yield f"        chosen->{each.identifier}_rows = count;"
            yield "    }"


def tables_head(blueprint: Blueprint, doc: str, count: int) -> Iterator[str]:
    """How ``<problem>_tables.h`` begins, which reads so many tables."""
    name = blueprint.identifier
    yield remark(blueprint.name, doc, " Numbers are turned into SI.")
    yield ""
    yield f"#ifndef {name.upper()}__TABLES_H"
    yield f"#define {name.upper()}__TABLES_H"
    yield ""
    yield f'#include "{name}.h"'
    yield '#include "csv.h"'
    yield ""
    yield f"enum {{ {name.upper()}_TABLES = {count} }};"
    yield ""


def program_head(blueprint: Blueprint, doc: str) -> Iterator[str]:
    """How a program begins that reads tables, ``doc`` in words."""
    yield remark(blueprint.name, ": ", doc)
    yield ""
    yield "#include <math.h>"
    yield "#include <stdio.h>"
    yield "#include <stdlib.h>"
    yield "#include <string.h>"
    yield ""
    yield f'#include "{blueprint.identifier}_tables.h"'
    yield ""


def arguments_read(blueprint: Blueprint, tables: Sequence[TableShape]) -> Iterator[str]:
    """Statements of ``main`` that read the tables from the files that it is given, or say what it wants."""
    name = blueprint.identifier
    yield f"    if (argc != 1 + {name.upper()}_TABLES) {{"
    yield '        fputs("usage: ", stderr);'
    yield '        csv_show(stderr, argc > 0 ? argv[0] : "", 0);'
    yield from (f'        fputs(" {table.identifier.upper()}.csv", stderr);' for table in tables)
    yield "        putc('\\n', stderr);"
    yield "        return 2;"
    yield "    }"
    yield f"    if (!{name}_read_tables(&tables, argv + 1)) {{"
    yield f"        {name}_free_tables(&tables);"
    yield "        return 2;"
    yield "    }"


DIFFERS = """/* How far a number may lie from its reference: 1e-9 of its size or its standard deviation. */
static int differs(double value, double reference, double sigma)
{
    const double size = fabs(reference) > sigma ? fabs(reference) : sigma;
    return !(fabs(value - reference) <= 1e-9 * size);
}

"""
"""What tests of generated C compare with."""


def reference_read(blueprint: Blueprint) -> Iterator[str]:
    """Statements of ``main`` of a test that read ``reference.csv`` and the tables from ``paths``."""
    name = blueprint.identifier
    yield "    memset(&tables, 0, sizeof tables);"
    yield f'    if (!csv_read(&reference, "reference.csv") || !{name}_read_tables(&tables, paths)) {{'
    yield from reference_freed(blueprint, "        ")
    yield "        return 2;"
    yield "    }"


def reference_freed(blueprint: Blueprint, pad: str = "    ") -> Iterator[str]:
    """Statements that free what `reference_read` read."""
    yield f"{pad}{blueprint.identifier}_free_tables(&tables);"
    yield f"{pad}csv_free(&reference);"


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
    yield f"    if (!csv_read(&tables->files[{position}], paths[{position}]))"
    yield "        return 0;"
    yield f"    {into}->{table.identifier}_rows = tables->files[{position}].rows;"
    for column in table.columns:
        held = f"{into}->{table.identifier}_{column.identifier}"
        source = literal(column.source)
        if column.is_text:
            yield f"    {held} = csv_texts(&tables->files[{position}], {source});"
        else:
            scale = f"{number(column.scale.factor)}, {number(column.scale.zero)}"
            yield f"    {held} = csv_numbers(&tables->files[{position}], {source}, {scale});"
        yield f"    if ({held} == NULL)"
        yield "        return 0;"


def each_data_set(blueprint: Blueprint, call: str) -> Iterator[str]:
    """Statements of ``main`` that go through the data sets; ``call`` is done with each."""
    name = blueprint.identifier
    if not blueprint.for_each:
        yield f"    {call.format(data='&tables.data')}"
        return
    yield f"    for (row = {name}_next_key(&tables.data, -1); row >= 0; row = {name}_next_key(&tables.data, row)) {{"
    yield f"        {name}_data chosen;"
    yield f"        if (!{name}_select(&tables.data, row, &chosen)) {{"
    yield '            fprintf(stderr, "error: the rows of a solve do not fit into the memory\\n");'
    yield "            return 2;"
    yield "        }"
    yield f"        {call.format(data='&chosen')}"
    yield f"        {name}_free_columns(&chosen);"
    yield "    }"


def key_text(blueprint: Blueprint, pad: str) -> Iterator[str]:
    """Statements that print the keys of the rows in `data`."""
    tables = key_tables(blueprint)
    for column in blueprint.for_each:
        held = tables[0].column(column)
        # the first row of a selection has its keys
        cell = key_cell(tables, column, "0")
        if held.is_text:
            yield f"{pad}csv_put_text(stdout, {cell});"
            yield f"{pad}putchar(',');"
        else:
            yield f'{pad}printf("%.15g,", {in_unit(cell, held.scale)});'
