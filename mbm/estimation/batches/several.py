"""Many solves of several shapes: those of each shape together, the rest one by one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.types import Indices
from mbm.estimation.batches.sets import Sets
from mbm.estimation.batches.solve import NOTHING, Apart, Past, Together
from mbm.estimation.batches.types import Block
from mbm.estimation.search.solution import Alone, Solution
from mbm.estimation.settings import Settings
from mbm.problem.types import Problem
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Several:
    """All solves of a problem: those of ``parts`` with their numbers, made together, and the ``rest``.

    What is made says which solves it is; solves of several parts may follow one another in any order. The parts of
    windows have no gaps but for windows that are skipped, so that each begins where the one before ends.
    """

    problem: Problem
    sets: Sets
    parts: tuple[tuple[Indices, Together], ...]
    rest: Indices
    settings: Settings

    @property
    def count(self) -> int:
        """T."""
        return self.sets.count

    def blocks(self, workers: int | None, apart: Apart) -> Iterator[Block | Alone]:
        """All solves, part by part, as `Together.blocks` gives them, and those of the rest between them."""
        past = NOTHING
        heads = {int(which[0]): part for which, part in self.parts}
        for number in sorted([*heads, *self.rest.tolist()]):
            if self.settings.stopped():
                return
            part = heads.get(number)
            if part is not None:
                past = yield from part.blocks(workers, apart, past)
                past = self._behind(past)
                continue
            solved = apart(self.sets.selection(number), past.last() if self._carries(number) else None)
            if self.problem.request.window is not None and isinstance(solved, Solution):
                past = self._after(solved, past)
            yield Alone(place=number, solution=solved)

    def _carries(self, number: int) -> bool:
        """Whether a solve may begin where the one before it ends: it is a window, and has rows enough."""
        window, used = self.problem.request.window, self.sets.used
        return window is not None and used is not None and bool(used[number] >= window.min_rows)

    def _after(self, solved: Solution, past: Past) -> Past:
        """What is to be known behind a window that was solved by itself."""
        return Past(last=lambda: solved, spoilt=0) if np.isfinite(solved.minimum.cost) else past

    def _behind(self, past: Past) -> Past:
        """What the part behind another has to know: its first window begins where another one ends."""
        return Past(last=past.last, spoilt=-1 if self.problem.request.window is None else 0)
