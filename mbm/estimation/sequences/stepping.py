"""A walk whose steps come one by one: rows of a step in, the estimate of a step out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats, Mask
from mbm.estimation.sequences.room import GroupRows, room
from mbm.estimation.sequences.run import COARSE, Begun
from mbm.estimation.sequences.step_rows import ALWAYS, BEGINNING, FIRST, ONCE, StepRows, first_row
from mbm.estimation.sequences.walk import Memory
from mbm.files.memory import check_memory
from mbm.kernels.types import KernelSet
from mbm.problem.tables import Table
from mbm.solver.filter_records import Chain
from mbm.values import dataclass

ROOM = 8
"""Rows of a group that there is room for at first; where a step has more, room is made for twice as many as it has."""

FIRST_STEPS = 64
"""Steps that a smoother of all of them has room for at first; then for twice as many as there are."""

CLOSE = 1e-3
"""Standard deviations to which each of its steps is solved when it comes: the next one goes on from there."""

REALS = 80
"""Bytes for each number of the covariance of a step, and of its rows: policies, factors, and what they are made of."""

Cells = Mapping[str, Mapping[str, Floats]]
"""Columns of numbers in SI, by table."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepEstimate:
    """The estimate of a step: ``numbers`` (N,) in SI, and a factor U (n, n) of the covariance ``UᵀU``.

    ``touched`` (n,) marks coordinates that the rows so far do not determine. Σ vᵀS⁻¹v of the step is ``cost`` (of a
    smoother 0), and so many hypotheses are ``followed`` after it.
    """

    numbers: Floats
    factor: Floats
    touched: Mask
    cost: float
    followed: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arrived:
    """A step that comes in. ``tables`` makes all tables of the problem with the rows of this step alone.

    ``cells`` are the columns that it was given, None where they are to be read as the data of the problem are, and
    ``transition`` the numbers that the transition to it takes, by column (None: some are to be read, or there is none).
    """

    cells: Cells | None
    tables: Callable[[], Mapping[str, Table]]
    transition: Mapping[str, float] | None


