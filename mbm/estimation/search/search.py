"""Starts → the best minimum, the other ones, and how often each was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Minimum, Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.search.starting import Beginning
from mbm.estimation.search.twins import Agreement
from mbm.estimation.settings import Settings
from mbm.problem.types import Problem
from mbm.values import dataclass


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
    if len(starts) == 1:
        return alone(minimise(equations, starts[0].point, settings, problem.span), starts[0].origin)
    # Loaded by problems with many starts only, so that the others begin at once.
    from mbm.estimation.search.basins import equal_costs, without_limits
    from mbm.estimation.search.seeker import Seeker
    from mbm.estimation.search.twins import Twin

    seeker = Seeker(equations, settings, problem, agrees)
    basins = seeker.basins(starts)
    if not basins:
        return alone(seeker.polished(starts[0].point), starts[0].origin)
    basins = without_limits(equations, basins, stated=not problem.estimates_noise)
    best = basins[0]
    converged = [b for b in basins if b.minimum.reason.converged]
    at_best = [b for b in converged if equal_costs(b.minimum.cost, best.minimum.cost)]
    cut_short = settings.stopped()
    return Found(
        minimum=replace(best.minimum, reason=Reason.INTERRUPTED) if cut_short else best.minimum,
        alternatives=tuple(
            other_minimum(equations, b.minimum, len(b.starts), mirrored=b.twin is Twin.MIRRORED)
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


def other_minimum(equations: Assembled, minimum: Minimum, starts: int, *, mirrored: bool = False) -> Alternative:
    """A minimum that so many starts have led to, and what it costs."""
    return Alternative(minimum=minimum, cost=_plain_cost(equations, minimum), starts=starts, mirrored=mirrored)


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


def alone(minimum: Minimum, origin: str) -> Found:
    """What the one start that was tried leads to."""
    return Found(
        minimum=minimum,
        alternatives=(),
        tally=None,
        origin=origin,
        iterations=minimum.iterations,
        evaluations=minimum.evaluations,
    )
