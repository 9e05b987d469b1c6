"""All solves of a problem, one after the other, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.builder import Elaborated
from mbm.problem.tables import CellKey
from mbm.solution.binding import EvaluationCache
from mbm.solution.estimate import estimate
from mbm.solution.interruption import Interruption
from mbm.solution.sampled_rows import settled
from mbm.solution.selection import Selection, selections
from mbm.solution.settings import Forms, settings_of, standard_forms
from mbm.solution.solution import Failure, Skipped, Solution
from mbm.solution.types import Floats
from mbm.text.types import MbmError

StartsFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The starts (SI, by name) given from outside for the solve with a key."""


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """The number of solves, and the solves as they are made."""

    count: int
    each: Iterator[Solution | Failure | Skipped]


def solutions(
    found: Elaborated,
    kernels: KernelSet,
    cache: EvaluationCache,
    starts: StartsFinder,
    interruption: Interruption | None = None,
    forms: Forms = standard_forms,
) -> Solutions:
    """The solves that the problem's ``for-each`` and ``window`` ask for; one without them.

    One of several solves that cannot be set up is a ``Failure``, and the others go on. A window starts from the last
    one where that is better; one with too few rows is ``Skipped``. An ``interruption`` ends the solve at work, and
    makes no further ones.

    Raises:
        MbmError: the only solve cannot be set up.
    """
    problem = found.problem
    request = problem.request
    settings = settings_of(request, interruption, forms)
    given = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    count, picked = selections(problem, found.tables)
    window = request.window

    def solve(selection: Selection, last: Solution | None) -> Solution | Failure | Skipped:
        if window is not None and selection.rows is not None and selection.rows < window.min_rows:
            return Skipped(key=selection.key, rows=selection.rows, wanted=window.min_rows)
        try:
            return settled(
                problem,
                kernels,
                cache,
                {**starts(selection.key), **given},
                lambda begun: estimate(
                    problem,
                    kernels,
                    selection.tables,
                    key=selection.key,
                    starts=begun,
                    settings=settings,
                    cache=cache,
                    last=last,
                ),
            )
        except MbmError as error:
            if not selection.key:
                raise
            return Failure(key=selection.key, diagnostics=error.diagnostics)

    def each() -> Iterator[Solution | Failure | Skipped]:
        last: Solution | None = None
        if interruption is not None:
            interruption.listen()
        for selection in picked:
            if settings.stopped():
                return
            solved = solve(selection, last)
            if window is not None and isinstance(solved, Solution):
                last = solved if np.isfinite(solved.minimum.cost) else last
            yield solved

    return Solutions(count, each())
