"""The C files that read the tables: ``csv.h``, the same for all problems, and ``<problem>_tables.h``."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.emit.c.cells import quoted
from mbm.emit.types import Blueprint, TableShape
from mbm.target.c import number

CSV = r"""/* Comma-separated tables with names in the first row; fields may stand in double quotes. */

#ifndef CSV_H
#define CSV_H

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct csv {
    const char *path;
    char *text;        /* the file, its fields ended by zeros */
    char **fields;     /* row by row, the names first */
    long columns, rows;    /* rows without the names */
};

/* Says what is wrong with a file; `row` counts the rows as they stand there, the names are row 1; 0: no row. */
static inline int csv_wrong(const struct csv *table, long row, const char *column, const char *what)
{
    fprintf(stderr, "error: %s", table->path);
    if (row > 0)
        fprintf(stderr, ", row %ld", row);
    if (column != NULL)
        fprintf(stderr, ", column `%s`", column);
    fprintf(stderr, ": %s\n", what);
    return 0;
}

static inline char *csv_whole_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    size_t size = 0, capacity = 0;

    if (file == NULL)
        return NULL;
    for (;;) {
        if (size + 1 >= capacity) {
            char *more = realloc(text, capacity = 2 * capacity + 4096);
            if (more == NULL)
                break;
            text = more;
        }
        size_t got = fread(text + size, 1, capacity - 1 - size, file);
        size += got;
        if (got == 0)
            break;
    }
    fclose(file);
    if (text != NULL)
        text[size] = '\0';
    return text;
}

/* One field from `*from`, written over itself without quotes and ended by a zero; the character behind it. */
static inline int csv_field(char **from, char **field)
{
    char *read = *from, *write = *from;
    int end;

    *field = write;
    if (*read == '"') {
        for (read++; *read != '\0'; read++) {
            if (*read == '"') {
                if (read[1] != '"') {
                    read++;
                    break;
                }
                read++;
            }
            *write++ = *read;
        }
    }
    while (*read != '\0' && *read != ',' && *read != '\n' && *read != '\r')
        *write++ = *read++;
    end = *read;
    if (end == '\r' && read[1] == '\n')
        read++;
    *from = end == '\0' ? read : read + 1;
    *write = '\0';
    return end;
}

static inline int csv_read(struct csv *table, const char *path)
{
    char *at;
    long capacity = 0, count = 0, line = 0;

    memset(table, 0, sizeof *table);
    table->path = path;
    table->text = csv_whole_file(path);
    if (table->text == NULL)
        return csv_wrong(table, 0, NULL, "cannot be read");
    at = table->text;
    if (strncmp(at, "\xEF\xBB\xBF", 3) == 0)
        at += 3;
    while (*at != '\0') {
        long fields = 0;
        int end;
        line++;
        do {
            char *field;
            end = csv_field(&at, &field);
            if (count == capacity) {
                char **more = realloc(table->fields, sizeof *more * (size_t)(capacity = 2 * capacity + 256));
                if (more == NULL)
                    return csv_wrong(table, line, NULL, "does not fit into the memory");
                table->fields = more;
            }
            table->fields[count++] = field;
            fields++;
        } while (end == ',');
        if (fields == 1 && table->fields[count - 1][0] == '\0') {
            count--;
            if (*at != '\0')
                return csv_wrong(table, line, NULL, "is empty");
        } else if (line == 1) {
            table->columns = fields;
        } else if (fields != table->columns) {
            return csv_wrong(table, line, NULL, "has another number of fields than the names in row 1");
        } else {
            table->rows++;
        }
    }
    if (table->columns == 0)
        return csv_wrong(table, 0, NULL, "has no names of columns in its first row");
    return 1;
}

static inline void csv_free(struct csv *table)
{
    free(table->fields);
    free(table->text);
    memset(table, 0, sizeof *table);
}

static inline long csv_column(const struct csv *table, const char *name)
{
    long column;
    for (column = 0; column < table->columns; column++)
        if (strcmp(table->fields[column], name) == 0)
            return column;
    csv_wrong(table, 1, name, "there is no such column");
    return -1;
}

static inline const char *csv_cell(const struct csv *table, long row, long column)
{
    return table->fields[(row + 1) * table->columns + column];
}

/* A decimal number, nothing before or behind it but blanks. */
static inline int csv_number(const char *cell, double *value)
{
    const char *character;
    char *end;

    for (character = cell; *character != '\0'; character++)
        if (strchr("0123456789+-.eE \t", *character) == NULL)
            return 0;
    *value = strtod(cell, &end);
    if (end == cell)
        return 0;
    while (isspace((unsigned char)*end))
        end++;
    return *end == '\0' && *value - *value == 0.0;
}

/* A column of numbers, times `factor`; NULL where something is wrong, which is then said. */
static inline double *csv_numbers(const struct csv *table, const char *name, double factor)
{
    const long column = csv_column(table, name);
    double *values;
    long row;

    if (column < 0)
        return NULL;
    values = malloc(sizeof *values * (size_t)(table->rows + 1));
    if (values == NULL) {
        csv_wrong(table, 0, name, "does not fit into the memory");
        return NULL;
    }
    for (row = 0; row < table->rows; row++) {
        if (!csv_number(csv_cell(table, row, column), values + row)) {
            char what[96];
            snprintf(what, sizeof what, "`%.60s` is no number", csv_cell(table, row, column));
            csv_wrong(table, row + 2, name, what);
            free(values);
            return NULL;
        }
        values[row] *= factor;
    }
    return values;
}