class Stepper:
    """A filter or smoother that takes steps as they come. Not to be shared between threads.

    ``begun`` is the problem with the data that it was compiled with, of which no row is used but those of no step.

    Raises:
        MbmError: too much memory.

    """

    def __init__(self, begun: Begun, kernels: KernelSet, cache: EvaluationCache) -> None:
        self.rows = StepRows(begun, kernels, cache)
        self.steps = 0
        self.failed = False
        self._begun, self._cache = begun, cache
        self.lag = (begun.rules.lag or 0) if begun.rules.smooth else 0
        """Steps after which a step is reported."""
        self.growing = begun.rules.smooth and begun.rules.lag is None
        """Whether all steps stay, and each is given all rows."""
        self._rules = replace(begun.rules, endless=True, tolerance=CLOSE if self.growing else begun.rules.tolerance)
        held = FIRST_STEPS if self.growing else self.lag + 2 if begun.rules.smooth else 1
        chained, blocks = begun.chained, begun.problem.blocks
        self._check_memory(held)
        most = np.maximum(2 * chained.seen.counts.max(axis=1, initial=0), ROOM)
        self._seen = room(chained.seen, held, most, cache, blocks)
        self._moving = room(chained.moving, held, np.ones(len(chained.moving.counts), dtype=np.int64), cache, blocks)
        size = len(begun.places.free) - begun.places.still
        self._spreads = np.zeros((held, size, size))
        self._filled = [False] * len(self._seen.parts)
        self._always = [(j, table) for j, table in enumerate(self.rows.tables) if self.rows.when[j] == ALWAYS]
        self._once = {j: table for j, table in enumerate(self.rows.tables) if self.rows.when[j] == ONCE}
        """What holds from the first row of a table on, until this is there."""
        self._placed: list[object] = [None] * held
        self._observed = False
        self._last: tuple[Mapping[str, float], tuple[Mapping[int, GroupRows], Floats]] | None = None
        self._memory = self._made()

    def take(self, arrived: Arrived) -> StepEstimate | None:
        """The estimate of the step, or of the one a lag before it; None where it has none, as where ``failed`` says so.

        Raises:
            MbmError: the rows do not go with the problem; then the step was not taken.

        """
        k = self.steps
        if self.growing and k == self._seen.held:
            self._grow(2 * k)
        moved = self._transition(arrived) if k else None
        counts = self._put(arrived, k)
        if moved is not None:
            self._put_transition(k - 1, *moved)
        if not self._observed:
            self._begin(k, counts)
        self._seen.count(k, counts)
        routine = "growing_steps" if self.growing else "lag_steps" if self._rules.smooth else "filter_steps"
        self.failed = not self._memory.routine(routine, k, k + 1)
        self._memory.raise_failure()
        if self.failed:
            return None
        self.steps += 1
        return self._at(k - self.lag) if k >= self.lag else None

    def given_all(self, last: int) -> list[StepEstimate]:
        """The estimates of so many last steps, given all rows so far, by a smoother of all steps."""
        first = max(self.steps - last, 0)
        if first < self.steps:
            self._memory.end_at(COARSE)
            self.failed = not self._memory.routine("growing_answers", first, self.steps - 1)
            self._memory.raise_failure()
            self._memory.end_at(CLOSE)
        return [] if self.failed else [self._at(k) for k in range(first, self.steps)]

    def finish(self) -> list[StepEstimate]:
        """The estimates of the steps that came in and have none yet, or of all by a smoother of all; no more can come
        then.
        """
        if self.growing:
            return self.given_all(self.steps)
        left = range(max(self.steps - self.lag, 0), self.steps) if self._rules.smooth else range(0)
        if left:
            self._memory.routine("lag_end", self.steps - 1)
        return [] if self.failed else [self._at(k) for k in left]

    def _made(self) -> Memory:
        chained = replace(
            self._begun.chained, seen=self._seen.local, moving=self._moving.local, spreads=self._spreads, begin=-1
        )
        return Memory(chained, self._begun.prior, self._rules)

    def _at(self, k: int) -> StepEstimate:
        memory, place = self._memory, k % self._seen.held
        return StepEstimate(
            numbers=memory.points[place].copy(),
            factor=memory.factors[place].copy(),
            touched=memory.touched[place] != 0,
            cost=float(memory.costs[place]) if not self._rules.smooth else 0.0,
            followed=int(memory.followed[place]),
        )

    def _begin(self, k: int, counts: list[int]) -> None:
        """Let what holds at the first step with rows hold at this one, if it is it."""
        self._observed = any(c and o for c, o in zip(counts, self.rows.observed, strict=True))
        if not self._observed:
            return
        self._memory.chain[Chain.begin] = k
        for number, when in enumerate(self.rows.when):
            if when == BEGINNING:
                counts[number] = self._put_rows(k, number, self.rows.fixed(number))

    def _put(self, arrived: Arrived, k: int) -> list[int]:
        """Put the rows of a step; how many each group has."""
        counts = [0] * len(self._seen.parts)
        if arrived.cells is None or not self._put_plainly(arrived.cells, k, counts):
            for number, rows in self.rows.bound(arrived.tables()).items():
                if self.rows.when[number] == ALWAYS:
                    counts[number] = self._put_rows(k, number, rows)
                elif number in self._once and len(rows):
                    counts[number] = self._put_rows(k, number, first_row(rows))
                    del self._once[number]
        if k == 0:
            for number, when in enumerate(self.rows.when):
                if when == FIRST:
                    counts[number] = self._put_rows(k, number, self.rows.fixed(number))
        return counts

    def _put_plainly(self, cells: Cells, k: int, counts: list[int]) -> bool:
        """Put the parameters of rows that differ by columns of numbers alone; False where some are to be bound."""
        if any(len(cells[table][self._begun.sequence.column]) for table in self._once.values() if table in cells):
            return False
        for number, table in self._always:
            own = cells.get(table)
            if own is None:
                continue
            count = len(own[self._begun.sequence.column])
            if not count:
                continue
            plain = self.rows.plain(number)
            if plain is None:
                return False
            self._reserve(number, count)
            if not self._filled[number]:
                self._seen.fill(number, plain.row, [column for column, _ in plain.columns])
                self._filled[number] = True
            for column, name in plain.columns:
                self._seen.put_parameters(k, number, count, column, own[name])
            counts[number] = count
        return True

    def _put_rows(self, k: int, number: int, rows: GroupRows) -> int:
        self._reserve(number, len(rows))
        self._seen.put(k, number, rows)
        return len(rows)

    def _reserve(self, number: int, count: int) -> None:
        """Make room for so many rows of a group."""
        capacity = self._seen.capacity
        if count <= capacity[number]:
            return
        wanted = capacity.copy()
        wanted[number] = 2 * count
        self._seen = self._seen.larger(self._seen.held, wanted, self._cache, self._begun.problem.blocks)
        self._filled = [False] * len(self._filled)
        self._renew()

    def _grow(self, held: int) -> None:
        """Make room for so many steps.

        Raises:
            MbmError: too much memory.

        """
        self._check_memory(held)
        blocks = self._begun.problem.blocks
        self._seen = self._seen.larger(held, self._seen.capacity, self._cache, blocks)
        self._moving = self._moving.larger(held, self._moving.capacity, self._cache, blocks)
        more = held - len(self._spreads)
        self._spreads = np.concatenate([self._spreads, np.zeros((more, *self._spreads.shape[1:]))])
        self._placed += [None] * more
        self._filled = [False] * len(self._filled)
        self._renew()

    def _renew(self) -> None:
        before, self._memory = self._memory, self._made()
        self._memory.go_on_from(before)

    def _check_memory(self, held: int) -> None:
        n = len(self._begun.places.free)
        what = f"a stream that holds {held:,} steps of {n} coordinates"
        check_memory(REALS * held * (n + ROOM) ** 2, what, self._begun.sequence.estimator.span)

    def _transition(self, arrived: Arrived) -> tuple[Mapping[int, GroupRows], Floats]:
        """The rows of the transition to a step, and their noise; those of the one before with its numbers, where that
        is all that changes.
        """
        known = arrived.transition
        if known is not None and self._last is not None:
            before, (rows, spread) = self._last
            changed = {name for name, number in known.items() if number != before[name]}
            if not changed:
                return rows, spread
            if changed <= self.rows.numbers_of_transitions:
                self._last = (known, (self.rows.renumbered(rows, known), spread))
                return self._last[1]
        moved = self.rows.moved(arrived.tables())
        self._last = None if known is None else (known, moved)
        return moved

    def _put_transition(self, k: int, rows: Mapping[int, GroupRows], spread: Floats) -> None:
        place = k % self._moving.held
        if self._placed[place] is rows:
            return
        self._placed[place] = rows
        for number, each in rows.items():
            self._moving.put(k, number, each)
        self._moving.count(k, [len(rows[number]) for number in range(len(rows))])
        self._spreads[place] = spread
