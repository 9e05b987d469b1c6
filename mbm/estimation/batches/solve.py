"""Many solves in slices: each slice one native batch and one look at its answers, by several threads.

Which solves a slice holds does not depend on the number of threads, nor do the answers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import EvaluationCache
from mbm.equations.metric import rounding_at, roundings, steps_between
from mbm.equations.selection import Selection
from mbm.equations.types import Floats, Indices, Mask, Minimum, Noise
from mbm.estimation.batches.chain import NOT_SOLVED, SAME_ENDS
from mbm.estimation.batches.components import estimated_on_the_way
from mbm.estimation.batches.descent import solver_of
from mbm.estimation.batches.raw import raw_rows
from mbm.estimation.batches.sets import Sets
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import REASONS, Block, Columns, Corrections
from mbm.estimation.consensus.types import Prepared
from mbm.estimation.search.challenge import Challenge
from mbm.estimation.search.multistart import ORIGIN as LAST_WINDOW
from mbm.estimation.search.search import Found
from mbm.estimation.search.solution import Failure, Skipped, Solution
from mbm.estimation.search.starting import GIVEN, partly_foreknown
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import Run, answered, assemble
from mbm.estimation.solve.weighing import Reached
from mbm.estimation.uncertainty.variance import common_factor
from mbm.kernels.types import KernelSet
from mbm.problem.types import Problem
from mbm.solver.decisions import takes_over, worth_following
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.forms import Formed

FEW_CHALLENGED = 8
"""Up to so many solves are compared with the closed form one by one; recognising it in all takes longer."""

FOLLOWED = np.vectorize(worth_following, otypes=[bool])
TAKEN_OVER = np.vectorize(takes_over, otypes=[bool])
"""What decides whether another minimum is the answer, for many solves."""

Apart = Callable[[Selection, Solution | None], Solution | Failure | Skipped]
"""Solves one data set by itself, from the beginning, or from where the window before it ended."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Past:
    """What windows have to know of the blocks before.

    ``last`` gives the solution of the last window that has one; ``spoilt`` is the number of a window that began where
    the one before it turned out not to end (-1: none).
    """

    last: Callable[[], Solution | None]
    spoilt: int


def _past(last: Solution | None, spoilt: int) -> Past:
    return Past(last=lambda: last, spoilt=spoilt)


