"""Text that a problem or its data brought: only functions that escape it may put it into generated text.

Each language has one place for that: `mbm.emit.c.text`, `mbm.emit.python.text`, `mbm.emit.casadi.files` (JSON),
`mbm.emit.markdown`, `mbm.emit.data_files` (CSV), and `mbm.emit.identifiers` for names of any of them. Nobody else
may look into a `Foreign`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NoReturn

from mbm.text.shown import one_line
from mbm.values import dataclass

LONGEST_LINE = 5_000
"""Characters of a text in a comment or README: more than equations have that anybody reads."""


@dataclass(frozen=True, slots=True)
class Foreign:
    """A name, key, unit, column, table, documentation or equation as the problem or its data have it: any characters.

    F-strings, ``str`` and ``join`` refuse it: a line of code that forgets to escape fails, rather than write code that
    somebody else has thought of.
    """

    unescaped: str

    def unescaped_line(self) -> str:
        """As readers want it in a comment: one line, and of more than `LONGEST_LINE` characters the first."""
        text = self.unescaped
        return one_line(text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE - 1]}…")

    def __bool__(self) -> bool:
        """Whether there is any text."""
        return bool(self.unescaped)

    def __repr__(self) -> str:
        """Nothing of the text: what is shown may be generated text."""
        return "<foreign text>"

    def __str__(self) -> NoReturn:
        """Refused.

        Raises:
            TypeError: always.

        """
        raise TypeError("text of a problem has to be escaped for the language that it gets into")

    def __format__(self, _specification: str) -> NoReturn:
        """Refused, as ``str`` is."""
        self.__str__()


Word = str | Foreign
"""A part of a text: mbm's own, or that of a problem."""


def told(*parts: Word) -> Foreign:
    """The parts as one text, which is as foreign as they are."""
    return Foreign("".join(part.unescaped if isinstance(part, Foreign) else part for part in parts))


def listed(parts: Iterable[Foreign]) -> Foreign:
    """Texts one after the other, with commas between them."""
    return Foreign(", ".join(part.unescaped for part in parts))
