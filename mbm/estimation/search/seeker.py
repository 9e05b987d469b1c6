"""Many points → the minima that they lead to, each as a basin, counted, and told apart. Points go down to
moderate accuracy first.

Where the structure of the equations allows, part by part first: the unknowns that some equations determine by
themselves, then those that the next equations determine given them. A part that its equations determine exactly has
solutions with residuals of zero; a start that ends elsewhere tries again with the values that other starts had.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.excerpt import excerpt
from mbm.equations.types import Floats, Indices, Minimum
from mbm.estimation.minimise.minimise import minima, minimise
from mbm.estimation.minimise.native.minimum import StartEnds, ends_of_starts, joined
from mbm.estimation.search.basins import COMPARED, Basin, ends_apart, merged, ways_down, without_twins
from mbm.estimation.search.dissection import MAXIMUM_ROWS, Dissection, Mention, Part, dissected
from mbm.estimation.search.starting import Beginning
from mbm.estimation.search.twins import Agreement, unwound
from mbm.estimation.search.valleys import Walks
from mbm.estimation.settings import Settings
from mbm.problem.types import BlockRole, Problem
from mbm.values import dataclass

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
    settings: Settings

    def ends(self, starts: Floats) -> StartEnds:
        """Where the starts (T, N) lead to, never worse than a start; only the first of them where it is stopped."""
        parts: list[StartEnds] = []
        for first in range(0, len(starts), TOGETHER):
            if parts and self.settings.stopped():
                break
            parts.append(self._ends(starts[first : first + TOGETHER]))
        return joined(parts)

    def _ends(self, starts: Floats) -> StartEnds:
        begun = _begun(starts)
        if self.order is not None:
            found = self._by_parts(begun, self.order)
            before, after = (np.square(self.equations.residuals_at(p)).sum(axis=1) for p in (starts, found.points))
            better = (after <= before)[:, None] | ~np.isfinite(before)[:, None]
            begun = replace(found, points=np.where(better, found.points, starts))
        return self._minimised(begun, self.equations.free, None, ITERATIONS)

    def _by_parts(self, reached: StartEnds, order: Dissection) -> StartEnds:
        starts = reached.points
        for part in order.trunk:
            reached = self._solved(reached, (part,), PART_ITERATIONS)
        if len(order.trunk) > 1:
            reached = self._solved(reached, order.trunk, ITERATIONS)
        for branch in order.branches:
            reached = self._branch(reached, starts, branch)
        return reached

    def _branch(self, reached: StartEnds, starts: Floats, branch: tuple[Part, ...]) -> StartEnds:
        """The points with the unknowns of a branch solved for, from their own values or those of other starts."""
        found = self._branch_solved(reached, branch)
        enough = ZERO * sum(len(part.equations) for part in branch)
        lost = np.flatnonzero(~(found.cost <= enough))
        tries = min(TRIES, len(starts) - 1)
        if not lost.size or not tries or self.settings.stopped():
            return found
        places = self._numbers([column for part in branch for column in part.columns])
        others = (lost[:, None] + 1 + np.arange(tries) * max(1, len(starts) // (tries + 1))) % len(starts)
        again = np.repeat(reached.points[lost], tries, axis=0)
        again[:, places] = starts[others.ravel()][:, places]
        second = self._branch_solved(_begun(again), branch)
        costs = np.where(np.isfinite(second.cost), second.cost, np.inf).reshape(len(lost), tries)
        zero = costs <= enough
        chosen = np.where(zero.any(axis=1), zero.argmax(axis=1), costs.argmin(axis=1))
        line = np.arange(len(lost))
        better = costs[line, chosen] < np.where(np.isfinite(found.cost[lost]), found.cost[lost], np.inf)
        points, iterations, evaluations = found.points.copy(), found.iterations.copy(), found.evaluations.copy()
        points[lost[better]] = second.points.reshape(len(lost), tries, -1)[line, chosen][better]
        iterations[lost] += second.iterations.reshape(len(lost), tries).sum(axis=1)
        evaluations[lost] += second.evaluations.reshape(len(lost), tries).sum(axis=1)
        return replace(found, points=points, iterations=iterations, evaluations=evaluations)

    def _branch_solved(self, reached: StartEnds, branch: tuple[Part, ...]) -> StartEnds:
        for part in branch:
            reached = self._solved(reached, (part,), PART_ITERATIONS)
        return self._solved(reached, branch, PART_ITERATIONS) if len(branch) > 1 else reached

    def _solved(self, reached: StartEnds, parts: tuple[Part, ...], iterations: int) -> StartEnds:
        columns = self.equations.free[sorted(c for part in parts for c in part.columns)]
        units = self.units[sorted(i for part in parts for i in part.equations)]
        return self._minimised(reached, columns, units, iterations)

    def _minimised(self, reached: StartEnds, columns: Indices, units: Indices | None, iterations: int) -> StartEnds:
        """The minima of some units over some coordinates, with the work so far."""
        part = excerpt(self.equations, columns, np.unique(self.equations.units) if units is None else units)
        found = ends_of_starts(part, reached.points, iterations, self.settings)
        return replace(
            found,
            iterations=reached.iterations + found.iterations,
            evaluations=reached.evaluations + found.evaluations,
        )

    def _numbers(self, columns: list[int]) -> Indices:
        """The places of the numbers that the columns (positions in ``free``) hold; rotations only if they hold all."""
        layout = self.equations.layout
        mine = np.zeros(len(layout.number), dtype=bool)
        mine[self.equations.free[columns]] = True
        plain = layout.number[mine]
        turned = [c.numbers[mine[c.coordinates].all(axis=1)].ravel() for c in layout.curved]
        return np.concatenate([plain[plain >= 0], *turned])


def descent(equations: Assembled, problem: Problem, settings: Settings) -> Descent:
    """The descent for these equations; ``settings`` may stop it early, with the points reached so far."""
    if equations.count > MAXIMUM_ROWS:
        return Descent(equations=equations, order=None, units=np.empty(0, dtype=np.int64), settings=settings)
    units, mentions = _mentions(equations, problem)
    order = dissected(mentions, equations.dimension)
    return Descent(equations=equations, order=order, units=units, settings=settings)


def _begun(points: Floats) -> StartEnds:
    """Trials of which nothing is known yet."""
    none = np.zeros(len(points), dtype=np.int64)
    unknown = np.full(len(points), np.inf)
    return StartEnds(points=points, cost=unknown, settled=none > 0, iterations=none, evaluations=none)


def _mentions(equations: Assembled, problem: Problem) -> tuple[Indices, list[Mention]]:
    """The units in use, and which of the free coordinates each of them mentions."""
    place = equations.columns
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


ALONE = 3
"""Up to so many starts each is minimised by itself: a batch pays only for many."""

POLISHED = 200
"""Distinct ends of a batch that are minimised to the last digits, the lowest first."""

LARGE, WIDE = 4_000_000, 200
"""Numbers in the Jacobian, and unknowns, above which the starts are minimised one after the other.

