"""Rows of ASCII without quotes → columns, some of the bytes after the others: what it takes is room for the numbers.

Each column is read as numbers as long as all its cells are; one that turns out to hold texts is read again from the
first row. Cells become float64 all at once, exactly as ``float`` reads them: a number of up to 15 digits is a whole
number w below 2⁵³ over a power of ten up to 10²²; both are float64 without error, so that their quotient is rounded
once, to the nearest, as ``float`` does (Clinger 1990, the fast path).
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import column_from_texts
from mbm.problem.tables import Column, Numbers
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
