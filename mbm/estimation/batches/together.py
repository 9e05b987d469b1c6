"""Which solves of a problem are made together: those of ``for-each`` and ``window`` whose equations suit one batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache as kept, partial
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache, affine
from mbm.equations.selected import column_families
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.answers import answers
from mbm.estimation.batches.beside import sample
from mbm.estimation.batches.chain import NOT_SOLVED, Chain, places_before
from mbm.estimation.batches.components import components_solver, estimated_on_the_way, several_noises
from mbm.estimation.batches.consensus import consensus_solver, loss_solver
from mbm.estimation.batches.descent import solver_of
from mbm.estimation.batches.parts import Part, bound_parts
from mbm.estimation.batches.sets import Sets, sets_of
from mbm.estimation.batches.solve import NOTHING, Apart, Past, Together
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.suits import asks_for_one_search, suits
from mbm.estimation.batches.types import Begun, Block, Descent, Ends, Solver, Which, places_of
from mbm.estimation.consensus.known_ranges import known_ranges
from mbm.estimation.search.challenge import kind_of
from mbm.estimation.search.solution import Alone, Solution
from mbm.estimation.settings import Settings
from mbm.kernels.types import KernelSet
from mbm.problem.tables import Table
from mbm.problem.types import Problem, UnknownKind
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.forms import Formed
    from mbm.solver.range_maps import RangeMaps


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


FEW_SOLVES = 8
"""Solves up to which binding them together does not pay."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Closed:
    """The closed form of all solves, and that of ranges, with which the solver compares starts; each if there is one.

    Called by one thread.
    """

    form: Callable[[], Formed | None]
    ranges: Callable[[], RangeMaps | None]


def together(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    settings: Settings,
    cache: EvaluationCache,
    starts: Begun,
) -> Together | Several | None:
    """The solves of a problem to be made together; None where they are to be made one by one.

    Raises:
        MbmError: more solves than can be meant, or a window's column without a number in some row.

    """
    window = problem.request.window
    names = problem.request.for_each if window is None else (*problem.request.for_each, window.column)
    if not names or not asks_for_one_search(settings) or (settings.robust is not None and settings.robust.literal):
        return None
    likely = any(kernel.plain is not None for kernel in kernels.kernels)
    if likely and problem.estimates_noise:
        return None  # the redundancy of groups follows from what their readings tell
    if not suits(problem, kernels, _divided(problem, tables, names)):
        return None
    sets = sets_of(problem, tables)
    if sets is None or sets.count <= FEW_SOLVES:
        return None
    try:
        parts, left = bound_parts(problem, kernels, sets, cache, starts, FEW_SOLVES)
    except MbmError:
        return None  # which solve is at fault, the general path says
    odd = settings.robust is not None or estimated_on_the_way(problem)
    if window is not None and odd and len(parts) > 1:
        return None  # windows of different shape with estimated noise are solved one by one
    found = []
    rest = [left]
    for part in parts:
        made = _made(problem, kernels, part, settings, cache)
        if made is None:
            rest.append(part.which)
        else:
            found.append((part.which, made))
    if not found:
        return None
    if len(found[0][0]) == sets.count:
        return found[0][1]
    return Several(problem=problem, sets=sets, parts=tuple(found), rest=np.concatenate(rest), settings=settings)


def _divided(problem: Problem, tables: Mapping[str, Table], names: tuple[str, ...]) -> frozenset[str]:
    """The tables that are divided by the columns ``names``, those of the distinct values of a column with its table."""
    families = column_families(problem)
    split = {name for name, t in tables.items() if name not in families and any(c in t.columns for c in names)}
    return frozenset(split | {name for name, family in families.items() if family.table in split})


