"""Text of a user's files as a terminal may have it: the one place where what is not printable is taken out.

Escape sequences could write to the clipboard or the window title, bidirectional marks show names in another order than
they are, and line breaks feign lines that mbm never said. All of these are what `str.isprintable` denies.

Foreign text is cleaned where it is put into a line: by the constructors of `mbm.text.types.Diagnostic` and ``Label``,
by `Paint`, by the columns of tables (`mbm.report.columns`), and by `joined`, which makes a text of lines. Whatever
writes to a terminal passes `printable` once more.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import StrEnum

from mbm.values import dataclass


class Style(StrEnum):
    """What a stretch of text is; the value is its ANSI code."""

    HEADING = "1"
    GOOD = "1;32"
    BAD = "1;31"
    WARNING = "1;33"
    NOTE = "1;34"
    QUIET = "2"


@dataclass(frozen=True, slots=True)
class Paint:
    """Makes a text part of a line (`one_line`), and colours it for a terminal if ``color``."""

    color: bool

    def __call__(self, text: str, style: Style) -> str:
        """The text in a style."""
        text = one_line(text)
        return f"\x1b[{style.value}m{text}{_RESET}" if self.color and text else text


_RESET = "\x1b[0m"
_OURS = "|".join(map(re.escape, (_RESET, *(f"\x1b[{style.value}m" for style in Style))))


def one_line(text: str) -> str:
    """A text as part of a line: blanks for white space of any kind, U+FFFD for what else is not printable.

    The result has as many characters as ``text``.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)


def cut(text: str, longest: int) -> str:
    """A text as part of a line, and not endless: of more than ``longest`` characters the first, and an ellipsis."""
    return one_line(text) if len(text) <= longest else f"{one_line(text[: longest - 1])}…"


def joined(lines: Iterable[str], *, color: bool = False) -> str:
    """The text of ``lines``, no line break at its end: whatever stands in a line, it stays one.

    With ``color``, what `Paint` added stays.
    """
    return "\n".join(_painted(line) if color else one_line(line) for line in lines)


def printable(text: str, *, color: bool = False) -> str:
    """A text of several lines as it may reach a terminal; with ``color``, what `Paint` added stays.

    What comes from a file has gone through `one_line` where it was put into the text: this is the last look.
    """
    return joined(text.split("\n"), color=color)


def cell_width(text: str) -> int:
    """Columns of a terminal: East Asian wide characters take two, marks that combine with another character none."""
    if text.isascii():
        return len(text)
    import unicodedata  # most texts need none of its tables

    return sum(
        0
        if unicodedata.category(character) in ("Mn", "Me") or character in _JOINED_JAMO
        else 1 + (unicodedata.east_asian_width(character) in ("W", "F"))
        for character in text
    )


_JOINED_JAMO = frozenset(map(chr, range(0x1160, 0x1200)))
"""Vowels and final consonants of Korean, which terminals draw into the cell of the first consonant."""


def _painted(line: str) -> str:
    marks = re.findall(_OURS, line)
    parts = re.split(_OURS, line)
    return "".join(one_line(part) + mark for part, mark in zip(parts, (*marks, ""), strict=True))
