"""Decisions read from bytes, so that Hypothesis draws once for a case, and its shrinking makes the case simpler."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


class Choices:
    """A stream of decisions; once the bytes are used up, every decision is the first, which is the simplest."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._position = 0

    def below(self, count: int) -> int:
        """An integer from 0 to ``count - 1`` (``count`` at most 65,536)."""
        size = 1 if count <= 256 else 2
        part = self._data[self._position : self._position + size]
        self._position += size
        return int.from_bytes(part, "little") % count

    def one_of(self, items: Sequence[T]) -> T:
        return items[self.below(len(items))]

    def chance(self, one_in: int) -> bool:
        return self.below(one_in) == one_in - 1

    def count(self, low: int, high: int) -> int:
        return low + self.below(high - low + 1)
