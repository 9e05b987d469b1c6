"""Names and numbers as other programs take them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from mbm.report.scenes.types import Indices

LONGEST = 60
"""Characters of a name; each takes four bytes at most, and files may have 255."""


def ids(names: Sequence[str]) -> list[int]:
    """Numbers for things with these names: the names themselves where all are whole numbers, else 1, 2, …"""
    if all(name.isdecimal() and len(name) <= 9 for name in names):
        found = [int(name) for name in names]
        if len(set(found)) == len(found):
            return found
    return list(range(1, len(names) + 1))


def word(name: str) -> str:
    """A name without blanks and characters that end a field, a line, or a path, nor longer than files may be called."""
    return re.sub(r"[^\w.+-]+", "_", name[:LONGEST]).lstrip(".") or "_"


def words(names: Sequence[str]) -> list[str]:
    """Such names, no two alike, whatever case the file system keeps."""
    taken: set[str] = set()
    found = []
    for name in map(word, names):
        each, count = name, 1
        while each.casefold() in taken:
            count += 1
            each = f"{name}-{count}"
        taken.add(each.casefold())
        found.append(each)
    return found


def numbers(values: Iterable[float]) -> str:
    """Numbers between blanks, with the digits that give them back; no negative zeros."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def in_order(owners: Indices, count: int) -> list[list[int]]:
    """The places of what belongs to each of so many owners."""
    found: list[list[int]] = [[] for _ in range(count)]
    for place, owner in enumerate(owners.tolist()):
        found[owner].append(place)
    return found
