"""Which row of its table a column is read from."""

from __future__ import annotations

from enum import StrEnum
from typing import TypeAlias


class RowChoice(StrEnum):
    """The row at hand, the first or last one, one that a key names, or those around a time.

    At the ends of a table the row two before (or after) a time is the third one from that end. COUNT is no row: in
    place of a number it says how many rows there are.
    """

    EACH = "each"
    FIRST = "first"
    LAST = "last"
    KEYED = "keyed"
    BEFORE = "before"
    AFTER = "after"
    TWO_BEFORE = "two before"
    TWO_AFTER = "two after"
    COUNT = "count"


Row: TypeAlias = RowChoice | int
"""A choice, or the place of a row from 0; behind the last row it is that of the last."""


def chosen_place(row: Row, count: int) -> int:
    """The place (from 0) of a row that is chosen of ``count`` rows, at least one."""
    if isinstance(row, int):
        return min(row, count - 1)
    return 0 if row is RowChoice.FIRST else count - 1
