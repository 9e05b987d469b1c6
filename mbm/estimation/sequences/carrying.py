"""Windows of a sequence one after the other, each with what is known of its first step by the rows that have left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.filtering import smoothed
from mbm.estimation.sequences.limits import limits_of
from mbm.estimation.sequences.places import names_of_step
from mbm.estimation.sequences.run import begun, ended, memory_of
from mbm.estimation.sequences.types import Carried, Name
from mbm.estimation.sequences.walk import Memory
from mbm.estimation.settings import Settings
from mbm.kernels.types import KernelSet
from mbm.problem.requests import Window
from mbm.problem.sequence.certain import let_go
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Method, Problem
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Window:
    """A window that is solved, of these other keys: its steps (T,), the memory of its walk, and what numbers are there.

    ``before`` is what it began with, None: what is stated of the first step.
    """

    before: Carried | None
    names: tuple[list[Name], list[Name]]
    others: Mapping[str, CellKey]
    steps: Floats
    memory: Memory


class Carrying:
    """What solves the windows of a problem, in their order, as `mbm.estimation.sequences.filtering.moved` solves one.

    What leaves a window is a prior of what stays: the rows that leave are linearised where the window has them, and
    those that stay are in none of it. For linear problems a window says what all rows up to its end say.

    Raises:
        MbmError: the problem has no states, or is not for a smoother.

    """

    def __init__(self, problem: Problem) -> None:
        window, sequence = problem.request.window, problem.sequence
        if window is None or sequence is None:
            raise MbmError(faults.not_carried(None if window is None else window.span, "has no `states`"))
        if not sequence.estimator.whole or sequence.estimator.cuts:
            raise MbmError(faults.not_carried(window.span, f"is for `:method {sequence.estimator.method.value}`"))
        if problem.request.method is Method.INTERVAL:
            raise MbmError(faults.not_carried(window.span, "is for `:method (interval)`"))
        if window.column != sequence.column:
            raise MbmError(faults.not_carried(window.span, f"has steps of `{sequence.column}`"))
        self._problem, self._later = problem, let_go(problem)
        self._window: Window = window
        self._last: _Window | None = None
        self._first: tuple[Mapping[str, CellKey], float] | None = None

    def __call__(
        self,
        kernels: KernelSet,
        tables: Mapping[str, Table],
        *,
        key: Mapping[str, CellKey],
        starts: Mapping[str, Floats],
        settings: Settings,
        cache: EvaluationCache,
        last: Solution | None = None,
    ) -> Solution:
        """The window of a key; the rows that have left are those of the windows before, whose ``last`` is not asked.

        Raises:
            MbmError: as `moved`.

        """
        began = perf_counter()
        problem, sequence = self._problem, self._problem.sequence
        steps = np.zeros(0) if sequence is None else tables[sequence.steps].numbers(sequence.column)
        others = {name: cell for name, cell in key.items() if name != self._window.column}
        carried = self._carried(others, steps)
        anew = carried is None and len(steps) > 0 and self._anew(others, float(steps[0]))
        asked = problem if carried is None else self._later
        whole = smoothed(asked, "`:carry`", "leave `:carry` out")
        ready = begun(whole, kernels, tables, starts, settings, cache, carried)
        for limit, span in limits_of(problem, ready.equations):
            raise MbmError(faults.not_carried(span, f"has an {limit}" if limit[0] == "i" else f"has {limit}"))
        memory = memory_of(ready)
        found = ended(ready, memory, kernels, key=key, starts=starts, settings=settings, began=began)
        if found.minimum.reason.converged:
            names = names_of_step(ready.equations.layout, ready.places)
            self._last = _Window(before=carried, names=names, others=others, steps=steps, memory=memory)
        if anew:
            found = replace(found, diagnostics=(*found.diagnostics, faults.begun_anew(self._window.span)))
        return found

    def _anew(self, others: Mapping[str, CellKey], step: float) -> bool:
        """Whether a window that begins at a step with what is stated of the first is not at the first."""
        if self._first is None or self._first[0] != others:
            self._first = (others, step)
        return self._first[1] != step

    def _carried(self, others: Mapping[str, CellKey], steps: Floats) -> Carried | None:
        last = self._last
        if last is None or last.others != others or not len(steps):
            return None
        count = int(np.searchsorted(last.steps, steps[0]))
        if count == 0 and last.steps[0] == steps[0]:
            return last.before
        if count == len(last.steps) or last.steps[count] != steps[0]:
            return None
        numbers, coordinates = ({name: at for at, name in enumerate(each)} for each in last.names)
        return Carried(prior=last.memory.carried(count), numbers=numbers, coordinates=coordinates)
