"""Many points → the minima that they lead to, each as a basin, counted, and told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Minimum
from mbm.estimation.minimise.minimise import minima, minimise
from mbm.estimation.minimise.native.starts import StartEnds
from mbm.estimation.search.agreement import Agreement
from mbm.estimation.search.basins import Basin, ends_apart, merged, ways_down, without_twins
from mbm.estimation.search.descent import descent
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.problem.types import Problem

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
        found = merged(self._equations, [b for b in basins if np.isfinite(b.minimum.cost)])
        if not self._comparable:
            return found
        if self.batchable and self._settings.starts is not None:
            left = [self._below(b) for b in found]
            if any(b is not a for a, b in zip(found, left, strict=True)):
                found = merged(self._equations, left)
        return found if len(found) < 2 else without_twins(self._equations, found, self._agree)

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
