"""RawTable → Table: what a data clause says of a table's columns, gaps and key is done to it. Tables from the Python
API (a data frame, a dict of arrays, a structured array or a list of dicts), and the rows written in a problem →
RawTable.

Data frames (pandas, polars) and tables of Arrow are known by what they can do, no library is imported. A frame's index
is no column. Rows count from 1; those of a problem are numbered by their lines in its file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import (
    check_names,
    column_from_array,
    column_from_values,
    columns_of_records,
    counted_table,
    frozen,
    mixed_column,
    row_numbers,
)
from mbm.data.types import GivenColumns, RawTable
from mbm.problem.tables import GAP_WORDS, Column, ColumnDeclaration, InlineTable, Table, TableDeclaration
from mbm.text.types import DataPlace, Diagnostic, Label, MbmError, Span


class Frame(Protocol):
    """What data frames have in common."""

    @property
    def columns(self) -> Any:
        """The names of the columns, in order."""

    def __getitem__(self, name: str) -> Any:
        """The column of a name, which converts to an array by ``to_numpy``."""


class ArrowTable(Protocol):
    """What tables and record batches of Arrow have in common."""

    @property
    def column_names(self) -> list[str]:
        """The names of the columns, in order."""

    def __getitem__(self, name: str) -> Any:
        """The column of a name, which is an array for NumPy."""


def table_from_given(name: str, given: object) -> RawTable:
    """The table that was given under ``name``; numbers are copied. Its path is ``<name>``, as messages print it.

    Arrays have the shape (rows,). Raises MbmError: not-a-table, no-columns, bad-column-name, duplicate-column,
    unequal-lengths, bad-array (a column that is no array).
    """
    path = f"<{name}>"
    place = DataPlace(file=path)
    if isinstance(given, Mapping):
        names = check_names(list(given), place)
        columns = tuple(_column(column, given[column], path) for column in names)
    elif isinstance(given, np.ndarray):
        columns = _of_structured(given, path)
    elif _is_arrow(given):
        names = check_names(list(given.column_names), place)
        columns = tuple(_column(column, np.asarray(given[column]), path) for column in names)
    elif _is_frame(given):
        names = check_names(list(given.columns), place)
        columns = tuple(_column(column, given[column].to_numpy(), path) for column in names)
    elif isinstance(given, Sequence) and not isinstance(given, str | bytes):
        records = [record for record in given if isinstance(record, Mapping)]
        if len(records) != len(given):
            other = next(record for record in given if not isinstance(record, Mapping))
            raise MbmError(faults.not_a_table(place, f"a list that holds a value of type `{type(other).__name__}`"))
        columns = columns_of_records(records, path)
    else:
        raise MbmError(faults.not_a_table(place, f"a value of type `{type(given).__name__}`"))
    table = counted_table(path, None, columns)
    return replace(table, key=given.key, groups=given.groups) if isinstance(given, GivenColumns) else table


def _is_arrow(given: object) -> TypeGuard[ArrowTable]:
    return hasattr(type(given), "column_names")


def _is_frame(given: object) -> TypeGuard[Frame]:
    return hasattr(given, "columns") and hasattr(given, "__getitem__")


def _of_structured(array: NDArray[Any], path: str) -> tuple[Column, ...]:
    """The columns of an array with named fields, shape (rows,)."""
    if array.dtype.names is None:
        what = f"an array of shape {array.shape}, whose columns have no names"
        raise MbmError(faults.not_a_table(DataPlace(file=path), what))
    names = check_names(array.dtype.names, DataPlace(file=path))
    return tuple(_column(column, array[column], path) for column in names)


def _column(name: str, cells: object, path: str) -> Column:
    """The column of an array, of something that converts to one, or of a list of values."""
    if isinstance(cells, list | tuple | range):
        return column_from_values(name, cells, path)
    if not isinstance(cells, np.ndarray):
        if not hasattr(cells, "__array__"):
            what = f"a value of type `{type(cells).__name__}`"
            raise MbmError(faults.bad_array(DataPlace(file=path, column=name), what))
        cells = np.asarray(cells)
    if cells.dtype.kind == "O" and cells.ndim == 1:
        return column_from_values(name, cells.tolist(), path)
    return column_from_array(name, cells, path)


def _with_gaps(cells: list[float | str]) -> list[float | str | None]:
    """The cells of a column, None where a word among numbers says that there is none, as in files."""
    words = {cell for cell in cells if isinstance(cell, str)}
    if not words <= GAP_WORDS or all(isinstance(cell, str) for cell in cells):
        return list(cells)
    return [None if isinstance(cell, str) else cell for cell in cells]


def table_from_inline(inline: InlineTable, span: Span) -> RawTable:
    """The table that the data clause at ``span`` holds; its path is the problem file's name.

    Raises MbmError with the place in the problem: no-columns, bad-column-name, duplicate-column, and all rows with
    short-row or long-row.
    """
    names = check_names(inline.columns, span)
    found = []
    for number, (row, place) in enumerate(zip(inline.rows, inline.spans, strict=True), start=1):
        if len(row) < len(names):
            found.append(faults.short_row(place, number, len(row), names))
        elif len(row) > len(names):
            found.append(faults.long_row(place, number, len(row), names))
    if found:
        raise MbmError(*found)
    columns = tuple(mixed_column(name, _with_gaps([row[i] for row in inline.rows])) for i, name in enumerate(names))
    lines = np.array([place.line for place in inline.spans], dtype=np.int64)
    lines.setflags(write=False)
    return RawTable(path=span.source.name, sha256=None, columns=columns, file_rows=lines, inline=True)


def shape(raw: RawTable, declaration: TableDeclaration) -> Table:
    """The table of a data clause: columns renamed, units turned into SI, rows with gaps left out, keys checked.

    Raises MbmError: missing-column, duplicate-column, not-a-number, empty-column, missing-key, duplicate-key.
    """
    columns = _renamed(raw, declaration)
    names = {declared.source: declared.name for declared in declaration.columns}
    key = declaration.key
    if key is None and raw.key is not None:
        key = names.get(raw.key, raw.key)
    provenance = raw.provenance({declared.name: declared.source for declared in declaration.columns})
    table = Table(
        name=declaration.name,
        columns=columns,
        rows=row_numbers(1, len(raw.file_rows)),
        provenance=provenance,
        key=key,
        groups={name: group.renamed(names) for name, group in raw.groups.items()},
    )
    if declaration.skip_missing:
        table = _without_gaps(table)
    if key is not None:
        _check_key(table, key, declaration)
    return table


def _renamed(raw: RawTable, declaration: TableDeclaration) -> dict[str, Column]:
    """The declared columns under their new names and in SI, then the other columns as they are."""
    found: list[Diagnostic] = []
    present = {column.name: column for column in raw.columns}
    columns: dict[str, Column] = {}
    for declared in declaration.columns:
        source = present.get(declared.source)
        if source is None:
            found.append(faults.missing_column(declared.span, declared.source, raw.path, present))
        elif declared.name in columns:
            found.append(faults.duplicate_column(declared.span, declared.name))
        elif declared.unit is not None and source.is_text:
            found.append(_text_cell(source, declared, declared.unit, raw))
        else:
            columns[declared.name] = _in_si(source, declared)
    used = {declared.source for declared in declaration.columns}
    for name, column in present.items():
        if name in used:
            continue
        if name in columns:
            renamed = next(declared for declared in declaration.columns if declared.name == name)
            found.append(faults.duplicate_column(renamed.span, name))
        else:
            columns[name] = column
    if found:
        raise MbmError(*found)
    return columns


def _in_si(column: Column, declared: ColumnDeclaration) -> Column:
    """The column with its new name, its numbers in SI."""
    numbers = column.numbers
    if numbers is not None and not declared.scale.is_si:
        numbers = frozen(declared.scale.to_si(numbers))
    return replace(column, name=declared.name, numbers=numbers, unit=declared.unit or column.unit)


def _text_cell(column: Column, declared: ColumnDeclaration, unit: str, raw: RawTable) -> Diagnostic:
    position = column.first_text() or 0
    cell = "" if column.texts is None else column.texts[position]
    place = raw.provenance().place(position + 1, column.name)
    return faults.not_a_number(place, cell, unit, declared.span)


def _without_gaps(table: Table) -> Table:
    """The rows in which every column of numbers has one. A column without any value would take all rows with it."""
    kept = np.ones(len(table), dtype=bool)
    for column in table.columns.values():
        if column.numbers is None:
            continue
        gaps = np.isnan(column.numbers)
        if len(table) > 0 and gaps.all():
            place = replace(table.provenance.place(1, column.name), row=None)
            raise MbmError(faults.empty_column(place))
        kept &= ~gaps
    if kept.all():
        return table
    return replace(table.take(np.flatnonzero(kept)), gaps=table.take(np.flatnonzero(~kept)))


def _check_key(table: Table, key: str, declaration: TableDeclaration) -> None:
    """Check that the key column is there, and that each row has a key that no other row has."""
    column = table.columns.get(key)
    if column is None:
        path = table.provenance.path
        raise MbmError(faults.missing_column(declaration.span, key, path, table.columns))
    column.check()
    label = Label(declaration.span, f"`{key}` is the key of `{declaration.name}` here")
    found = [faults.missing_key(table.place(int(i), key)) for i in _gaps(column)[: faults.MOST_ROWS_REPORTED]]
    if not found:
        found = _duplicates(table, column)
    if found:
        raise MbmError(*(replace(fault, labels=(*fault.labels, label)) for fault in found))


def _gaps(column: Column) -> NDArray[np.int64]:
    """The positions of the gaps in a column."""
    if column.numbers is not None:
        return np.flatnonzero(np.isnan(column.numbers)).astype(np.int64)
    return np.array([i for i, text in enumerate(column.texts or ()) if not text], dtype=np.int64)


def _duplicates(table: Table, column: Column) -> list[Diagnostic]:
    """A fault for each of the first few rows whose key an earlier row has."""
    keys = table.keys(column.name)
    if len(set(keys)) == len(keys):
        return []
    first: dict[str | float, int] = {}
    found: list[Diagnostic] = []
    for position, key in enumerate(keys):
        earlier = first.setdefault(key, position)
        if earlier != position:
            places = table.place(position, column.name), table.place(earlier, column.name)
            found.append(faults.duplicate_key(*places, key))
            if len(found) == faults.MOST_ROWS_REPORTED:
                break
    return found
