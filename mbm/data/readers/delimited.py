"""Rows of cells between separators: what CSV and TSV have in common (RFC 4180, quoting in TSV too).

The first row names the columns. Text is UTF-8, with or without a byte order mark; lines may end in any way; blank lines
at the end are passed over, comments are not. A row of several lines (a line break in quotes) counts once.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from io import StringIO
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import column_from_texts
from mbm.data.columns import check_names, column_length, row_numbers
from mbm.data.content import read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.decimals import decimals
from mbm.data.types import RawTable
from mbm.problem.tables import Column, reads_as_number
from mbm.text.types import DataPlace, Diagnostic, MbmError

SEPARATOR_NAMES = {",": "commas", "\t": "tabulators", ";": "semicolons"}
ROWS_AT_ONCE = 500
"""Rows split before they are sorted into columns: with more, the garbage collector walks them again and again."""


def read_delimited(path: Path, separator: str) -> RawTable:
    """Read the file at ``path``, whose cells are separated by ``separator``.

    Raises MbmError as ``read_text`` does, and missing-header, wrong-separator, comment-line, bad-quotes, short-row,
    long-row, bad-column-name, duplicate-column.
    """
    text, digest = read_text(path)
    shown = path.as_posix()
    text = _without_blank_end(text.replace("\r\n", "\n"))
    columns = _plain_columns(text, separator, shown)
    if columns is None:
        columns = _columns(text, separator, shown)
    rows = row_numbers(2, column_length(columns[0]))
    return RawTable(path=shown, sha256=digest, columns=columns, file_rows=rows)


def _without_blank_end(text: str) -> str:
    """The text up to its last line that is not blank; the tabulators at the end of that line are empty cells."""
    end = len(text.rstrip(" \r\n"))
    breaks = [found for found in (text.find("\n", end), text.find("\r", end)) if found >= 0]
    return text[: min(breaks, default=len(text))]


def _plain_columns(text: str, separator: str, path: str) -> tuple[Column, ...] | None:
    """The columns of a file of ASCII without quotes that has one cell for every column in each row; None for others.

    The result is that of ``_columns``, several times faster.
    """
    header, line_break, body = text.partition("\n")
    if not line_break or '"' in text or "\r" in text or not text.isascii():
        return None
    try:
        names = _names(next(_rows(header, separator), []), separator, path)
    except csv.Error:
        return None
    content = np.frombuffer(body.encode("ascii"), dtype=np.uint8)
    stops = _ends_of_cells(content, len(names), separator)
    if stops is None:
        return None
    starts = np.concatenate([np.zeros(1, dtype=np.int64), stops.ravel()[:-1] + 1]).reshape(stops.shape)
    if int((stops - starts).max()) >= csv.field_size_limit():
        return None
    return tuple(_plain_column(name, body, content, starts[:, i], stops[:, i]) for i, name in enumerate(names))


def _ends_of_cells(content: NDArray[np.uint8], width: int, separator: str) -> NDArray[np.int64] | None:
    """Where each cell ends, shape (rows, width); None where a row has more or fewer cells, or is blank."""
    is_break = content == ord("\n")
    places = np.flatnonzero(is_break | (content == ord(separator)))
    if (len(places) + 1) % width or (width == 1 and bool((np.diff(places, prepend=-1) == 1).any())):
        return None
    breaks = np.append(is_break[places], True).reshape(-1, width)
    if not bool(breaks[:, -1].all()) or bool(breaks[:, :-1].any()):
        return None
    return np.append(places, len(content)).reshape(-1, width)


def _plain_column(
    name: str, body: str, content: NDArray[np.uint8], starts: NDArray[np.int64], stops: NDArray[np.int64]
) -> Column:
    """The column whose cells are ``body[start:stop]``."""
    numbers = decimals(content, starts, stops)
    if numbers is None:
        return column_from_texts(name, [body[i:j] for i, j in zip(starts.tolist(), stops.tolist(), strict=True)])
    numbers.setflags(write=False)
    return Column(name=name, numbers=numbers)


def _rows(text: str, separator: str) -> Iterator[list[str]]:
    return csv.reader(StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True)


def _columns(text: str, separator: str, path: str) -> tuple[Column, ...]:
    """The columns of any file."""
    rows = _rows(text, separator)
    try:
        names = _names(next(rows, []), separator, path)
        cells: list[list[str]] = [[] for _ in names]
        while chunk := list(islice(rows, ROWS_AT_ONCE)):
            if set(map(len, chunk)) != {len(names)}:
                raise MbmError(*_row_faults(text, separator, path))
            for column, more in zip(cells, zip(*chunk, strict=True), strict=True):
                column.extend(more)
    except csv.Error:
        raise MbmError(*_row_faults(text, separator, path)) from None
    return tuple(column_from_texts(name, column) for name, column in zip(names, cells, strict=True))


def _names(header: Sequence[str], separator: str, path: str) -> tuple[str, ...]:
    """The names of the columns, blanks around them taken off."""
    place = DataPlace(file=path, row=1)
    names = [name.strip() for name in header]
    if not any(names):
        raise MbmError(format_faults.missing_header(place, "is blank"))
    if names[0].startswith("#"):
        raise MbmError(format_faults.comment_line(place))
    if len(names) == 1:
        for other, plural in SEPARATOR_NAMES.items():
            if other in names[0]:
                raise MbmError(format_faults.wrong_separator(place, SEPARATOR_NAMES[separator], plural))
    if all(reads_as_number(name) for name in names):
        raise MbmError(format_faults.missing_header(place, "holds only numbers"))
    return check_names(names, place)


def _row_faults(text: str, separator: str, path: str) -> list[Diagnostic]:
    """The first few rows that have not one cell for every column, up to a row that cannot be split."""
    found: list[Diagnostic] = []
    names: tuple[str, ...] = ()
    row = 0
    try:
        for row, cells in enumerate(_rows(text, separator), start=1):
            if row == 1:
                names = tuple(name.strip() for name in cells)
            elif len(cells) != len(names):
                found.append(_width_fault(row, cells, names, path))
            if len(found) == faults.MOST_ROWS_REPORTED:
                break
    except csv.Error as error:
        found.append(format_faults.bad_quotes(DataPlace(file=path, row=row + 1), str(error)))
    return found


def _width_fault(row: int, cells: Sequence[str], names: tuple[str, ...], path: str) -> Diagnostic:
    """What is wrong with a row that has too few or too many cells."""
    place = DataPlace(file=path, row=row)
    if not any(cell.strip() for cell in cells) and len(cells) < 2:
        return faults.short_row(place, row, 0, names)
    if cells[0].startswith("#"):
        return format_faults.comment_line(place)
    if len(cells) > len(names):
        return faults.long_row(place, row, len(cells), names)
    return faults.short_row(DataPlace(file=path, row=row, column=names[len(cells)]), row, len(cells), names)
