"""Many starts, all of them down to the minima they lead to, to moderate accuracy.

Where the structure of the equations allows, part by part first: the unknowns that some equations determine by
themselves, then those that the next equations determine given them. A part that its equations determine exactly has
solutions with residuals of zero; a start that ends elsewhere tries again with the values that other starts had.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mbm.problem.types import BlockRole, Problem
from mbm.solution.assembly import Assembled
from mbm.solution.batch import batch
from mbm.solution.dissection import MAXIMUM_ROWS, Dissection, Mention, Part, dissected
from mbm.solution.solvers.batched import Batched, joined, minimise_all
from mbm.solution.types import Floats, Indices

ITERATIONS = 60
PART_ITERATIONS = 30
"""Steps of Marquardt's method for the whole problem and for a part of it; what needs more is left to the next stage."""

TOGETHER = 500
"""Starts that go through all stages together, and lend values to one another."""

TRIES = 6
"""Values of other starts that a part tries where its own lead nowhere."""

ZERO = 1e-9
"""A cost for each residual that is zero, in squared standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Descent:
    """The equations with the order in which to solve them (None: all together)."""

    equations: Assembled
    order: Dissection | None
    units: Indices
    stopped: Callable[[], bool]

    def ends(self, starts: Floats) -> Batched:
        """Where the starts (T, N) lead to, never worse than a start; only the first of them where it is stopped."""
        parts: list[Batched] = []
        for first in range(0, len(starts), TOGETHER):
            if parts and self.stopped():
                break
            parts.append(self._ends(starts[first : first + TOGETHER]))
        return joined(parts)

    def _ends(self, starts: Floats) -> Batched:
        points = starts
        if self.order is not None:
            points = self._by_parts(starts, self.order)
            whole = batch(self.equations)
            before, after = (np.square(whole.residuals(p)).sum(axis=1) for p in (starts, points))
            points = np.where((after <= before)[:, None] | ~np.isfinite(before)[:, None], points, starts)
        return self._minimised(points, self.equations.free, None, ITERATIONS)

    def _by_parts(self, starts: Floats, order: Dissection) -> Floats:
        points = starts
        for part in order.trunk:
            points = self._solved(points, (part,), PART_ITERATIONS).points
        if len(order.trunk) > 1:
            points = self._solved(points, order.trunk, ITERATIONS).points
        for branch in order.branches:
            points = self._branch(points, starts, branch)
        return points

    def _branch(self, points: Floats, starts: Floats, branch: tuple[Part, ...]) -> Floats:
        """The points with the unknowns of a branch solved for, from their own values or those of other starts."""
        found = self._branch_solved(points, branch)
        enough = ZERO * sum(len(part.equations) for part in branch)
        lost = np.flatnonzero(~(found.cost <= enough))
        tries = min(TRIES, len(starts) - 1)
        if not lost.size or not tries or self.stopped():
            return found.points
        places = self._numbers([column for part in branch for column in part.columns])
        others = (lost[:, None] + 1 + np.arange(tries) * max(1, len(starts) // (tries + 1))) % len(starts)
        again = np.repeat(points[lost], tries, axis=0)
        again[:, places] = starts[others.ravel()][:, places]
        second = self._branch_solved(again, branch)
        costs = np.where(np.isfinite(second.cost), second.cost, np.inf).reshape(len(lost), tries)
        zero = costs <= enough
        chosen = np.where(zero.any(axis=1), zero.argmax(axis=1), costs.argmin(axis=1))
        line = np.arange(len(lost))
        better = costs[line, chosen] < np.where(np.isfinite(found.cost[lost]), found.cost[lost], np.inf)
        result = found.points.copy()
        result[lost[better]] = second.points.reshape(len(lost), tries, -1)[line, chosen][better]
        return result

    def _branch_solved(self, points: Floats, branch: tuple[Part, ...]) -> Batched:
        for part in branch[:-1]:
            points = self._solved(points, (part,), PART_ITERATIONS).points
        last = self._solved(points, branch[-1:], PART_ITERATIONS)
        return self._solved(last.points, branch, PART_ITERATIONS) if len(branch) > 1 else last

    def _solved(self, points: Floats, parts: tuple[Part, ...], iterations: int) -> Batched:
        columns = self.equations.free[sorted(c for part in parts for c in part.columns)]
        units = self.units[sorted(i for part in parts for i in part.equations)]
        return self._minimised(points, columns, units, iterations)

    def _minimised(self, points: Floats, columns: Indices, units: Indices | None, iterations: int) -> Batched:
        stack = batch(self.equations, columns=columns, units=units)
        return minimise_all(stack, points, iterations=iterations, stopped=self.stopped)

    def _numbers(self, columns: list[int]) -> Indices:
        """The places of the numbers that the columns (positions in ``free``) hold; rotations only if they hold all."""
        layout = self.equations.layout
        mine = np.zeros(len(layout.number), dtype=bool)
        mine[self.equations.free[columns]] = True
        plain = layout.number[mine]
        turned = [c.numbers[mine[c.coordinates].all(axis=1)].ravel() for c in layout.curved]
        return np.concatenate([plain[plain >= 0], *turned])


def descent(equations: Assembled, problem: Problem, stopped: Callable[[], bool]) -> Descent:
    """The descent for these equations; ``stopped`` ends it early, with the points reached so far."""
    if equations.count > MAXIMUM_ROWS:
        return Descent(equations=equations, order=None, units=np.empty(0, dtype=np.int64), stopped=stopped)
    units, mentions = _mentions(equations, problem)
    order = dissected(mentions, equations.dimension)
    return Descent(equations=equations, order=order, units=units, stopped=stopped)


def _mentions(equations: Assembled, problem: Problem) -> tuple[Indices, list[Mention]]:
    """The units in use, and which of the free coordinates each of them mentions."""
    place = np.full(len(equations.layout.number), -1, dtype=np.int64)
    place[equations.free] = np.arange(equations.dimension)
    used = np.zeros(int(equations.everything().units.max(initial=-1)) + 1, dtype=bool)
    used[equations.units] = True
    units: list[int] = []
    mentions: list[Mention] = []
    for group in equations.groups:
        decides = problem.blocks[group.kernel.owner].role is not BlockRole.PRIOR
        for number, whitener in enumerate(group.whiteners):
            inside = (group.kernel.jacobian_rows >= whitener.first) & (group.kernel.jacobian_rows < whitener.last)
            tangents = np.unique(group.kernel.jacobian_columns[inside])
            columns = place[group.columns[:, tangents]]
            for row, line in enumerate(columns.tolist()):
                unit = group.first_unit + row * len(group.whiteners) + number
                if used[unit]:
                    units.append(unit)
                    named = frozenset(c for c in line if c >= 0)
                    mentions.append(Mention(columns=named, size=whitener.last - whitener.first, decides=decides))
    return np.array(units, dtype=np.int64), mentions
