"""All solves of a problem, one after the other, as they are asked for.

Rows outside of a sampled table are unused: those that the start puts there, for the whole solve. Where the estimates
put other rows outside, the answer is that of the rows that were used, and says which these are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from mbm.equations import faults
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.gathering import samplings
from mbm.equations.interruption import Interruption
from mbm.equations.selection import Selection, selections
from mbm.equations.types import Floats, Indices
from mbm.estimation.intervals.network import Enclosure
from mbm.estimation.search.solution import Alone, Failure, Skipped, Solution
from mbm.estimation.sequences.filtering import moved
from mbm.estimation.settings import Forms, Moves, Settings, settings_of, standard_forms
from mbm.estimation.solve.estimate import estimate
from mbm.kernels.faults import is_failed_call
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.tables import CellKey
from mbm.problem.types import Method, Problem
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass, replace

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Begun, Block

StartsFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The starts (SI, by name) given from outside for the solve with a key; NaN where none is given."""


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """The number of solves, and the solves as they are made: one by one, or in blocks that hold columns.

    Where there are blocks, what is made says which solves it is; they may follow one another in any order.
    """

    count: int
    parts: Iterator[Solution | Enclosure | Failure | Skipped | Alone | Block]


def solutions(
    found: Elaborated,
    kernels: KernelSet,
    cache: EvaluationCache,
    starts: StartsFinder | None,
    interruption: Interruption | None = None,
    forms: Forms = standard_forms,
    workers: int | None = None,
    moved: Moves | None = None,
) -> Solutions:
    """The solves that the problem's ``for-each`` and ``window`` ask for; one without them.

    One of several solves that cannot be set up is a ``Failure``, and the others go on; a function in Python that fails
    ends them all. A window starts from the last
    one where that is better; one with too few rows is ``Skipped``. An ``interruption`` ends the solve at work, and
    makes no further ones. ``starts`` is None where no start is given from outside. ``workers`` threads share what can
    be made together, solves or starts (None: one for each processor); the answers do not depend on their number.
    ``moved`` as `Moves`: no estimates are made together then.

    Raises:
        MbmError: the only solve cannot be set up.
    """
    problem = found.problem
    settings = replace(settings_of(problem.request, interruption, forms), workers=workers, moved=moved)
    given = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    begun: Begun = given if starts is None else _with(starts, given) if given else starts
    make = _one_of(problem)
    if problem.request.method is Method.INTERVAL:
        bounded = _one_by_one(problem, begun, _enclosing(found, settings))
        return _in_order(found, bounded, settings)
    solve = _one_by_one(problem, begun, _estimating(make, found, kernels, cache, settings))
    at_once = None
    several = problem.request.for_each or problem.request.window is not None
    if several and problem.sequence is None and moved is None:
        # Loaded by problems with many solves only, so that the others start at once.
        from mbm.estimation.batches.together import together

        at_once = together(problem, kernels, found.tables, settings, cache, begun)
    if at_once is not None:
        if interruption is not None:
            interruption.listen()
        return Solutions(at_once.count, at_once.blocks(workers, solve))
    return _in_order(found, solve, settings)


def _in_order(
    found: Elaborated,
    solve: Callable[[Selection, Solution | None], Solution | Enclosure | Failure | Skipped],
    settings: Settings,
) -> Solutions:
    """One solve after the other; a window starts from the last one with a finite cost."""
    count, picked = selections(found.problem, found.tables)

    def each() -> Iterator[Solution | Enclosure | Failure | Skipped]:
        last: Solution | None = None
        if settings.interruption is not None:
            settings.interruption.listen()
        for selection in picked:
            if settings.stopped():
                return
            solved = solve(selection, last)
            if found.problem.request.window is not None and isinstance(solved, Solution):
                last = solved if np.isfinite(solved.minimum.cost) else last
            yield solved

    return Solutions(count, each())


def _with(starts: StartsFinder, given: Mapping[str, Floats]) -> StartsFinder:
    return lambda key: {**starts(key), **given}


