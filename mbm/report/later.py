"""The reports of solves that were made one by one, each written when somebody asks for it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TypeVar, overload

import numpy as np

from mbm.report.types import SolveReport

T = TypeVar("T")


def guarded(lock: AbstractContextManager[object], function: Callable[[], T]) -> Callable[[], T]:
    """The function, which holds the lock while it works something out."""

    def alone() -> T:
        with lock:
            return function()

    return alone


class Later(Sequence[T]):
    """A sequence whose items are made when they are asked for."""

    @abstractmethod
    def at(self, place: int) -> T:
        """The item at a place from 0."""

    @overload
    def __getitem__(self, index: int) -> T: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...

    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        if not isinstance(index, slice) and not -len(self) <= index < len(self):
            raise IndexError(f"there is no solve {index} of {len(self)}; places count from 0")
        places = range(len(self))[index]
        return tuple(map(self.at, places)) if isinstance(places, range) else self.at(places)


class LaterReports(Later[SolveReport]):
    """The reports that functions make, each once, and holding the ``lock``."""

    def __init__(self, makers: Iterable[Callable[[], SolveReport]], lock: AbstractContextManager[object]) -> None:
        self._reports: list[SolveReport | Callable[[], SolveReport]] = list(makers)
        self._lock = lock

    def __len__(self) -> int:
        return len(self._reports)

    def at(self, place: int) -> SolveReport:
        """The report at a place, made now if it was not yet."""
        found = self._reports[place]
        if isinstance(found, SolveReport):
            return found
        with self._lock, np.errstate(all="ignore"):  # overflow and NaN are results here, as in the solve
            made = self._reports[place]  # perhaps by another thread meanwhile
            if not isinstance(made, SolveReport):
                made = self._reports[place] = made()
        return made


class LaterByNumber(Mapping[int, SolveReport]):
    """The same of some solves among many, by their numbers."""

    def __init__(self, makers: Mapping[int, Callable[[], SolveReport]], lock: AbstractContextManager[object]) -> None:
        self._places = {number: place for place, number in enumerate(makers)}
        self._reports = LaterReports(makers.values(), lock)

    def __len__(self) -> int:
        return len(self._places)

    def __iter__(self) -> Iterator[int]:
        return iter(self._places)

    def __contains__(self, number: object) -> bool:
        return number in self._places

    def __getitem__(self, number: int) -> SolveReport:
        return self._reports[self._places[number]]