/* A column of texts, which stay in the table. */
static inline const char **csv_texts(const struct csv *table, const char *name)
{
    const long column = csv_column(table, name);
    const char **values;
    long row;

    if (column < 0)
        return NULL;
    values = malloc(sizeof *values * (size_t)(table->rows + 1));
    if (values == NULL) {
        csv_wrong(table, 0, name, "does not fit into the memory");
        return NULL;
    }
    for (row = 0; row < table->rows; row++)
        values[row] = csv_cell(table, row, column);
    return values;
}

#endif
"""


def tables_file(blueprint: Blueprint) -> str:
    """``<problem>_tables.h``: the problem's tables from files, and the rows of one solve from them."""
    return "\n".join([*_head(blueprint), *_read(blueprint), *_free(blueprint), *_keys(blueprint)])


def _head(blueprint: Blueprint) -> Iterator[str]:
    name = blueprint.identifier
    count = max(len(blueprint.tables), 1)
    yield f"/* {blueprint.name}: its tables from CSV files. Numbers are turned into SI. */"
    yield ""
    yield f"#ifndef {name.upper()}_TABLES_H"
    yield f"#define {name.upper()}_TABLES_H"
    yield ""
    yield f'#include "{name}.h"'
    yield '#include "csv.h"'
    yield ""
    yield f"#define {name.upper()}_TABLES {len(blueprint.tables)}"
    yield ""
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
        yield f"    if (!csv_read(&tables->files[{position}], paths[{position}]))"
        yield "        return 0;"
        yield f"    data->{table.identifier}_rows = tables->files[{position}].rows;"
        for column in table.columns:
            held = f"data->{table.identifier}_{column.identifier}"
            source = quoted(column.source)
            if column.is_text:
                yield f"    {held} = csv_texts(&tables->files[{position}], {source});"
            else:
                factor = number(float(column.factor))
                yield f"    {held} = csv_numbers(&tables->files[{position}], {source}, {factor});"
            yield f"    if ({held} == NULL)"
            yield "        return 0;"
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
        yield "#endif"
        yield ""
        return
    tables = key_tables(blueprint)
    rows = " + ".join(f"data->{table.identifier}_rows" for table in tables)

    def cell(owner: str, column: str, row: str) -> str:
        return f"data->{blueprint.table(owner).identifier}_{blueprint.table(owner).column(column).identifier}[{row}]"

    def row_cell(owner: str, column: str, row: str) -> str:
        return cell(owner, column, row) if owner else key_cell(tables, column, row)

    def same(owner: str, columns: tuple[str, ...], row: str, other: str) -> str:
        tests = []
        for column in columns:
            a, b = row_cell(owner, column, row), key_cell(tables, column, other)
            text = tables[0].column(column).is_text
            tests.append(f"strcmp({a}, {b}) == 0" if text else f"{a} == {b}")
        return " && ".join(tests)

    names = ", ".join(blueprint.for_each)
    owners = ", then ".join(f"`{table.name}`" for table in tables)
    yield f"/* The first row of {owners} behind `row` with keys ({names}) that no row before it has. */"
    yield f"static long {name}_next_key(const {name}_data *data, long row)"
    yield "{"
    yield "    long before;"
    yield f"    for (row++; row < {rows}; row++) {{"
    yield "        /* keys often stand together: the search goes backwards */"
    yield "        for (before = row - 1; before >= 0; before--)"
    yield f"            if ({same('', blueprint.for_each, 'row', 'before')})"
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
    for each in blueprint.tables:
        own = tuple(c for c in blueprint.for_each if any(c == column.name for column in each.columns))
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
            if own:
                yield f"            if ({same(each.name, own, 'row', 'key')})"
            yield f"                values[count++] = data->{field}[row];"
            yield f"        chosen->{each.identifier}_rows = count;"
            yield "    }"
    yield "    return 1;"
    yield "}"
    yield ""
    yield "#endif"
    yield ""


def key_tables(blueprint: Blueprint) -> tuple[TableShape, ...]:
    """The tables that have all columns of ``for-each``: their keys, one table after the other, tell the solves."""
    names = [{c.name for c in t.columns} for t in blueprint.tables]
    return tuple(t for t, held in zip(blueprint.tables, names, strict=True) if held.issuperset(blueprint.for_each))


def key_cell(tables: tuple[TableShape, ...], column: str, row: str) -> str:
    """The cell of a key in a row of the tables, counted through all of them."""
    table, rest = tables[0], tables[1:]
    own = f"data->{table.identifier}_{table.column(column).identifier}[{row}]"
    if not rest:
        return own
    behind = key_cell(rest, column, f"{row} - data->{table.identifier}_rows")
    return f"({row} < data->{table.identifier}_rows ? {own} : {behind})"