def _made(
    problem: Problem, kernels: KernelSet, part: Part, settings: Settings, cache: EvaluationCache
) -> Together | None:
    """The solves of a part; None where native code does not make them."""
    bound, window = part.bound, problem.request.window
    if any(len(groups) != 1 for groups in bound.derived):
        return None
    if window is not None and _idle(bound):
        return None  # members that nothing is said of keep what they were in the window before
    elsewhere = _may_lie_elsewhere(part, settings)
    if elsewhere and (window is not None or _missing(bound, part.points).any()):
        return None  # the best of the places is the answer, unless a start is stated

    @kept
    def form() -> Formed | None:
        from mbm.estimation.batches.forms import formed, recognised_in

        found = recognised_in(bound.exactly(), part.first.uncorrected(), settings)
        return None if found is None else formed(bound.exactly(), found, settings)

    def ranges() -> RangeMaps | None:
        from mbm.estimation.starts.closed_forms.rows import ENOUGH

        plain = not (bound.equations.linear or bound.equations.constraints or bound.equations.lossy)
        plain = plain and not bound.equations.likely
        known = plain and kind_of(part.first) not in cache.without_closed_form
        if not known or int(bound.rows.max(initial=0)) > ENOUGH:
            return None
        return known_ranges(cache).of(part.first, settings, stated=not problem.estimates_noise, many=True)

    before = None if window is None else _before(part.sets, window.min_rows)
    closed = _Closed(form=form, ranges=ranges)
    descent = _descent(problem, bound, part.first, part.points, before, closed, settings)
    if descent is None:
        return None
    alone = elsewhere or _may_be_correlated(problem, bound, settings)
    answered = partial(answers, problem, bound, descent=descent, examined_alone=alone)
    beside = sample(problem, kernels, part, settings, cache, answered)
    return Together(
        problem=problem,
        kernels=kernels,
        sets=part.sets,
        stack=bound,
        settings=settings,
        cache=cache,
        answers=answered if beside is None else lambda which: beside.looked_at(which, answered(which)),
        before=before,
        form=form,
        places=part.which,
    )


def _may_lie_elsewhere(part: Part, settings: Settings) -> bool:
    """Whether the poses of a solve may be moved as one to another minimum, which is looked for in each solve alone."""
    if not any(entry.unknown.kind is UnknownKind.POSE for entry in part.bound.equations.layout.entries):
        return False
    # Loaded by poses only, so that the others start at once.
    from mbm.estimation.search.rival_places import may_lie_elsewhere

    return part.bound.errors is None and may_lie_elsewhere(part.bound.equations, settings)


def _may_be_correlated(problem: Problem, bound: Stack, settings: Settings) -> bool:
    """Whether rows of a solve may follow one another in a chain, which is tested for each solve alone."""
    if all(unknown.family is None for unknown in problem.unknowns) and not any(b.earlier for b in problem.blocks):
        return False
    # Loaded by families and `previous` only, so that the others start at once.
    from mbm.estimation.trust.chains import may_be_correlated

    plain = settings.robust is None and bound.errors is None
    return plain and may_be_correlated(problem, bound.equations, int(bound.residuals.max(initial=0)))


def _fitting(problem: Problem, bound: Stack, first: Assembled, settings: Settings) -> Solver | None:
    """What fits equations with errors in measured columns; None where native code does not."""
    if not several_noises(problem):
        return solver_of(bound, settings)
    # Where closed forms may fit better, each solve is compared with them.
    return None if bound.equations.lossy else components_solver(problem, bound, first, lambda: None, settings)


