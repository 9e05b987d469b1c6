"""Columns side by side: their names, their common length, and tables written record by record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import column_from_values
from mbm.data.content import check_table
from mbm.data.types import RawTable
from mbm.problem.tables import Column
from mbm.text.faults import worth_reading
from mbm.text.types import DataPlace, Diagnostic, MbmError, Place

MOST_COLUMNS = 50_000
"""Columns of a table: each is a value of its own with a name that is looked up."""


def check_names(names: Sequence[object], place: Place) -> tuple[str, ...]:
    """The names of a table's columns, if they are texts, not empty, and all different.

    Raises MbmError: no-columns, too-many-columns, or the first few of bad-column-name, duplicate-column.
    """
    if not names:
        raise MbmError(faults.no_columns(place))
    if len(names) > MOST_COLUMNS:
        raise MbmError(faults.too_many_columns(place, len(names), MOST_COLUMNS))
    found: list[Diagnostic] = []
    good: dict[str, None] = {}
    for position, name in enumerate(names, start=1):
        if not isinstance(name, str) or not name:
            found.append(faults.bad_column_name(place, position, name))
        elif name in good:
            found.append(faults.duplicate_column(place, name))
        else:
            good[str(name)] = None
    if found:
        raise MbmError(*worth_reading(found))
    return tuple(good)


def check_lengths(lengths: Mapping[str, int], place: DataPlace) -> int:
    """The number of rows that all columns have. ``lengths`` gives the cells of each column, at least one column.

    Raises MbmError unequal-lengths.
    """
    first, rows = next(iter(lengths.items()))
    for name, length in lengths.items():
        if length != rows:
            raise MbmError(faults.unequal_lengths(place, first, rows, name, length))
    return rows


def columns_of_records(records: Sequence[Mapping[Any, object]], path: str) -> tuple[Column, ...]:
    """The columns of records, in the order in which their names first occur; a field left out is a gap.

    Raises MbmError: no-columns, too-many-columns, bad-column-name, too-much-memory, bad-cell.
    """
    names = check_names(list(dict.fromkeys(name for record in records for name in record)), DataPlace(file=path))
    check_table(Path(path), len(records) * len(names))
    return tuple(column_from_values(name, [record.get(name) for record in records], path) for name in names)


def counted_table(path: str, digest: str | None, columns: Sequence[Column]) -> RawTable:
    """A table of an origin without a header: its rows count from 1.

    Raises MbmError unequal-lengths.
    """
    lengths = {column.name: column_length(column) for column in columns}
    rows = check_lengths(lengths, DataPlace(file=path))
    return RawTable(path=path, sha256=digest, columns=tuple(columns), file_rows=row_numbers(1, rows))


def column_length(column: Column) -> int:
    """The number of cells of a column."""
    if column.texts is not None:
        return len(column.texts)
    return 0 if column.numbers is None else len(column.numbers)


def row_numbers(first: int, rows: int) -> NDArray[np.int64]:
    """``rows`` whole numbers from ``first`` on, read-only."""
    numbers = np.arange(first, first + rows, dtype=np.int64)
    numbers.setflags(write=False)
    return numbers
