"""What installed packages add, announced as entry points: looked for where mbm has nothing of a name, loaded when used.

A package that cannot be loaded is named by a diagnostic, and harms no problem that does without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from mbm.registry import faults
from mbm.text.types import MbmError, Span
from mbm.values import dataclass

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A group of entry points: its name, what is wanted of it, and whether something is that."""

    name: str
    wanted: str
    suits: Callable[[Any], bool]

    def announced(self) -> dict[str, EntryPoint]:
        """The entry points of the group by name, in the order of the names."""
        # The machinery of packages takes as long to load as many a solve: whoever needs it does so.
        from importlib.metadata import entry_points

        return {point.name: point for point in sorted(entry_points(group=self.name), key=lambda point: point.name)}

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


class WithPlugIns(Mapping[str, T]):
    """What mbm has by name, and then what packages announce; packages are asked for names that mbm does not have."""

    def __init__(self, own: Mapping[str, T], group: Group) -> None:
        self._own = own
        self._group = group
        self._announced = cache(group.announced)

    def __getitem__(self, name: str) -> T:
        if name in self._own:
            return self._own[name]
        found: T = self._group.loaded(self._announced()[name])
        return found

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._announced()

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from (name for name in self._announced() if name not in self._own)

    def __len__(self) -> int:
        return sum(1 for _ in self)
