"""What single numbers of unknowns and derived quantities are called: ``p[1]``, ``cam["left"][3]``, ``w@12[1]``."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.text.printer import plain_number
from mbm.text.types import Span

PRIOR = "prior "
"""What the name of the prior begins with that an unknown states for itself; the unknown's name follows."""


class TakenNames:
    """The names of equations so far, each with its place. Local to one elaboration."""

    def __init__(self, places: dict[str, Span] | None = None) -> None:
        self.places: dict[str, Span] = places or {}
        self._next: dict[str, int] = {}

    def free(self, base: str, span: Span) -> str:
        """``base``, or ``base-2``, ``base-3`` … where that is taken; it is taken from now on."""
        candidate = base
        while candidate in self.places:
            number = self._next.get(base, 2)
            candidate, self._next[base] = f"{base}-{number}", number + 1
        self.places[candidate] = span
        return candidate


def key_text(key: str | float) -> str:
    r"""A key inside a name: texts in quotes with ``"`` and ``\\`` escaped, numbers with all their digits.

    Two different keys never give the same text.
    """
    if not isinstance(key, str):
        return repr(plain_number(key))
    import json  # a fiftieth of a small solve, where names have keys

    return json.dumps(key, ensure_ascii=False)


def key_words(key: Mapping[str, str | float]) -> str:
    """``run = 3, camera = "left"``: the key of one of many solves."""
    return ", ".join(f"{name} = {key_text(value)}" for name, value in key.items())


def member_name(name: str, key: str | float | None, *, at_step: bool = False) -> str:
    """A quantity, or its member ``key`` where it has members: ``p``, ``cam["left"]``, ``x[1234567]``.

    ``at_step``: the key is a step, ``w@12``.
    """
    if key is None:
        return name
    return f"{name}@{key_text(key)}" if at_step else f"{name}[{key_text(key)}]"


def scalar_name(name: str, key: str | float | None, index: tuple[int, ...], *, at_step: bool = False) -> str:
    """One number of a quantity, as CONTRACT §2 names rows of covariances; ``index`` counts from 1, () for a number."""
    member = member_name(name, key, at_step=at_step)
    return f"{member}[{','.join(map(str, index))}]" if index else member


def place_of(index: tuple[int, ...], shape: tuple[int, ...]) -> int:
    """The place (from 0, row by row) of an index that counts from 1; () is that of a number."""
    if not index:
        return 0
    return index[0] - 1 if len(index) == 1 else (index[0] - 1) * shape[1] + index[1] - 1
