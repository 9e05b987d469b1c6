"""Which solves of a problem are made together: those of ``for-each`` and ``window`` whose equations suit one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache as kept
from typing import TYPE_CHECKING

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solution.assembly import Assembled
from mbm.solution.binding import EvaluationCache
from mbm.solution.estimate import assemble
from mbm.solution.many.chain import NOT_SOLVED, Chain
from mbm.solution.many.components import components_solver, estimated_on_the_way, several_noises
from mbm.solution.many.consensus import consensus_solver, loss_solver
from mbm.solution.many.descent import solver_of
from mbm.solution.many.sets import Sets, sets_of
from mbm.solution.many.solve import Together
from mbm.solution.many.stack import Stack, stack
from mbm.solution.many.suits import asks_for_one_search, suits
from mbm.solution.many.types import Begun, Descent, Ends, Solver
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Indices, Mask
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.solution.many.forms import Formed

FEW = 8
"""Solves up to which binding them together does not pay."""


def together(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    settings: Settings,
    cache: EvaluationCache,
    starts: Begun,
) -> Together | None:
    """The solves of a problem to be made together; None where they are to be made one by one.

    Raises:
        MbmError: more solves than can be meant, or a window's column without a number in some row.

    """
    window = problem.request.window
    names = problem.request.for_each if window is None else (*problem.request.for_each, window.column)
    if not names or not asks_for_one_search(settings):
        return None
    split = frozenset(name for name, table in tables.items() if any(c in table.columns for c in names))
    if not suits(problem, kernels, split):
        return None
    sets = sets_of(problem, tables)
    if sets is None or sets.count <= FEW:
        return None
    try:
        layout = cache.layouts.of(problem, tables, {})
        points = _starts(problem, tables, cache, sets, starts)
        bound = stack(problem, kernels, sets, layout, cache)
        number = int(np.argmax(bound.rows.sum(axis=0)))
        first, _ = assemble(problem, kernels, sets.selection(number).tables, {}, cache)
    except MbmError:
        return None  # which solve is at fault, the general path says
    if bound.equations.machine_code is None or any(len(groups) != 1 for groups in bound.derived):
        return None

    @kept
    def form() -> Formed | None:
        from mbm.solution.many.forms import formed

        return formed(bound, first, settings)

    before = None if window is None else _before(sets, window.min_rows)
    descent = _descent(problem, bound, first, points, before, form, settings)
    if descent is None:
        return None
    return Together(
        problem=problem,
        kernels=kernels,
        sets=sets,
        stack=bound,
        settings=settings,
        cache=cache,
        descent=descent,
        before=before,
        form=form,
    )


def _descent(
    problem: Problem,
    bound: Stack,
    first: Assembled,
    points: Floats,
    before: Indices | None,
    form: Callable[[], Formed | None],
    settings: Settings,
) -> Descent | None:
    """What solves from ``points`` (T, N) where these are stated; None where native code does not.

    Windows (``before`` as `Chain` has it) begin where the ones before ended, but for consensus that needs no start.
    """
    stated = settings.robust is not None or not _missing(bound, points).any()
    begun = points if stated else _begun(bound, points, form)
    if begun is None:
        return None
    solver: Solver | None
    if several_noises(problem):
        lossy = any(group.losses for group in bound.equations.groups)
        odd = settings.robust is not None or lossy
        solver = None if odd else components_solver(problem, bound, first, form, settings)
    elif settings.robust is not None:
        solver = consensus_solver(problem, bound, first, points, settings)
    elif estimated_on_the_way(problem) or any(not loss.convex for g in bound.equations.groups for loss in g.losses):
        solver = loss_solver(problem, bound, first, begun, settings)
    else:
        solver = solver_of(bound, settings)
    if solver is None:
        return None
    solve = solver
    if before is None or (settings.robust is not None and bool(_missing(bound, points).any())):
        given = None if stated else np.zeros(bound.solves, dtype=bool)
        return lambda which: replace(
            solve(which, begun[which.start : which.stop]),
            given=None if given is None else given[which.start : which.stop],
        )
    known = settings.robust is None and not any(block.unknown_factor for block in problem.blocks)
    ends, began = Chain(stack=bound, solve=solve, own=begun, before=before, known=known, settings=settings).ends()
    if settings.robust is not None:  # what was kept is found again, slice by slice
        lost = ends.reason < 0

        def again(which: range) -> Ends:
            found = solve(which, began[which.start : which.stop])
            return replace(found, reason=np.where(lost[which.start : which.stop], -1, found.reason))

        return again
    if not stated:
        ends = replace(ends, given=np.zeros(bound.solves, dtype=bool))
    return ends.part


def _missing(bound: Stack, points: Floats) -> Mask:
    """Which numbers (N,) that are estimated have no start of their own in some solve."""
    equations = bound.equations
    return np.asarray((equations.layout.guessed | ~np.isfinite(points).all(axis=0)) & equations.moving())


def _begun(bound: Stack, points: Floats, form: Callable[[], Formed | None]) -> Floats | None:
    """Where each solve begins (T, N) where a closed form says; ``points`` hold what is stated.

    None where something else gives starts; NaN in solves of which a closed form says nothing, or several things.
    """
    equations = bound.equations
    moving = equations.moving()
    missing = _missing(bound, points)
    if equations.linear and not _boxed(equations):
        return np.where(np.isfinite(points), points, 0.0)  # one step leads from anywhere to the answer
    apart = bool((missing != moving).any()) or bool((points[:, ~moving] != points[:1, ~moving]).any())
    found = None if apart else form()
    if found is None:
        return None
    return np.concatenate([found.starts(part) for part in bound.ranges()])


def _boxed(equations: Assembled) -> bool:
    return bool(np.isfinite(equations.lower).any() or np.isfinite(equations.upper).any() or equations.positive.any())


def _before(sets: Sets, least: int) -> Indices:
    """The number of the window before each that has ``least`` rows, as `Chain` has it."""
    solved = np.full(sets.count, True) if sets.used is None else sets.used >= least
    numbers = np.where(solved, np.arange(sets.count), -1)
    latest = np.maximum.accumulate(numbers)
    return np.where(solved, np.concatenate([[-1], latest[:-1]]), NOT_SOLVED)


def _starts(problem: Problem, tables: Mapping[str, Table], cache: EvaluationCache, sets: Sets, starts: Begun) -> Floats:
    """The point (T, N) where each solve starts; NaN where a number has none."""
    if not callable(starts):
        return np.tile(cache.layouts.of(problem, tables, starts).start, (sets.count, 1))
    found: list[Floats] = []
    last: Mapping[str, Floats] | None = None
    for cells in sets.keys:
        given = starts(dict(zip(sets.names, cells, strict=True)))
        # most often all solves are given the same
        found.append(found[-1] if given is last else cache.layouts.of(problem, tables, given).start)
        last = given
    return np.stack(found)
