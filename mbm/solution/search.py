"""Starts → the best minimum, the other ones, and how often each was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import islice

import numpy as np

from mbm.problem.types import Method, Problem
from mbm.solution.agreement import Agreement
from mbm.solution.assembly import Assembled
from mbm.solution.basins import Basin, ends_apart, equal_costs, merged, ways_down, without_twins
from mbm.solution.batch import Batch, batch
from mbm.solution.descent import descent
from mbm.solution.minimise import minima, minimise
from mbm.solution.settings import Settings
from mbm.solution.solvers.batched import Batched
from mbm.solution.starting import Beginning
from mbm.solution.twins import Twin
from mbm.solution.types import Floats, Minimum, Reason
from mbm.values import dataclass

FEW = 3
"""Up to so many starts each is minimised by itself: a batch pays only for many."""

ITERATIVE = (Method.AUTO, Method.MARQUARDT, Method.DOGLEG, Method.GAUSS_NEWTON)
"""Methods that a descent of many points at once may stand in for, before they polish its ends."""

POLISHED = 200
"""Distinct ends of a batch that are minimised to the last digits, the lowest first."""

LARGE = 4_000_000
"""Numbers in the Jacobian from which the starts are minimised one after the other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative:
    """Another minimum, how many starts led to it, and whether it is the mirror image of a better one.

    ``cost`` is Σ r² without losses.
    """

    minimum: Minimum
    cost: float
    starts: int
    mirrored: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """How many starts were tried, how many converged, how many led to a minimum of the best cost."""

    tried: int
    converged: int
    best_found: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What a search answers; ``tally`` is None where a single start was given. Work is summed over all starts."""

    minimum: Minimum
    alternatives: tuple[Alternative, ...]
    tally: Tally | None
    origin: str
    iterations: int
    evaluations: int


def search(
    equations: Assembled, starts: Sequence[Beginning], settings: Settings, problem: Problem, agrees: Agreement
) -> Found:
    """The best of the minima that the starts lead to, and the others in the order of their costs.

    A start that leads to a saddle goes on from there. Minima that differ in how they are written only (angles by whole
    turns, Euler angles, unknowns that trade places) count as one if what is derived from them ``agrees``. A search that
    is stopped answers with the best that it has reached, and says that it was interrupted.
    """
    seeker = _Seeker(equations, settings, problem, agrees)
    if len(starts) == 1:
        return _alone(seeker.polished(starts[0].point), starts[0].origin)
    if len(starts) <= FEW or not seeker.batchable:
        ends = seeker.one_by_one(starts)
    else:
        ends = seeker.together(np.array([s.point for s in starts]))
    basins = seeker.distinct(ends)
    if not basins:
        return _alone(seeker.polished(starts[0].point), starts[0].origin)
    best = basins[0]
    converged = [b for b in basins if b.minimum.reason.converged]
    at_best = [b for b in converged if equal_costs(b.minimum.cost, best.minimum.cost)]
    cut_short = settings.stopped()
    return Found(
        minimum=replace(best.minimum, reason=Reason.INTERRUPTED) if cut_short else best.minimum,
        alternatives=tuple(
            Alternative(
                minimum=b.minimum,
                cost=_plain_cost(equations, b.minimum),
                starts=len(b.starts),
                mirrored=b.twin is Twin.MIRRORED,
            )
            for b in converged
            if b is not best
        ),
        tally=Tally(
            tried=seeker.tried,
            converged=sum(len(b.starts) for b in converged),
            best_found=sum(len(b.starts) for b in at_best),
        ),
        origin=starts[int(best.starts[0])].origin,
        iterations=seeker.iterations,
        evaluations=seeker.evaluations,
    )


def reweighted(
    equations: Assembled, alternatives: Sequence[Alternative], settings: Settings, problem: Problem
) -> tuple[Alternative, ...]:
    """The alternatives where the final weights of ``equations`` put them, the lowest cost first."""
    found = []
    for each in alternatives:
        minimum = minimise(equations, each.minimum.point, settings, problem.span)
        found.append(replace(each, minimum=minimum, cost=_plain_cost(equations, minimum)))
    return tuple(sorted(found, key=lambda a: a.minimum.cost))


def _plain_cost(equations: Assembled, minimum: Minimum) -> float:
    return float(np.square(equations.plain_residuals(minimum.point)).sum()) if equations.lossy else minimum.cost


def _alone(minimum: Minimum, origin: str) -> Found:
    return Found(
        minimum=minimum,
        alternatives=(),
        tally=None,
        origin=origin,
        iterations=minimum.iterations,
        evaluations=minimum.evaluations,
    )


class _Seeker:
    """Minimises from many points and counts the work."""

    def __init__(self, equations: Assembled, settings: Settings, problem: Problem, agree: Agreement) -> None:
        self._equations = equations
        self._settings = settings
        self._problem = problem
        self._agree = agree
        self.tried = 0
        self.iterations = 0
        self.evaluations = 0
        small = equations.count * equations.dimension <= LARGE
        moving = settings.method in ITERATIVE
        # Errors in measured columns leave the residuals comparable at the measured values, though not their descent.
        self._comparable = (
            small and not equations.constraints and moving and min(equations.count, equations.dimension) > 0
        )
        self.batchable = self._comparable and not any(block.errors for block in problem.blocks)

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
        self.tried += len(ends.cost)
        apart = list(islice(ends_apart(self._equations, ends), POLISHED))
        if not apart:
            return []
        found: list[Basin] = []
        distinct = np.array([point for point, _ in apart])
        for minimum, (_, numbers) in zip(
            minima(self._equations, distinct, self._settings, self._problem.span), apart, strict=False
        ):
            self._take(minimum)
            found.append(Basin(minimum=minimum, starts=numbers))
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
        return found if len(found) < 2 else without_twins(self._stack, found, self._agree)

    @cached_property
    def _stack(self) -> Batch:
        """The equations at many points."""
        return batch(self._equations)

    def _below(self, basin: Basin) -> Basin:
        """The basin itself, or where it leads if it is a saddle."""
        if not basin.minimum.reason.converged or self._settings.stopped():
            return basin
        sides = ways_down(self._equations, self._stack, basin.minimum)
        lower = [self.polished(point) for point in sides]
        best = min(lower, key=lambda m: m.cost if np.isfinite(m.cost) else np.inf, default=None)
        if best is None or not best.cost < basin.minimum.cost:
            return basin
        return replace(basin, minimum=best)

    def _count(self, ends: Batched) -> None:
        self.iterations += int(ends.iterations.sum())
        self.evaluations += int(ends.evaluations.sum())
