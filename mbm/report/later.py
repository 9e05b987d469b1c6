"""The reports of solves that were made one by one, each written when somebody asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import overload

import numpy as np

from mbm.report.types import SolveReport


class LaterReports(Sequence[SolveReport]):
    """The reports that functions make, each once."""

    def __init__(self, makers: Iterable[Callable[[], SolveReport]]) -> None:
        self._reports: list[SolveReport | Callable[[], SolveReport]] = list(makers)

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
        if not isinstance(found, SolveReport):
            with np.errstate(all="ignore"):  # overflow and NaN are results here, as in the solve
                found = self._reports[index] = found()
        return found
