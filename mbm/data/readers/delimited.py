"""Rows of cells between separators: what CSV and TSV have in common (RFC 4180, quoting in TSV too).

The first row names the columns. Text is UTF-8, with or without a byte order mark; lines may end in any way; blank lines
at the end are passed over, comments are not. A row of several lines (a line break in quotes) counts once.

Rows of ASCII without quotes → columns, some of the bytes after the others: what it takes is room for the numbers.

Each column is read as numbers as long as all its cells are; one that turns out to hold texts is read again from the
first row. Cells become float64 all at once, exactly as ``float`` reads them: a number of up to 15 digits is a whole
number w below 2⁵³ over a power of ten up to 10²²; both are float64 without error, so that their quotient is rounded
once, to the nearest, as ``float`` does (Clinger 1990, the fast path).
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import MOST_COLUMNS, check_names, column_from_texts, column_length, row_numbers
from mbm.data.content import PER_ROW, cells_in, check_table, check_text, read_bytes, text_of
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable
from mbm.problem.tables import Column, Numbers, reads_as_number
from mbm.text.types import DataPlace, Diagnostic, MbmError
from mbm.values import dataclass

BYTES_AT_ONCE = 1 << 20
"""Bytes that are looked at together: where their cells end takes ten times the room of the cells."""


MOST_DIGITS = 15
"""Digits of a whole number that float64 holds whatever they are."""
WIDEST = MOST_DIGITS + 2
"""Characters of a cell: the digits, a sign and a point."""
AT_ONCE = 32_768
"""Cells that are read together, so that what is worked on stays in the processor's cache."""
_POWERS = 10.0 ** np.arange(MOST_DIGITS + 1)
_ZERO, _POINT, _MINUS, _PLUS = (np.uint8(ord(character)) for character in "0.-+")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """Some rows: their bytes, and where in these each cell begins and ends, shapes (rows, width)."""

    content: NDArray[np.uint8]
    starts: NDArray[np.int64]
    stops: NDArray[np.int64]

    def numbers(self, name: str, column: int) -> Numbers | None:
        """The cells of a column as numbers, gaps as NaN; None if one is neither."""
        found = decimals(self.content, self.starts[:, column], self.stops[:, column])
        return column_from_texts(name, self.texts(column)).numbers if found is None else found

    def texts(self, column: int) -> list[str]:
        """The cells of a column as they stand there."""
        text = self.content.tobytes().decode("ascii")
        ends = zip(self.starts[:, column].tolist(), self.stops[:, column].tolist(), strict=True)
        return [text[start:stop] for start, stop in ends]


def plain_columns(
    content: bytes,
    rows: tuple[int, int],
    separator: str,
    names: Sequence[str],
    expect_texts: Callable[[int], None],
) -> tuple[Column, ...] | None:
    """The columns of the rows at ``content[rows[0] : rows[1]]``, without the last line break.

    None where a row is blank or has more or fewer cells than there are ``names``, or a cell is longer than those of
    CSV are. ``expect_texts`` is told how many cells are about to become texts.
    """
    found: list[list[Numbers] | None] = [[] for _ in names]
    count = 0
    for first, last in _stretches(content, rows):
        part = _part(content[first:last], len(names), separator)
        if part is None:
            return None
        count += len(part.starts)
        for i, (name, parts) in enumerate(zip(names, found, strict=True)):
            if parts is None:
                continue
            numbers = part.numbers(name, i)
            if numbers is None:
                found[i] = None
            else:
                parts.append(numbers)
    texts = [i for i, parts in enumerate(found) if parts is None]
    expect_texts(count * len(texts))
    written = dict(zip(texts, _texts(content, rows, separator, len(names), texts), strict=True))
    return tuple(
        column_from_texts(name, written[i]) if parts is None else _joined(name, parts)
        for i, (name, parts) in enumerate(zip(names, found, strict=True))
    )


def _joined(name: str, parts: list[Numbers]) -> Column:
    """The column of numbers that were read part by part."""
    numbers = np.concatenate(parts)
    parts.clear()
    numbers.setflags(write=False)
    return Column(name=name, numbers=numbers)


def _texts(
    content: bytes, rows: tuple[int, int], separator: str, width: int, columns: Sequence[int]
) -> list[list[str]]:
    """The cells of some columns, as they stand in the file."""
    cells: list[list[str]] = [[] for _ in columns]
    if columns:
        for first, last in _stretches(content, rows):
            part = _part(content[first:last], width, separator)
            for column, more in zip(columns, cells, strict=True):
                more.extend([] if part is None else part.texts(column))
    return cells


