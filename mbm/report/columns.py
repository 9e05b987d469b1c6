"""Texts → columns of a plain table: padding, points below one another, colour that does not count as width.

Each text becomes part of a line here (`cut`), so that names, units and keys of a file need no other care.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

from mbm.text.shown import cell_width, cut
from mbm.text.types import LONGEST_MESSAGE

LONGEST_CELL = 100
"""Characters of a cell that are shown; the document has all."""

Pad: TypeAlias = Callable[[Sequence[str]], list[str]]
"""Makes the cells of a column one width."""

_WHOLE_PART = r"\(?[+-]?[0-9]+"


def aligned(texts: Sequence[str]) -> list[str]:
    """Numbers as texts, padded to one width so that their decimal points stand below one another."""
    items = [cut(text, LONGEST_CELL) for text in texts]
    whole = [_whole_width(text) for text in items]
    before = max(whole, default=0)
    return left(" " * (before - taken) + text for text, taken in zip(items, whole, strict=True))


def left(texts: Iterable[str]) -> list[str]:
    """Texts padded on the right to one width."""
    items, gaps = _gaps(texts)
    return [text + gap for text, gap in zip(items, gaps, strict=True)]


def right(texts: Iterable[str]) -> list[str]:
    """Texts padded on the left to one width."""
    items, gaps = _gaps(texts)
    return [gap + text for text, gap in zip(items, gaps, strict=True)]


def laid_out(rows: Sequence[Sequence[str]], how: Sequence[Pad]) -> list[tuple[str, ...]]:
    """The rows of a table, the cells of each column padded as ``how`` says for it."""
    columns = zip(*rows, strict=True) if rows else [()] * len(how)
    return list(zip(*(pad(column) for pad, column in zip(how, columns, strict=True)), strict=True))


def wrapped(text: str, widest: int) -> list[str]:
    """A sentence on lines of at most ``widest`` columns, the later ones indented; one empty line for no text."""
    lines: list[str] = []
    line = ""
    for word in cut(text, LONGEST_MESSAGE).split(" "):
        longer = f"{line} {word}" if line.strip() else line + word
        if line.strip() and cell_width(longer) > widest:
            lines.append(line.rstrip())
            longer = _INDENT + word
        while cell_width(longer) > widest:
            count = max(_fitting(longer, widest), len(_INDENT) + 1 if lines else 1)
            lines.append(longer[:count])
            longer = _INDENT + longer[count:]
        line = longer
    return [*lines, line.rstrip()] if line.strip() or not lines else lines


def fitting(text: str, room: int) -> str:
    """A text in ``room`` columns, cut where it does not fit."""
    shown = cut(text, LONGEST_MESSAGE)
    return shown if cell_width(shown) <= room else f"{shown[: _fitting(shown, room - 1)].rstrip()}…"


_INDENT = "    "


def _fitting(text: str, room: int) -> int:
    """How many characters of a text take ``room`` columns at most."""
    taken = 0
    for count, character in enumerate(text):
        taken += cell_width(character)
        if taken > room:
            return count
    return len(text)


def _gaps(texts: Iterable[str]) -> tuple[list[str], list[str]]:
    """The texts as parts of lines, and the blanks that each lacks to the width of the widest."""
    items = [cut(text, LONGEST_CELL) for text in texts]
    widths = [cell_width(text) for text in items]
    widest = max(widths, default=0)
    return items, [" " * (widest - taken) for taken in widths]


def _whole_width(text: str) -> int:
    """Columns before the decimal point, or before where it would stand."""
    match = re.match(_WHOLE_PART, text)
    return cell_width(text) if match is None else match.end()
