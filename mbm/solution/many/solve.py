"""The solves of ``for-each`` in slices: each slice one native batch and one look at its answers, by several threads.

Which solves a slice holds does not depend on the number of threads, nor do the answers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solution.assembly import Assembled
from mbm.solution.binding import EvaluationCache
from mbm.solution.challenge import challenged
from mbm.solution.estimate import Run, answered, assemble
from mbm.solution.many.answers import answers
from mbm.solution.many.consensus import consensus_descent
from mbm.solution.many.descent import descent_of
from mbm.solution.many.stack import Stack, stack
from mbm.solution.many.suits import asks_for_one_search, suits
from mbm.solution.many.types import REASONS, Begun, Block, Columns, Descent
from mbm.solution.robust.types import Prepared
from mbm.solution.search import Found
from mbm.solution.selected import SelectedTables
from mbm.solution.selection import Divided, Selection, divided
from mbm.solution.settings import Settings
from mbm.solution.solution import Failure, Skipped, Solution
from mbm.solution.starting import GIVEN
from mbm.solution.types import Floats, Indices, Minimum, Noise
from mbm.solution.variance import common_factor
from mbm.solution.weighing import Reached
from mbm.text.types import MbmError
from mbm.values import dataclass

FEW = 8
"""Solves up to which binding them together does not pay."""

ROWS_AT_ONCE = 30_000
"""Rows of a slice: what is worked on stays in the processor's cache, and there are enough slices for all threads."""