A batch solves the normal equations of all unknowns, which for many of them takes longer than what it saves.
"""


class Seeker:
    """Minimises from many points and counts the work."""

    def __init__(self, equations: Assembled, settings: Settings, problem: Problem, agree: Agreement) -> None:
        self._equations = equations
        self._settings = settings
        self._problem = problem
        self._agree = agree
        self._walks = Walks(equations, settings.stopped)
        self.tried = 0
        self.iterations = 0
        self.evaluations = 0
        small = equations.count * equations.dimension <= LARGE and equations.dimension <= WIDE
        moving = settings.iterative
        # Errors in measured columns leave the residuals comparable at the measured values, though not their descent.
        self._comparable = (
            small and not equations.constraints and moving and min(equations.count, equations.dimension) > 0
        )
        self.batchable = self._comparable and not any(block.errors for block in problem.blocks)

    def basins(self, starts: Sequence[Beginning]) -> tuple[Basin, ...]:
        """The minima that the starts lead to, which differ, the best one first; none where no cost is finite."""
        if len(starts) <= ALONE or not self.batchable:
            return self.distinct(self.one_by_one(starts))
        return self.distinct(self.together(np.array([start.point for start in starts])))

    def polished(self, point: Floats) -> Minimum:
        """The minimum that a point leads to."""
        return self._take(minimise(self._equations, point, self._settings, self._problem.span))

    def _take(self, found: Minimum) -> Minimum:
        self.iterations += found.iterations
        self.evaluations += found.evaluations
        return found

    def one_by_one(self, starts: Sequence[Beginning]) -> list[Basin]:
        """A basin for each start."""
        found: list[Basin] = []
        for number, start in enumerate(starts):
            if found and self._settings.stopped():
                break
            found.append(Basin(minimum=self.polished(start.point), starts=np.array([number])))
            self.tried += 1
        return found

    def together(self, points: Floats) -> list[Basin]:
        """A basin for each distinct end of a batch."""
        ends = descent(self._equations, self._problem, self._settings).ends(points)
        self._count(ends)
        begun = ends.evaluations > 0
        self.tried += int(begun.sum())
        apart = list(islice(ends_apart(self._equations, ends), POLISHED))
        if not apart:
            return []
        found: list[Basin] = []
        distinct = np.array([point for point, _ in apart])
        for minimum, (_, numbers) in zip(
            minima(self._equations, distinct, self._settings, self._problem.span), apart, strict=False
        ):
            self._take(minimum)
            own = numbers[begun[numbers]]
            if not own.size:  # none of them began before the batch was stopped: one does now
                own = numbers[:1]
                self.tried += 1
            found.append(Basin(minimum=minimum, starts=own))
            if self._settings.stopped():
                break
        return found

    def distinct(self, basins: Sequence[Basin]) -> tuple[Basin, ...]:
        """The minima that differ; where several starts were asked for, saddles are left downhill."""
        found = merged(self._walks, [b for b in basins if np.isfinite(b.minimum.cost)])
        if not self._comparable:
            return found
        if self.batchable and self._settings.starts is not None:
            left = [self._below(b) for b in found]
            if any(b is not a for a, b in zip(found, left, strict=True)):
                found = merged(self._walks, left)
        wound = tuple(self._unwound(b) for b in found[:COMPARED])
        if any(b is not a for a, b in zip(found, wound, strict=False)):
            found = merged(self._walks, (*wound, *found[COMPARED:]))
        return found if len(found) < 2 else without_twins(self._equations, found, self._agree)

    def _unwound(self, basin: Basin) -> Basin:
        """The basin with plain numbers that turn as angles do within a turn of their starts."""
        point = unwound(self._equations, basin.minimum, self._agree)
        return basin if point is basin.minimum.point else replace(basin, minimum=replace(basin.minimum, point=point))

    def _below(self, basin: Basin) -> Basin:
        """The basin itself, or where it leads if it is a saddle."""
        if not basin.minimum.reason.converged or self._settings.stopped():
            return basin
        sides = ways_down(self._equations, basin.minimum)
        lower = [self.polished(point) for point in sides]
        best = min(lower, key=lambda m: m.cost if np.isfinite(m.cost) else np.inf, default=None)
        if best is None or not best.cost < basin.minimum.cost:
            return basin
        return replace(basin, minimum=best)

    def _count(self, ends: StartEnds) -> None:
        self.iterations += int(ends.iterations.sum())
        self.evaluations += int(ends.evaluations.sum())
