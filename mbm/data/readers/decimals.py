"""Decimal numbers in the bytes of a file → float64, all cells of a column at once, exactly as ``float`` reads them.

A number of up to 15 digits is a whole number w below 2⁵³ over a power of ten up to 10²²: both are float64 without
error, so that their quotient is rounded once, to the nearest, as ``float`` does (Clinger 1990, the fast path).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.problem.tables import Numbers

MOST_DIGITS = 15
"""Digits of a whole number that float64 holds whatever they are."""

WIDEST = MOST_DIGITS + 2
"""Characters of a cell: the digits, a sign and a point."""

AT_ONCE = 32_768
"""Cells that are read together, so that what is worked on stays in the processor's cache."""

_POWERS = 10.0 ** np.arange(MOST_DIGITS + 1)
_ZERO, _POINT, _MINUS, _PLUS = (np.uint8(ord(character)) for character in "0.-+")


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
