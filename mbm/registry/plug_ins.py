"""What installed packages add, announced as entry points.

A package that cannot be loaded is named by a diagnostic, and harms no problem that does without it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from mbm.registry import faults
from mbm.text.types import MbmError, Span
from mbm.values import dataclass


@lru_cache(maxsize=64)
def _announced(
    found: Callable[..., Any], group: str, _places: tuple[tuple[str, int], ...]
) -> tuple[tuple[str, EntryPoint], ...]:
    """The entry points of a group that are ``found`` where packages are: looked for once, as that takes longer than a
    small solve.
    """
    return tuple((point.name, point) for point in sorted(found(group=group), key=lambda point: point.name))


def _changed(path: str) -> int:
    """When something was put into a folder, or taken out of it; 0 where there is none."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A group of entry points: its name, what is wanted of it, and whether something is that."""

    name: str
    wanted: str
    suits: Callable[[Any], bool]

    def announced(self) -> dict[str, EntryPoint]:
        """The entry points of the group by name, in the order of the names."""
        return dict(_announced(entry_points, self.name, tuple((path, _changed(path)) for path in sys.path)))

    def loaded(self, point: EntryPoint, span: Span | None = None) -> Any:
        """What an entry point leads to.

        Raises:
            MbmError: the package cannot be loaded, or announces something else; said at ``span``.
        """
        try:
            found = point.load()
        except Exception as error:
            raise MbmError(self._broken(point, span, f"{type(error).__name__}: {error}")) from error
        if not self.suits(found):
            raise MbmError(self._broken(point, span, f"it is of the type {type(found).__name__}, and no {self.wanted}"))
        return found

    def _broken(self, point: EntryPoint, span: Span | None, reason: str) -> Any:
        package = point.value.partition(":")[0] if point.dist is None else point.dist.name
        return faults.broken_plug_in(span, point.name, self.name, package, reason)
