"""Cells → Column: texts of a file, Python values or a NumPy array become a column of numbers or of texts. Columns side
by side: their names, their common length, and tables written record by record.

A column is numeric if all its cells are, else text. Truth values that a format or Python has as such are numbers, 1 and
0, if nothing but gaps is beside them; the words ``true`` and ``false`` of text formats are texts. A gap is neutral: it
becomes NaN among numbers, an empty text among texts; a column of gaps only is one of numbers. Dates and times are
texts, as in files: they can be keys, and are no numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import date, time, timedelta
from numbers import Integral, Real
from pathlib import Path
from types import NoneType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.content import check_table
from mbm.data.types import RawTable
from mbm.problem.tables import GAP_WORDS, Column, Numbers, reads_as_number
from mbm.text.faults import worth_reading
from mbm.text.types import DataPlace, Diagnostic, MbmError, Place
from mbm.values import dataclass

Cell: TypeAlias = Real | float | str | None
"""A number, a text, or None for a gap."""

LARGEST_EXACT = 2.0**53
TRUTHS = frozenset({bool, np.bool_})
GAP_TYPES = frozenset({"NAType", "NaTType"})
"""Names of the types of ``pandas.NA`` and ``pandas.NaT``, which are gaps though pandas itself is not imported here."""
KIND_NAMES = {
    "c": "an array of complex numbers",
    "O": "an array of Python objects",
    "S": "an array of bytes",
    "V": "a structured array",
}


def frozen(numbers: Iterable[float] | NDArray[Any]) -> Numbers:
    """A read-only copy as float64, shape unchanged."""
    array = np.array(numbers, dtype=np.float64)
    array.setflags(write=False)
    return array


def column_from_texts(name: str, cells: Sequence[str]) -> Column:
    """The column of a text format. Blanks around a cell do not count.

    Numbers are decimal: ``5``, ``-.5``, ``2.5e-3``, ``inf``; neither hexadecimal nor with ``_`` between digits, which
    Python's ``float`` would let pass. Gaps are an empty cell, ``NA`` and ``nan`` in any case.
    """
    numbers = numbers_of(cells)
    if numbers is None:
        stripped = [cell.strip() for cell in cells]
        numbers = numbers_of(["nan" if cell in GAP_WORDS else cell for cell in stripped])
        if numbers is None:
            return Column(name=name, texts=tuple(stripped))
    numbers.setflags(write=False)
    return Column(name=name, numbers=numbers)


def numbers_of(texts: Sequence[str]) -> Numbers | None:
    """All texts as numbers, shape (n,), or None if one is something else.

    One look at all characters at once spares a look at each text.
    """
    together = "".join(texts)
    if ("_" in together or not together.isascii()) and not all(map(reads_as_number, texts)):
        return None
    try:
        return np.fromiter(map(float, texts), dtype=np.float64, count=len(texts))
    except ValueError:
        return None


def column_from_values(name: str, values: Sequence[object], path: str) -> Column:
    """The column of Python values: numbers, texts, and None, NaN or ``pandas.NA`` for gaps; cells count from row 1.

    A text stays one even if it reads as a number; in a column with texts the numbers become texts. With truth values
    among others, or anything else, it has the fault bad-cell, which names ``path``, row and column.
    """
    kinds = set(map(type, values))
    if kinds <= {float, int, NoneType}:
        return Column(name=name, numbers=_numbers_of(values))  # type: ignore[arg-type]
    if kinds <= {str, NoneType}:
        return mixed_column(name, values)  # type: ignore[arg-type]
    if kinds & TRUTHS and all(type(value) in TRUTHS or _is_gap(value) for value in values):
        return Column(name=name, numbers=frozen([math.nan if _is_gap(value) else bool(value) for value in values]))
    cells = []
    for row, value in enumerate(values, start=1):
        cell = _plain(value)
        if isinstance(cell, Strange):
            fault = faults.bad_cell(DataPlace(file=path, row=row, column=name), cell.what)
            return unreadable(name, len(values), fault)
        cells.append(cell)
    return mixed_column(name, cells)


def unreadable(name: str, rows: int, fault: Diagnostic) -> Column:
    """A column whose cells are neither numbers nor texts, which is refused where it is used."""
    return Column(name=name, texts=("",) * rows, fault=fault)


def mixed_column(name: str, cells: Sequence[Cell]) -> Column:
    """The column of checked cells: numbers, texts and None for gaps."""
    if any(isinstance(cell, str) for cell in cells):
        return Column(name=name, texts=tuple(_to_text(cell) for cell in cells))
    return Column(name=name, numbers=_numbers_of(cells))  # type: ignore[arg-type]


def _numbers_of(cells: Sequence[Real | float | None]) -> Numbers:
    """The cells as numbers, gaps as NaN. All at once where no whole number is beyond what a double holds."""
    try:
        return frozen(cells)  # type: ignore[arg-type]  # None is NaN to NumPy
    except OverflowError:
        return frozen([_to_float(cell) for cell in cells])


def column_from_array(name: str, array: NDArray[Any], path: str) -> Column:
    """The column of an array of shape (rows,): numbers and truth values become float64, masked ones gaps, dates
    texts. With more dimensions or another type of cells it has the fault bad-array.

    Raises MbmError bad-array for an array without a dimension.
    """
    place = DataPlace(file=path, column=name)
    if array.ndim != 1:
        fault = faults.bad_array(place, f"an array of shape {array.shape}")
        if array.ndim == 0:
            raise MbmError(fault)
        return unreadable(name, len(array), fault)
    if array.dtype.kind in "biuf":
        if isinstance(array, np.ma.MaskedArray):
            return Column(name=name, numbers=frozen(np.ma.filled(array.astype(np.float64), np.nan)))
        return Column(name=name, numbers=frozen(array))
    if array.dtype.kind in "Mm":
        texts = np.datetime_as_string(array, unit="auto") if array.dtype.kind == "M" else array.astype(str)
        return mixed_column(
            name, [None if gap else str(text) for gap, text in zip(np.isnat(array), texts, strict=True)]
        )
    if array.dtype.kind in "UT":
        return column_from_values(name, array.tolist(), path)
    fault = faults.bad_array(place, KIND_NAMES.get(array.dtype.kind, f"an array of {array.dtype}"))
    return unreadable(name, len(array), fault)


@dataclass(frozen=True, slots=True)
class Strange:
    """A value that is no cell, in words."""

    what: str


def _plain(value: object) -> Cell | Strange:
    """A number, a text or None (a gap)."""
    if _is_gap(value):
        return None
    if type(value) in TRUTHS:
        return Strange(f"the truth value `{str(value).lower()}`")
    if isinstance(value, str | Real):
        return value
    if type(value).__name__ == "Decimal":
        return float(value)  # type: ignore[arg-type]
    if isinstance(value, date | time | timedelta):
        return str(value) if isinstance(value, timedelta) else value.isoformat()
    return Strange(f"a value of type `{type(value).__name__}`")


def _is_gap(value: object) -> bool:
    """None, NaN (which alone differs from itself), or a gap of pandas."""
    if isinstance(value, Real):
        return bool(value != value)
    return value is None or type(value).__name__ in GAP_TYPES


def _to_float(cell: Real | float | None) -> float:
    if cell is None:
        return math.nan
    try:
        return float(cell)
    except OverflowError:  # a whole number beyond 1e308; infinity is refused where it is used
        return math.inf if cell > 0 else -math.inf  # type: ignore[operator]


def _to_text(cell: Cell) -> str:
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, Integral):
        return format(int(cell), "d") if abs(int(cell)) < 10**308 else format(_to_float(cell), "g")
    number = float(cell)
    return format(number, ".0f") if number.is_integer() and abs(number) < LARGEST_EXACT else repr(number)


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

    Raises MbmError: no-columns, too-many-columns, bad-column-name, too-much-memory.
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