def _descent(
    problem: Problem,
    bound: Stack,
    first: Assembled,
    points: Floats,
    before: Indices | None,
    closed: _Closed,
    settings: Settings,
) -> Descent | None:
    """What solves from ``points`` (T, N) where these are stated; None where native code does not.

    Windows (``before`` as `Chain` has it) begin where the ones before ended, but for consensus that needs no start.
    """
    if bound.equations.constraints and not _simple(problem, bound, settings):
        return None
    stated = settings.robust is not None or not _missing(bound, points).any()
    begun = points if stated else _begun(bound, points, closed.form, settings)
    if begun is None:
        return None
    solver: Solver | None
    if bound.errors is not None:
        # Loaded by problems with errors in measured columns only, so that the others start at once.
        from mbm.estimation.batches.corrected import corrected_solver

        odd = settings.robust is not None or _begins_at_agreement(problem, bound)
        solver = None if odd else corrected_solver(bound, _fitting(problem, bound, first, settings), settings)
    elif settings.robust is not None:
        solver = consensus_solver(problem, bound, first, points, settings)
    elif _begins_at_agreement(problem, bound):
        solver = loss_solver(problem, bound, first, begun, settings)
    elif several_noises(problem):
        solver = components_solver(problem, bound, first, closed.form, settings)
    else:
        solver = solver_of(bound, settings, closed.ranges() if stated or before is not None else None)
    if solver is None:
        return None
    solve = solver
    if before is None or (settings.robust is not None and bool(_missing(bound, points).any())):
        given = None if stated else np.zeros(bound.solves, dtype=bool)
        return lambda which: replace(
            solve(which, begun[places_of(which)]),
            given=None if given is None else given[places_of(which)],
        )
    known = settings.robust is None and not problem.estimates_noise
    ends, began = Chain(
        stack=bound,
        solve=solve,
        own=begun,
        before=before,
        known=known,
        blocks=len(problem.blocks) if estimated_on_the_way(problem) else None,
        places=places_before(bound, before),
        settings=settings,
    ).ends()
    if settings.robust is not None:  # what was kept is found again, slice by slice
        lost = ends.reason < 0

        def again(which: Which) -> Ends:
            found = solve(which, began[places_of(which)])
            return replace(found, reason=np.where(lost[places_of(which)], -1, found.reason))

        return again
    return replace(ends, given=None).part if stated else ends.part


def _simple(problem: Problem, bound: Stack, settings: Settings) -> bool:
    """Whether constraints stand beside nothing but equations of one noise, and losses with one minimum."""
    convex = all(loss.convex for group in bound.equations.groups for loss in group.losses)
    odd = estimated_on_the_way(problem) or settings.robust is not None
    return convex and not odd


def _begins_at_agreement(problem: Problem, bound: Stack) -> bool:
    """Whether losses begin where the least median of squares is: some are not convex, or of unknown noise."""
    lossy = any(block.unknown_factor and block.loss is not None for block in problem.blocks)
    return lossy or any(not loss.convex for group in bound.equations.groups for loss in group.losses)


def _idle(bound: Stack) -> bool:
    """Whether there are members that no equation mentions."""
    layout = bound.equations.layout
    return len(bound.equations.free) + int(layout.fixed.sum()) < len(layout.number)


def _missing(bound: Stack, points: Floats) -> Mask:
    """Which numbers (N,) that are estimated have no start of their own in some solve."""
    equations = bound.equations
    return np.asarray((equations.layout.guessed | ~np.isfinite(points).all(axis=0)) & equations.moving())


def _begun(bound: Stack, points: Floats, form: Callable[[], Formed | None], settings: Settings) -> Floats | None:
    """Where each solve begins (T, N) where a closed form says; ``points`` hold what is stated.

    None where something else gives starts; NaN in solves of which a closed form says nothing, or several things.
    """
    equations = bound.exactly().equations
    moving = equations.moving()
    missing = _missing(bound, points)
    free = equations.is_free
    linear = equations.linear and all(affine(group, free) for group in equations.constraints)
    if linear and not _boxed(equations):
        anywhere = np.where(np.isfinite(points), points, 0.0)  # there is one minimum, which every start leads to
        if not bound.equations.likely:
            return anywhere
        rough = solver_of(bound.exactly(), settings)
        return None if rough is None else rough(range(bound.solves), anywhere).points
    apart = (
        bool(equations.constraints)
        or bool((missing != moving).any())
        or bool((points[:, ~moving] != points[:1, ~moving]).any())
    )
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