NOTHING = _past(None, -1)
"""Before the first window."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Together:
    """Many solves of one problem whose equations are bound together.

    ``answers`` are those of some consecutive solves. ``before`` (T,) is the number of the window before each, as
    `Chain` has it (None: these are no windows). ``form`` gives the closed form for all solves, None where there is
    none; called by one thread, it is made once. ``places`` (T,) are the numbers of the solves among all of the problem.
    """

    problem: Problem
    kernels: KernelSet
    sets: Sets
    stack: Stack
    settings: Settings
    cache: EvaluationCache
    answers: Callable[[range], Columns]
    before: Indices | None
    form: Callable[[], Formed | None]
    places: Indices

    @property
    def equations(self) -> Assembled:
        """The equations of all solves."""
        return self.stack.equations

    @property
    def count(self) -> int:
        """T."""
        return self.stack.solves

    def blocks(self, workers: int | None, apart: Apart, past: Past = NOTHING) -> Generator[Block, None, Past]:
        """All solves, slice by slice; ``apart`` solves those that are left to the general path.

        ``workers`` threads (None: one for each processor) are at work while a block is looked at. ``past`` is what is
        to be known of the windows before these; in the end, what is to be known behind them is returned.
        """
        slices = self.stack.ranges()

        threads = min(workers or os.cpu_count() or 1, len(slices))
        if threads == 1:
            for which in slices:
                if self.settings.stopped():
                    return past
                block, past = self._block(which, self.answers(which), apart, past)
                yield block
            return past
        with ThreadPoolExecutor(max_workers=threads) as pool:
            ahead = iter([(which, pool.submit(self.answers, which)) for which in slices])
            try:
                for which, answer in ahead:
                    if self.settings.stopped():
                        answer.cancel()
                        return past
                    block, past = self._block(which, answer.result(), apart, past)
                    yield block
            finally:
                for _, answer in islice(ahead, None):
                    answer.cancel()
        return past

    def _block(self, which: range, columns: Columns, apart: Apart, past: Past) -> tuple[Block, Past]:
        """The block with those solved apart that need it: from their ends where these are good, else from the start.

        ``past`` is what is to be known of the blocks before; the answer has it for those behind.
        """
        found: dict[int, Solution | Failure | Skipped] = {}
        # what following closed forms takes is counted here
        columns = replace(columns, iterations=columns.iterations.copy(), evaluations=columns.evaluations.copy())
        clean, stands = columns.clean.copy(), self._standing(which, columns)
        spoilt, searched = past.spoilt, which.start
        plain = self.settings.robust is None and not estimated_on_the_way(self.problem)
        for place in range(len(which)):
            number = which.start + place
            if clean[place] and stands[place] and number != spoilt:
                continue
            if self.settings.stopped():
                which, columns, clean = range(which.start, number), columns.first(place), clean[:place]
                break
            good = columns.solved[place] and plain and number != spoilt
            if good and (stands[place] or self._stands(number, columns, place)):
                if not columns.clean[place]:
                    found[number] = self.solution(number, columns, place)
                continue
            last = self._last(range(searched, number), columns, which.start, found, past)
            searched, past = number, _past(last, past.spoilt)
            found[number] = apart(self.sets.selection(number), last)
            clean[place] = False
            if self.before is not None and not _alike(found[number], columns.points[place]):
                spoilt = _behind(self.before, number)
        columns = replace(columns, clean=clean)
        block = Block(
            which=which,
            rows=self._rows(which),
            names=self.sets.names,
            keys=self.sets.keys,
            columns=columns,
            apart=found,
            make=self._maker(apart, lambda n: self._last(range(which.start, n), columns, which.start, found, past)),
            layout=self.equations.layout,
            free=self.equations.free,
            members={
                unknown.name: self.stack.arranged.families[unknown.family.rows].keys
                for unknown in self.problem.unknowns
                if unknown.family is not None and unknown.family.rows in self.stack.arranged.families
            },
            places=self.places[which.start : which.stop],
            corrections=lambda: _corrections(self.stack, which, columns),
            raw=lambda: raw_rows(self.problem, self.stack, which, columns),
            lock=self.cache.lock,
        )
        behind = range(searched, which.stop)
        return block, Past(last=lambda: self._last(behind, columns, which.start, found, past), spoilt=spoilt)

    def _last(
        self,
        before: range,
        columns: Columns,
        first: int,
        found: Mapping[int, Solution | Failure | Skipped],
        past: Past,
    ) -> Solution | None:
        """The last solution of the windows ``before``, in a block that begins with ``first``; else of the past."""
        if self.before is None:
            return None
        for earlier in reversed(before):
            if self.before[earlier] == NOT_SOLVED:
                continue
            known = found.get(earlier)
            if known is None:
                return self.solution(earlier, columns, earlier - first)
            if isinstance(known, Solution) and np.isfinite(known.minimum.cost):
                return known
        return past.last()

    def _standing(self, which: range, columns: Columns) -> Mask:
        """Solves (K,) of which is known at once that no closed form leads to a better minimum.

        The iterations and evaluations that showed it are added to theirs.
        """
        if self.equations.linear or self.settings.robust is not None:
            return np.ones(len(which), dtype=bool)
        challenged = columns.solved & columns.challenged
        asked = np.flatnonzero(challenged)
        challenged[asked] = ~self._without_form(which.start + asked, columns.expected[asked])
        asked = np.flatnonzero(challenged)
        if len(asked) <= FEW_CHALLENGED or self.stack.errors is not None:
            return ~challenged
        form = None if partly_foreknown(self.equations) else self.form()
        if form is not None:
            challenged[asked] = self._beaten(form, which.start, asked, columns)
        return ~challenged

    def _beaten(self, form: Formed, first: int, asked: Indices, columns: Columns) -> Mask:
        """Which of the solves ``asked`` in a block, whose first is number ``first``, a closed form beats: by what it
        leads to, or where nothing here says that, by its promise.
        """
        layout, free = self.equations.layout, self.equations.free
        numbers, cost, ends = first + asked, columns.cost[asked], columns.points[asked]
        points, least = form.best(numbers)
        most = np.where(columns.expected[asked] | self.problem.estimates_noise, np.inf, 0.0)
        rounding = roundings(columns.scale[asked], ends, layout.number[free], cost)
        away = np.full(len(asked), np.nan)
        if not layout.curved:
            steps = steps_between(layout, free, ends, points)
            away = np.square(np.linalg.solve(columns.root[asked], steps[:, :, None])).sum(axis=(1, 2))
        found: Mask = FOLLOWED(cost, least, away, most, rounding)
        solver = solver_of(self.stack, self.settings) if found.any() else None
        if solver is not None:
            others = solver(numbers[found], points[found])
            lower = TAKEN_OVER(cost[found], others.cost, rounding[found])
            vain = asked[found][~lower]
            columns.iterations[vain] += others.iterations[~lower]
            columns.evaluations[vain] += others.evaluations[~lower]
            found[found] = lower
        return found

    def _without_form(self, numbers: Indices, expected: Mask) -> Mask:
        """Which of some solves, ``expected`` or not, are of a kind for which no closed form is made, as `challenge` has
        it: where a fit is worse than stated noise lets expect, what was learnt is not relied on.
        """
        kinds, of = np.unique(self.stack.rows[:, numbers], axis=1, return_inverse=True)
        names = tuple(entry.unknown.name for entry in self.equations.layout.entries)
        known = np.array([(names, tuple(kind)) in self.cache.without_closed_form for kind in kinds.T.tolist()], bool)
        return np.asarray(known[of] & (expected | self.problem.estimates_noise))

    def _maker(self, apart: Apart, last: Callable[[int], Solution | None]) -> Callable[[int, Columns, int], Solution]:
        """What makes a solution of columns; what agrees in consensus, and several noises, are found again.

        From where they were found: ``last`` is the solution of the window before, in which they may begin.
        """
        if self.settings.robust is None and not estimated_on_the_way(self.problem):
            return self.solution

        def again(number: int, columns: Columns, place: int) -> Solution:
            del columns, place
            found = apart(self.sets.selection(number), last(number))
            if not isinstance(found, Solution):
                message = f"solve {number} was solved, and now is not"
                raise TypeError(message)
            return found

        return again

    def _rows(self, which: range) -> Indices:
        """Rows of the tables of each block (K, blocks), used or not; 1 without a table."""
        found = np.ones((len(which), len(self.problem.blocks)), dtype=np.int64)
        for number, block in enumerate(self.problem.blocks):
            if block.table is not None:
                rows = self.stack.arranged.rows(block.table)
                found[:, number] = rows if isinstance(rows, int) else rows[which.start : which.stop]
        return found

    def _stands(self, number: int, columns: Columns, place: int) -> bool:
        """Whether no closed form leads to a better minimum; what that took is added to the iterations."""
        if bool(self._without_form(np.array([number]), columns.expected[place : place + 1])[0]):
            return True
        equations, _ = assemble(self.problem, self.kernels, self.sets.selection(number).tables, {}, self.cache)
        found = Found(
            minimum=minimum_at(equations, columns, place),
            alternatives=(),
            tally=None,
            origin=GIVEN if self.before is None else LAST_WINDOW,
            iterations=int(columns.iterations[place]),
            evaluations=int(columns.evaluations[place]),
        )
        answered = Challenge(equations, self.settings, self.problem, self.cache).answered(found)
        columns.iterations[place], columns.evaluations[place] = answered.iterations, answered.evaluations
        return answered.minimum is found.minimum

    def solution(self, number: int, columns: Columns, place: int) -> Solution:
        """All that is to be said of a solve that was solved, from the ``place`` of its end in the columns."""
        selection = self.sets.selection(number)
        tables = selection.tables
        equations, binder = assemble(self.problem, self.kernels, tables, {}, self.cache)
        minimum = minimum_at(equations, columns, place)
        noise: dict[int, Noise] = {
            i: common_factor(minimum.cost, int(columns.dof[place]), rounding_at(equations, minimum))
            for i, block in enumerate(self.problem.blocks)
            if block.unknown_factor
        }
        reached = Reached(
            minimum=minimum,
            noise=noise,
            factors=None,
            equations=equations,
            others=(),
            iterations=minimum.iterations,
            evaluations=minimum.evaluations,
        )
        run = Run(
            problem=self.problem,
            kernels=self.kernels,
            tables=tables,
            key=selection.key,
            settings=self.settings,
            equations=equations,
            binder=binder,
        )
        seconds = float(columns.seconds[place])
        return answered(
            run,
            Prepared(equations=equations, starts=()),
            reached,
            tally=None,
            origin=GIVEN,
            seconds=lambda: seconds,
        )


def _corrections(stack: Stack, which: range, columns: Columns) -> tuple[Corrections, ...]:
    """The corrections of measured values in some solves, of those that are clean."""
    if stack.errors is None:
        return ()
    from mbm.estimation.batches.corrected import corrections

    return corrections(stack, which, columns.points, columns.clean)


def _alike(found: Solution | Failure | Skipped, point: Floats) -> bool:
    """Whether a window ended at a point (N,), as far as what it hands on matters."""
    if not isinstance(found, Solution):
        return isinstance(found, Skipped)
    there = found.minimum.point
    size = np.maximum(np.abs(there), np.abs(point))
    return bool((np.abs(there - point) <= SAME_ENDS * (size + SAME_ENDS * size.max(initial=0.0))).all())


def _behind(before: Indices, number: int) -> int:
    """The window that begins where window ``number`` ends; -1 if none does."""
    found = np.flatnonzero(before[number + 1 :] == number)
    return number + 1 + int(found[0]) if len(found) else -1


def minimum_at(equations: Assembled, columns: Columns, place: int) -> Minimum:
    """The end of one solve."""
    point = columns.points[place]
    residuals, jacobian = equations.linearised(point)
    found = Minimum(
        point=point,
        residuals=residuals,
        jacobian=jacobian,
        cost=float(columns.least[place]),
        reason=REASONS[columns.reason[place]],
        iterations=int(columns.iterations[place]),
        evaluations=int(columns.evaluations[place]),
        at_bound=np.zeros(equations.dimension, dtype=np.int8),
    )
    if columns.limits is None:
        return found
    # Loaded by problems with constraints only, so that the others start at once.
    from mbm.estimation.minimise.constrained.linearise import constraint_state, linearise

    multipliers = columns.limits.multipliers[place, : len(equations.equality)]
    state = constraint_state(equations.equality, linearise(equations, point), multipliers)
    return replace(found, constraints=state)
