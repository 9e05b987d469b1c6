"""All solves of a problem, one after the other, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.interruption import Interruption
from mbm.equations.selection import Selection, selections
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Alone, Failure, Skipped, Solution
from mbm.estimation.settings import Forms, Settings, settings_of, standard_forms
from mbm.estimation.solve.estimate import estimate
from mbm.estimation.solve.sampled_rows import with_moved_rows
from mbm.kernels.faults import is_failed_call
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.tables import CellKey
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Begun, Block

StartsFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The starts (SI, by name) given from outside for the solve with a key."""


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """The number of solves, and the solves as they are made: one by one, or in blocks that hold columns.

    Where there are blocks, what is made says which solves it is; they may follow one another in any order.
    """

    count: int
    parts: Iterator[Solution | Failure | Skipped | Alone | Block]


def solutions(
    found: Elaborated,
    kernels: KernelSet,
    cache: EvaluationCache,
    starts: StartsFinder | None,
    interruption: Interruption | None = None,
    forms: Forms = standard_forms,
    workers: int | None = None,
) -> Solutions:
    """The solves that the problem's ``for-each`` and ``window`` ask for; one without them.

    One of several solves that cannot be set up is a ``Failure``, and the others go on; a function in Python that fails
    ends them all. A window starts from the last
    one where that is better; one with too few rows is ``Skipped``. An ``interruption`` ends the solve at work, and
    makes no further ones. ``starts`` is None where no start is given from outside. ``workers`` threads share what can
    be made together, solves or starts (None: one for each processor); the answers do not depend on their number.

    Raises:
        MbmError: the only solve cannot be set up.
    """
    problem = found.problem
    settings = replace(settings_of(problem.request, interruption, forms), workers=workers)
    given = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    window = problem.request.window
    begun: Begun = given if starts is None else _with(starts, given) if given else starts
    solve = _one_by_one(found, kernels, cache, begun, settings)
    at_once = None
    if problem.request.for_each or window is not None:
        # Loaded by problems with many solves only, so that the others start at once.
        from mbm.estimation.batches.together import together

        at_once = together(problem, kernels, found.tables, settings, cache, begun)
    if at_once is not None:
        if interruption is not None:
            interruption.listen()
        return Solutions(at_once.count, at_once.blocks(workers, solve))
    count, picked = selections(problem, found.tables)

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


def _with(starts: StartsFinder, given: Mapping[str, Floats]) -> StartsFinder:
    return lambda key: {**starts(key), **given}


def _one_by_one(
    found: Elaborated, kernels: KernelSet, cache: EvaluationCache, starts: Begun, settings: Settings
) -> Callable[[Selection, Solution | None], Solution | Failure | Skipped]:
    """What solves one selection of the rows by itself, given the solution of the window before."""
    window = found.problem.request.window

    def solve(selection: Selection, last: Solution | None) -> Solution | Failure | Skipped:
        if window is not None and selection.rows is not None and selection.rows < window.min_rows:
            return Skipped(key=selection.key, rows=selection.rows, wanted=window.min_rows)
        try:
            solution = estimate(
                found.problem,
                kernels,
                selection.tables,
                key=selection.key,
                starts=starts(selection.key) if callable(starts) else starts,
                settings=settings,
                cache=cache,
                last=last,
            )
            return with_moved_rows(found.problem, kernels, cache, solution)
        except MbmError as error:
            if not selection.key or is_failed_call(error):
                raise
            return Failure(key=selection.key, diagnostics=error.diagnostics)

    return solve