Solved = TypeVar("Solved")
Solving: TypeAlias = Callable[[Selection, Mapping[str, Floats], Solution | None], Solved]
"""What solves one selection of the rows by itself, given starts, and the solution of the window before."""


def _enclosing(found: Elaborated, settings: Settings) -> Solving[Enclosure]:
    """Bounds of the solutions; kernels give points, not boxes, and are not asked."""
    # Loaded by problems with bounds only, so that the others start at once.
    from mbm.estimation.intervals.enclosing import enclose

    return lambda selection, begun, _: enclose(found.problem, selection, begun, settings.stopped)


def _one_of(problem: Problem) -> Callable[..., Solution]:
    """What solves one data set of a problem by itself: as `estimate` does."""
    window = problem.request.window
    if window is not None and window.carry:
        # Loaded by problems with states only, so that the others start at once.
        from mbm.estimation.sequences.carrying import Carrying

        return Carrying(problem)
    return partial(estimate if problem.sequence is None else moved, problem)


def _estimating(
    make: Callable[..., Solution], found: Elaborated, kernels: KernelSet, cache: EvaluationCache, settings: Settings
) -> Solving[Solution]:
    """Estimates."""

    def solve(selection: Selection, starts: Mapping[str, Floats], last: Solution | None) -> Solution:
        solution = make(
            kernels,
            selection.tables,
            key=selection.key,
            starts=starts,
            settings=settings,
            cache=cache,
            last=last,
        )
        return with_moved_rows(found.problem, kernels, cache, solution)

    return solve


def _one_by_one(
    problem: Problem, starts: Begun, solving: Solving[Solved]
) -> Callable[[Selection, Solution | None], Solved | Failure | Skipped]:
    """What solves one selection of the rows by itself, whatever comes of it.

    Windows with too few rows are solved for what they carry to the next.
    """
    window = problem.request.window

    def solve(selection: Selection, last: Solution | None) -> Solved | Failure | Skipped:
        skipped: Skipped | None = None
        if window is not None and selection.rows is not None and selection.rows < window.min_rows:
            skipped = Skipped(key=selection.key, rows=selection.rows, wanted=window.min_rows)
            if not window.carry:
                return skipped
        try:
            found = solving(selection, starts(selection.key) if callable(starts) else starts, last)
        except MbmError as error:
            if not selection.key or is_failed_call(error):
                raise
            return skipped or Failure(key=selection.key, diagnostics=error.diagnostics)
        return skipped or found

    return solve


def with_moved_rows(problem: Problem, kernels: KernelSet, cache: EvaluationCache, solution: Solution) -> Solution:
    """The solution, with a warning for each observation of which other rows lie inside than at the start."""
    if not any(samplings(kernel) for kernel in kernels.kernels) or not np.isfinite(solution.minimum.cost):
        return solution
    used = _positions(solution.groups)
    places = replace(solution.layout, start=solution.numbers)
    now = _positions(Binder(problem=problem, layout=places, tables=solution.tables, cache=cache).equations(kernels))
    said: list[Diagnostic] = []
    for owner, block in enumerate(problem.blocks):
        if block.table is None:
            continue
        before, after = (each.get(owner, np.empty(0, dtype=np.int64)) for each in (used, now))
        rows = solution.tables[block.table].rows
        left, entered = (rows[np.setdiff1d(a, b)] for a, b in ((before, after), (after, before)))
        if len(left) or len(entered):
            said.append(faults.sampled_rows_moved(block.span, block.name, left.tolist(), entered.tolist()))
    return replace(solution, doubts=lambda: (*solution.doubts(), *said)) if said else solution


def _positions(groups: tuple[Group, ...]) -> dict[int, Indices]:
    """The rows in use of each block that samples a table."""
    found: dict[int, list[Indices]] = {}
    for group in groups:
        if group.sampled and group.positions is not None:
            found.setdefault(group.kernel.owner, []).append(group.positions)
    return {owner: np.concatenate(parts) for owner, parts in found.items()}
