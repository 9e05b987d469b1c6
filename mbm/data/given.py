"""Tables from the Python API (a data frame, a dict of arrays, a structured array or a list of dicts), and the rows
written in a problem → RawTable.

Data frames (pandas, polars) are known by what they can do, neither library is imported. A frame's index is no column.
Rows count from 1; those of a problem are numbered by their lines in its file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import column_from_array, column_from_values, mixed_column
from mbm.data.columns import check_names, columns_of_records, counted_table
from mbm.data.types import GivenColumns, RawTable
from mbm.problem.tables import GAP_WORDS, Column, InlineTable
from mbm.text.types import DataPlace, MbmError, Span


class Frame(Protocol):
    """What data frames have in common."""

    @property
    def columns(self) -> Any:
        """The names of the columns, in order."""

    def __getitem__(self, name: str) -> Any:
        """The column of a name, which converts to an array by ``to_numpy``."""


def table_from_given(name: str, given: object) -> RawTable:
    """The table that was given under ``name``; numbers are copied. Its path is ``<name>``, as messages print it.

    Arrays have the shape (rows,). Raises MbmError: not-a-table, no-columns, bad-column-name, duplicate-column,
    unequal-lengths, bad-array, bad-cell.
    """
    path = f"<{name}>"
    place = DataPlace(file=path)
    if isinstance(given, Mapping):
        names = check_names(list(given), place)
        columns = tuple(_column(column, given[column], path) for column in names)
    elif isinstance(given, np.ndarray):
        columns = _of_structured(given, path)
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
    if isinstance(cells, list | tuple):
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
