"""Form → one line of text that reads back to an equal form."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

from mbm.text import faults
from mbm.text.types import Bracket, Form, Keyword, MbmError, Numeral, Sequence, Symbol, Text

LONGEST = 5_000_000
"""Characters of a form that are printed: more than the largest text of a file has."""

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
    if printed_length(form) > LONGEST:
        raise MbmError(faults.too_long_to_print(form.span, LONGEST))
    return "".join(_pieces(form))


def print_beginning(form: Form, most: int) -> str:
    """The form as one line of at most ``most`` characters; the rest of a longer one is not even looked at."""
    text = ""
    for piece in _pieces(form):
        text += piece[: most + 1]
        if len(text) > most:
            return text[: most - 1] + "…"
    return text


def _pieces(form: Form) -> Iterator[str]:
    """What the line is made of, from left to right."""
    waiting: list[tuple[Form | str, int]] = [(form, 0)]  # a stack: built forms may nest deeper than Python calls do
    while waiting:
        part, level = waiting.pop()  # level: how many back-quotes around it are not undone by commas
        if isinstance(part, str):
            yield part
        elif not isinstance(part, Sequence):
            yield _print_atom(part)
        elif (prefix := quote_prefix(part)) is not None and (level > 0 or prefix in ("'", "`")):
            # an unquoted `@x` would read as a splice
            gap = " " if prefix == "," and isinstance(part.items[1], Symbol) and part.items[1].name[0] == "@" else ""
            waiting.append((part.items[1], level + _LEVELS[prefix]))
            yield prefix + gap
        else:
            waiting.append((_CLOSING[part.bracket], level))
            for number, item in enumerate(reversed(part.items)):
                waiting.extend(((" ", level), (item, level)) if number else ((item, level),))
            yield part.bracket.value


def printed_length(form: Form) -> int:
    """Characters of `print_form`, about, without printing: built forms share parts, and print them each time."""
    found: dict[int, int] = {}
    waiting: list[tuple[Form, bool]] = [(form, False)]
    while waiting:
        part, ready = waiting.pop()
        if id(part) in found and not ready:
            continue
        if not isinstance(part, Sequence):
            found[id(part)] = len(_print_atom(part))
        elif ready:
            found[id(part)] = 1 + sum(1 + found[id(item)] for item in part.items)
        else:
            waiting.append((part, True))
            waiting.extend((item, False) for item in part.items)
    return found[id(form)]


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


EXACT_INTEGERS = 2**53
"""From here on a double no longer tells whole numbers apart."""


def plain_number(value: float) -> int | float:
    """``value`` as people write it: whole numbers without a point, as far as doubles hold them exactly."""
    return int(value) if float(value).is_integer() and abs(value) < EXACT_INTEGERS else float(value)