Apart = Callable[[Selection], Solution | Failure | Skipped]
"""Solves one data set by itself, from the beginning."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Together:
    """Many solves of one problem whose equations are bound together."""

    problem: Problem
    kernels: KernelSet
    tables: Mapping[str, Table]
    divided: Divided
    stack: Stack
    starts: Floats
    settings: Settings
    cache: EvaluationCache
    descent: Descent

    @property
    def equations(self) -> Assembled:
        """The equations of all solves."""
        return self.stack.equations

    @property
    def count(self) -> int:
        """T."""
        return self.stack.solves

    def blocks(self, workers: int | None, apart: Apart) -> Iterator[Block]:
        """All solves, slice by slice; ``apart`` solves those that are left to the general path.

        ``workers`` threads (None: one for each processor) are at work while a block is looked at.
        """
        slices = self._slices()

        def work(which: range) -> Columns:
            return answers(self.problem, self.stack, which, self.descent)

        threads = min(workers or os.cpu_count() or 1, len(slices))
        if threads == 1:
            for which in slices:
                if self.settings.stopped():
                    return
                yield self._block(which, work(which), apart)
            return
        with ThreadPoolExecutor(max_workers=threads) as pool:
            ahead = iter([(which, pool.submit(work, which)) for which in slices])
            try:
                for which, answer in ahead:
                    if self.settings.stopped():
                        answer.cancel()
                        return
                    yield self._block(which, answer.result(), apart)
            finally:
                for _, answer in islice(ahead, None):
                    answer.cancel()

    def _slices(self) -> list[range]:
        """Consecutive solves with about as many rows each."""
        rows = np.cumsum(self.stack.rows.sum(axis=0)) // ROWS_AT_ONCE
        ends = [*(np.flatnonzero(np.diff(rows)) + 1).tolist(), self.stack.solves]
        return [range(begin, end) for begin, end in zip([0, *ends[:-1]], ends, strict=True)]

    def _block(self, which: range, columns: Columns, apart: Apart) -> Block:
        """The block with those solved apart that need it: from their ends where these are good, else from the start."""
        found: dict[int, Solution | Failure | Skipped] = {}
        clean = columns.clean.copy()
        for place in np.flatnonzero(~(columns.clean & columns.expected)).tolist():
            number = which.start + place
            if self.settings.stopped():
                which, columns, clean = range(which.start, number), columns.first(place), clean[:place]
                break
            if columns.solved[place] and self.settings.robust is None and self._stands(number, columns, place):
                if not columns.clean[place]:
                    found[number] = self.solution(number, columns, place)
            else:
                found[number] = apart(self.selection(number))
                clean[place] = False
        return Block(
            which=which,
            rows=self._rows(which),
            names=self.problem.request.for_each,
            keys=self.divided.combinations,
            columns=replace(columns, clean=clean),
            apart=found,
            make=self._maker(apart),
            layout=self.equations.layout,
            free=self.equations.free,
        )

    def _maker(self, apart: Apart) -> Callable[[int, Columns, int], Solution]:
        """What makes a solution of columns; with consensus, which rows agree is found again."""
        if self.settings.robust is None:
            return self.solution

        def again(number: int, columns: Columns, place: int) -> Solution:
            del columns, place
            found = apart(self.selection(number))
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
                found[:, number] = self.divided.parts[block.table].sizes[which.start : which.stop]
        return found

    def _stands(self, number: int, columns: Columns, place: int) -> bool:
        """Whether a fit is as good as expected, or no closed form is made that might lead to a better one."""
        if columns.expected[place] or self.equations.linear:
            return True
        names = tuple(entry.unknown.name for entry in self.equations.layout.entries)
        known = (names, tuple(self.stack.rows[:, number].tolist())) in self.cache.without_closed_form
        if known and any(block.unknown_factor for block in self.problem.blocks):
            return True  # where noise is stated the fit is worse than that, and what was learnt is not relied on
        equations, _ = assemble(self.problem, self.kernels, self.selection(number).tables, {}, self.cache)
        found = Found(
            minimum=_minimum(equations, columns, place),
            alternatives=(),
            tally=None,
            origin=GIVEN,
            iterations=int(columns.iterations[place]),
            evaluations=int(columns.evaluations[place]),
        )
        return challenged(equations, self.settings, found, self.problem, self.cache, many=True) is found

    def selection(self, number: int) -> Selection:
        """The key and the tables of one solve."""
        return _selection(self.problem, self.tables, self.divided, number)

    def solution(self, number: int, columns: Columns, place: int) -> Solution:
        """All that is to be said of a solve that was solved, from the ``place`` of its end in the columns."""
        selection = self.selection(number)
        tables = selection.tables
        equations, binder = assemble(self.problem, self.kernels, tables, {}, self.cache)
        minimum = _minimum(equations, columns, place)
        noise: dict[int, Noise] = {
            i: common_factor(minimum.cost, int(columns.dof[place]))
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


def _minimum(equations: Assembled, columns: Columns, place: int) -> Minimum:
    """The end of one solve."""
    point = columns.points[place]
    return Minimum(
        point=point,
        residuals=equations.residuals(point),
        jacobian=equations.jacobian(point),
        cost=float(columns.robust_cost[place]),
        reason=REASONS[columns.reason[place]],
        iterations=int(columns.iterations[place]),
        evaluations=int(columns.evaluations[place]),
        offset=float(columns.offset[place]),
        at_bound=np.zeros(equations.dimension, dtype=np.int8),
    )


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
        MbmError: more solves than can be meant.

    """
    columns = problem.request.for_each
    if not columns or problem.request.window is not None or not asks_for_one_search(settings):
        return None
    split = frozenset(name for name, table in tables.items() if any(c in table.columns for c in columns))
    if not suits(problem, kernels, split):
        return None
    found = divided(columns, tables)
    if len(found.combinations) <= FEW:
        return None
    try:
        layout = cache.layouts.of(problem, tables, {})
        points = _starts(problem, tables, cache, found, starts)
        if settings.robust is None and (bool(layout.guessed.any()) or not bool(np.isfinite(points).all())):
            return None
        bound = stack(problem, kernels, tables, found, layout, cache)
    except MbmError:
        return None  # which solve is at fault, the general path says
    if any(len(groups) != 1 for groups in bound.derived) or not _losses_suit(bound.equations, settings):
        return None
    if settings.robust is None:
        descent = descent_of(bound, points, settings)
    else:
        one = _selection(problem, tables, found, 0)
        first, _ = assemble(problem, kernels, one.tables, {}, cache)
        descent = consensus_descent(problem, bound, first, points, settings)
    if descent is None:
        return None
    return Together(
        problem=problem,
        kernels=kernels,
        tables=tables,
        divided=found,
        stack=bound,
        starts=points,
        settings=settings,
        cache=cache,
        descent=descent,
    )


def _losses_suit(equations: Assembled, settings: Settings) -> bool:
    """Whether losses, if there are any, need no consensus to start from, and are those of one group."""
    losses = [loss for group in equations.groups for loss in group.losses]
    if not losses:
        return True
    return settings.robust is None and len(equations.groups) == 1 and all(loss.convex for loss in losses)


def _selection(problem: Problem, tables: Mapping[str, Table], found: Divided, number: int) -> Selection:
    """The key and the tables of one solve."""
    positions = {name: part.positions(number) for name, part in found.parts.items()}
    key = dict(zip(problem.request.for_each, found.combinations[number], strict=True))
    return Selection(key=key, tables=SelectedTables(tables, positions, {}))


def _starts(
    problem: Problem,
    tables: Mapping[str, Table],
    cache: EvaluationCache,
    found: Divided,
    starts: Begun,
) -> Floats:
    """The point (T, N) where each solve starts; NaN where a number has none."""
    if not callable(starts):
        return np.tile(cache.layouts.of(problem, tables, starts).start, (len(found.combinations), 1))
    columns = problem.request.for_each
    each = (starts(dict(zip(columns, cells, strict=True))) for cells in found.combinations)
    return np.stack([cache.layouts.of(problem, tables, given).start for given in each])
