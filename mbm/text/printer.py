"""Form → one line of text that reads back to an equal form."""

from __future__ import annotations

from fractions import Fraction

from mbm.text import faults
from mbm.text.types import Bracket, Form, Keyword, MbmError, Numeral, Sequence, Symbol, Text

LONGEST = 5_000_000
"""Words, brackets and blanks of a form that are printed: as many as the largest text of a file can hold, some 20 MB."""

PREFIXES = {"quote": "'", "quasiquote": "`", "unquote": ",", "unquote-splicing": ",@"}
"""What ``(quote x)`` and its kin are written as, by head."""

_LEVELS = {"'": 0, "`": 1, ",": -1, ",@": -1}
_ESCAPES = str.maketrans({"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t"})
_CLOSING = {Bracket.ROUND: ")", Bracket.SQUARE: "]"}


def print_form(form: Form) -> str:
    """The form as one line. ``'x`` is printed for ``(quote x)``; numbers keep every digit and stay what they are:
    ``10`` an integer, ``10.0`` a float, ``1/3`` a fraction.

    Raises:
        MbmError: too-long-to-print; a form that is built may hold the same part many times.

    """
    pieces: list[str] = []
    waiting: list[tuple[Form | str, int]] = [(form, 0)]  # a stack: built forms may nest deeper than Python calls do
    while waiting:
        if len(pieces) > LONGEST:
            raise MbmError(faults.too_long_to_print(form.span, LONGEST))
        part, level = waiting.pop()  # level: how many back-quotes around it are not undone by commas
        if isinstance(part, str):
            pieces.append(part)
        elif not isinstance(part, Sequence):
            pieces.append(_print_atom(part))
        elif (prefix := quote_prefix(part)) is not None and (level > 0 or prefix in ("'", "`")):
            # an unquoted `@x` would read as a splice
            gap = " " if prefix == "," and isinstance(part.items[1], Symbol) and part.items[1].name[0] == "@" else ""
            waiting.append((part.items[1], level + _LEVELS[prefix]))
            pieces.append(prefix + gap)
        else:
            waiting.append((_CLOSING[part.bracket], level))
            for number, item in enumerate(reversed(part.items)):
                waiting.extend(((" ", level), (item, level)) if number else ((item, level),))
            pieces.append(part.bracket.value)
    return "".join(pieces)


def quote_prefix(form: Form) -> str | None:
    """The prefix that a ``(quote x)``-like list may be written with, or None."""
    if isinstance(form, Sequence) and len(form.items) == 2 and form.head is not None:
        return PREFIXES.get(form.head)
    return None


def print_number(value: int | Fraction | float) -> str:
    """The digits from which the same number is read."""
    if isinstance(value, float):
        return repr(value)
    return str(value)


def print_text(value: str) -> str:
    """The string literal for ``value``."""
    return f'"{value.translate(_ESCAPES)}"'


def _print_atom(atom: Symbol | Keyword | Text | Numeral) -> str:
    match atom:
        case Symbol():
            return atom.name
        case Keyword():
            return f":{atom.name}"
        case Text():
            return print_text(atom.value)
        case Numeral():
            return print_number(atom.value) + (atom.unit or "")