def _stretches(content: bytes, rows: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Where some whole rows begin, and where the line break behind them stands."""
    first, end = rows
    while first <= end:
        last = content.find(b"\n", min(first + BYTES_AT_ONCE, end), end)
        last = end if last < 0 else last
        yield first, last
        first = last + 1


def _part(content: bytes, width: int, separator: str) -> _Part | None:
    """The rows in ``content``; None where one has more or fewer cells than ``width``, is blank, or has a long cell."""
    characters = np.frombuffer(content, dtype=np.uint8)
    is_break = characters == ord("\n")
    places = np.flatnonzero(is_break | (characters == ord(separator)))
    if (len(places) + 1) % width:
        return None
    breaks = np.append(is_break[places], True).reshape(-1, width)
    if not bool(breaks[:, -1].all()) or bool(breaks[:, :-1].any()):
        return None
    stops = np.append(places, len(characters)).reshape(-1, width)
    starts = np.concatenate([np.zeros(1, dtype=np.int64), stops.ravel()[:-1] + 1]).reshape(stops.shape)
    lengths = stops - starts
    if int(lengths.max()) >= csv.field_size_limit() or (width == 1 and not bool(lengths.all())):
        return None
    return _Part(content=characters, starts=starts, stops=stops)


def decimals(content: NDArray[np.uint8], starts: NDArray[np.int64], stops: NDArray[np.int64]) -> Numbers | None:
    """The numbers (n,) whose characters are ``content[start:stop]``, blanks around them not among these.

    None where one is written in any way but digits with at most one point and a sign before them, or is too long.
    """
    result = np.empty(len(starts))
    if bool((stops - starts > WIDEST).any()):
        return None
    for first in range(0, len(starts), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        found = _some(content, starts[part], stops[part] - starts[part])
        if found is None:
            return None
        result[part] = found
    return result


def _some(content: NDArray[np.uint8], starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> Numbers | None:
    """The same for as many cells as fit the cache; ``lengths`` (n,) are not negative."""
    if not bool(lengths.all()):
        return None
    leading = content[starts]
    signed = (leading == _MINUS) | (leading == _PLUS)
    whole = np.zeros(len(starts), dtype=np.int64)
    digits = np.zeros(len(starts), dtype=np.int64)
    behind = np.zeros(len(starts), dtype=np.int64)
    pointed = np.zeros(len(starts), dtype=bool)
    last = len(content) - 1
    for place in range(int(lengths.max())):
        character = content[np.minimum(starts + place, last)]
        inside = lengths > place
        digit = character - _ZERO  # wraps below zero, beyond nine
        numeral = inside & (digit < 10)
        point = inside & (character == _POINT) & ~pointed
        known = numeral | point | ~inside
        if not bool((known | signed).all() if place == 0 else known.all()):
            return None
        whole = np.where(numeral, whole * 10 + digit, whole)
        digits += numeral
        behind += numeral & pointed
        pointed |= point
    if not bool((digits > 0).all()) or bool((digits > MOST_DIGITS).any()):
        return None
    numbers = whole / _POWERS[behind]
    return np.where(leading == _MINUS, -numbers, numbers)


SEPARATOR_NAMES = {",": "commas", "\t": "tabulators", ";": "semicolons"}
ROWS_AT_ONCE = 500
"""Rows split before they are sorted into columns: with more, the garbage collector walks them again and again."""

PER_PLAIN_CELL = 36
"""Bytes for a cell of a plain file: its number, twice while the parts of a column are joined, and room to work."""

_LINE = re.compile(r"[^\r\n]*(?:\r\n?|\n)|[^\r\n]+")


def read_delimited(path: Path, separator: str) -> RawTable:
    """Read the file at ``path``, whose cells are separated by ``separator``.

    Raises MbmError as ``read_text`` does, and missing-header, wrong-separator, comment-line, bad-quotes, short-row,
    long-row, too-many-columns, bad-column-name, duplicate-column.
    """
    content, digest = read_bytes(path)
    content = content.removeprefix(codecs.BOM_UTF8)
    columns = _plain(content, separator, path)
    if columns is None:
        check_text(path, content, separator.encode())
        text = text_of(content, path).replace("\r\n", "\n")
        columns = _columns(text[: _last_line_end(text)], separator, path.as_posix())
    rows = row_numbers(2, column_length(columns[0]))
    return RawTable(path=path.as_posix(), sha256=digest, columns=columns, file_rows=rows)


def _last_line_end(text: str) -> int:
    """Where the last line ends that is not blank; the tabulators at the end of that line are empty cells."""
    end = len(text.rstrip(" \r\n"))
    breaks = [found for found in (text.find("\n", end), text.find("\r", end)) if found >= 0]
    return min(breaks, default=len(text))


def _plain(content: bytes, separator: str, path: Path) -> tuple[Column, ...] | None:
    """The columns of a file of ASCII without quotes that has one cell for every column in each row; None for others.

    The result is that of ``_columns``, several times faster and in a third of the memory.
    """
    if not content.isascii() or b'"' in content or b"\0" in content:
        return None
    cells = cells_in(content, separator.encode())
    needed = 2 * len(content) + PER_PLAIN_CELL * cells + PER_ROW * content.count(b"\n")
    check_table(path, cells, needed)
    content = content.replace(b"\r\n", b"\n")
    if b"\r" in content or content.isspace():
        return None
    last = content.find(b"\n", len(content.rstrip(b" \n")))
    last = len(content) if last < 0 else last
    first = content.find(b"\n", 0, last) + 1
    if not first:
        return None
    try:
        names = _names(next(_rows(content[: first - 1].decode("ascii"), separator), []), separator, path.as_posix())
    except csv.Error:
        return None
    return plain_columns(content, (first, last), separator, names, lambda cells: check_table(path, cells))


def _rows(text: str, separator: str) -> Iterator[list[str]]:
    lines = (line[0] for line in _LINE.finditer(text))
    return csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)


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
    if len(header) > MOST_COLUMNS:
        raise MbmError(faults.too_many_columns(place, len(header), MOST_COLUMNS))
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
