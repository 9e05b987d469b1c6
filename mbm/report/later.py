"""The reports of solves that were made one by one, each written when somebody asks for it."""

from __future__ import annotations

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


class LaterReports(Sequence[SolveReport]):
    """The reports that functions make, each once, and holding the ``lock``."""

    def __init__(self, makers: Iterable[Callable[[], SolveReport]], lock: AbstractContextManager[object]) -> None:
        self._reports: list[SolveReport | Callable[[], SolveReport]] = list(makers)
        self._lock = lock

    def __len__(self) -> int:
        return len(self._reports)

    @overload
    def __getitem__(self, index: int) -> SolveReport: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[SolveReport]: ...

    def __getitem__(self, index: int | slice) -> SolveReport | Sequence[SolveReport]:
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        found = self._reports[index]
        if isinstance(found, SolveReport):
            return found
        with self._lock, np.errstate(all="ignore"):  # overflow and NaN are results here, as in the solve
            made = self._reports[index]  # perhaps by another thread meanwhile
            if not isinstance(made, SolveReport):
                made = self._reports[index] = made()
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
