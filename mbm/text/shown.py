"""Text of a user's files as a terminal may have it: the one place where what is not printable is taken out.

Escape sequences could write to the clipboard or the window title, bidirectional marks show names in another order than
they are, and line breaks feign lines that mbm never said. All of these are what `str.isprintable` denies.
"""

from __future__ import annotations

import re
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
    """Colours a text for a terminal, or leaves it as it is."""

    color: bool

    def __call__(self, text: str, style: Style) -> str:
        """The text in a style."""
        return f"\x1b[{style.value}m{text}{_RESET}" if self.color and text else text


_RESET = "\x1b[0m"
_OURS = re.compile("|".join(map(re.escape, ("\n", _RESET, *(f"\x1b[{style.value}m" for style in Style)))))


def one_line(text: str) -> str:
    """A text as part of a line: blanks for line breaks and tabulators, U+FFFD for what else is not printable.

    The result has as many characters as ``text``.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def printable(text: str, *, color: bool = False) -> str:
    """A text of several lines as it may reach a terminal; with ``color``, what `Paint` added stays.

    What comes from a file has gone through `one_line` where it was put into the text: this is the last look.
    """
    if not color:
        return "\n".join(map(one_line, text.split("\n")))
    kept = _OURS.findall(text)
    parts = _OURS.split(text)
    return "".join(one_line(part) + mark for part, mark in zip(parts, (*kept, ""), strict=True))
