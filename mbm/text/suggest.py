"""A misspelt name → the name that was probably meant."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import datetime
from typing import TypeVar

from mbm.text.shown import cut

Otherwise = TypeVar("Otherwise", bound=str | None)

_SIGNED = r"([-+])([A-Za-z][\w.]*)"
_BETWEEN = r"([A-Za-z][\w.]*|\d[\w.]*)([-+*/^])([A-Za-z][\w.]*|\d+(?:\.\d+)?)"

ELSEWHERE = {"!=": "(not (= a b))", "/=": "(not (= a b))", "<>": "(not (= a b))", "&&": "and", "**": "^"}
"""What names mean in other languages."""


def infix(name: str) -> tuple[str, tuple[str, ...]] | None:
    """The operator and operands of a name that is arithmetic as other languages write it: ``-x``, ``x/2``."""
    if match := re.fullmatch(_SIGNED, name):
        return match[1], (match[2],)
    if match := re.fullmatch(_BETWEEN, name):
        return match[2], (match[1], match[3])
    return None


def closest(name: str, candidates: Iterable[str]) -> str | None:
    """The candidate that ``name`` was probably meant to be, or None if none is near enough.

    Near is measured by the edit distance with transpositions (Damerau 1964, restricted), upper and lower case taken
    as equal: one edit for names up to five letters, one more for every three letters beyond; a name of one letter
    only matches itself in the other case. Ties go to the candidate that agrees in case, then to the one nearer in
    length, then by alphabet, so that the order of the candidates does not matter. ``name`` itself is never suggested.
    Operators of other languages are no misspelt ones (`ELSEWHERE`).
    """
    if name in ELSEWHERE:
        return ELSEWHERE[name]
    limit = 0 if len(name) < 2 else max(1, len(name) // 3)
    folded = name.casefold()
    best: tuple[int, int, int, str] | None = None
    for candidate in candidates:
        if candidate == name or abs(len(candidate) - len(name)) > limit:
            continue
        distance = edit_distance(folded, candidate.casefold(), limit)
        if distance > limit:
            continue
        cased = edit_distance(name, candidate, len(name) + len(candidate))
        found = (distance, cased, abs(len(candidate) - len(name)), candidate)
        if best is None or found < best:
            best = found
    return None if best is None else best[3]


def did_you_mean(near: str | None, otherwise: Otherwise) -> str | Otherwise:
    """The hint that asks whether ``near`` was meant; ``otherwise`` where nothing is near."""
    return f"did you mean `{near}`?" if near else otherwise


def listed(names: tuple[str, ...]) -> str:
    """The first names, for a hint."""
    shown = [f"`{n}`" for n in names[:8]]
    return ", ".join(shown) + (" …" if len(names) > 8 else "")


def suggestion(name: str, candidates: Iterable[str], otherwise: Otherwise) -> str | Otherwise:
    """`did_you_mean` of the candidate that is `closest` to ``name``."""
    return did_you_mean(closest(name, candidates), otherwise)


def edit_distance(a: str, b: str, limit: int) -> int:
    """The least number of insertions, deletions, replacements and swaps of neighbours from ``a`` to ``b``.

    Beyond ``limit`` some number greater than ``limit`` is returned.
    """
    before_last: list[int] = []
    last = list(range(len(b) + 1))
    for i, left in enumerate(a, start=1):
        row = [i]
        for j, right in enumerate(b, start=1):
            cost = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (left != right))
            if i > 1 and j > 1 and left == b[j - 2] and a[i - 2] == right:
                cost = min(cost, before_last[j - 2] + 1)
            row.append(cost)
        if min(row) > limit and (not last or min(last) > limit):
            return limit + 1
        before_last, last = last, row
    return last[-1]


def is_number(cell: str) -> bool:
    """Whether a text is a finite decimal number."""
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", cell.strip(), re.ASCII | re.IGNORECASE) is not None


def for_a_number(cell: str) -> str:
    """What to do about a cell of text where a number is wanted: dates are recognised as ISO 8601 has them."""
    if is_number(cell):
        return "the column holds texts, this one too, though it reads as a number: give numbers, without quotes"
    try:
        datetime.fromisoformat(cell)
    except ValueError:
        return "correct the cell, or leave it empty (`NA` in a problem's own table) and allow gaps with `:missing skip`"
    return "give times as numbers, in seconds since some start"


def how_to_index(name: str, index: str) -> str:
    """What to write for ``name[index]``."""
    name, inside = cut(name, 40), cut(" ".join(index.strip("[]").split()), 40)
    read = f"`{name}[{inside}]` is read as `{name}` and a vector"
    return f"{read}: an element, or a member by its key, is `({name} {inside})`"
