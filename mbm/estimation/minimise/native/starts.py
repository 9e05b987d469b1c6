"""Many starts of one system of equations: where they lead to, to moderate accuracy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.native.system import system_of
from mbm.estimation.settings import Settings
from mbm.solver import description as of
from mbm.solver.decisions import MEMORY
from mbm.values import dataclass

SETTLED = 1e-6
"""Relative offset at which a descent ends: what is left is far below what tells two ends apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StartEnds:
    """Where T starts lead to: ``points`` (T, N), ``cost`` (T,) = Σ r², inf where a start has no finite value.

    ``settled`` (T,): a minimum, to the accuracy that was asked for; the others ran out of ``iterations`` (T,) or of
    finite points. ``evaluations`` (T,) of the equations were made on the way.
    """

    points: Floats
    cost: Floats
    settled: Mask
    iterations: Indices
    evaluations: Indices


def joined(parts: Sequence[StartEnds]) -> StartEnds:
    """Starts one after the other; at least one part."""
    return StartEnds(
        points=np.concatenate([p.points for p in parts]),
        cost=np.concatenate([p.cost for p in parts]),
        settled=np.concatenate([p.settled for p in parts]),
        iterations=np.concatenate([p.iterations for p in parts]),
        evaluations=np.concatenate([p.evaluations for p in parts]),
    )


def ends_of_starts(part: Assembled, starts: Floats, iterations: int, settings: Settings) -> StartEnds:
    """Where the starts (T, N) lead to in so many iterations, without regard to constraints.

    ``settings`` give the threads, on whose number the ends do not depend, and stop them where they are. Those that were
    not begun by then have the cost of their starts, as far as one batch of residuals goes, the others inf.
    """
    way, workers = Settings(max_iterations=iterations, tolerance=SETTLED), settings.threads(len(starts))
    system = system_of(part, way, strict=False)
    if system is None:
        # Loaded by such equations only. Python evaluates them, one point after the other.
        from mbm.estimation.minimise.native.function import system_of_function

        system, workers = system_of_function(part, way), 1
    ends = system.solve(starts, workers=workers, stopped=settings.stopped)
    reasons, points, cost = ends.states[:, of.REASON], ends.numbers, ends.results[:, of.COST]
    idle = np.flatnonzero(ends.states[:, of.EVALUATIONS] == 0)
    if idle.size:
        points[idle], cost[idle] = starts[idle], np.inf
        known = idle[: max(1, MEMORY // max(1, part.count * part.dimension))]
        with np.errstate(all="ignore"):
            cost[known] = np.square(part.residuals_at(starts[known])).sum(axis=1)
    finite = np.isfinite(cost) & (reasons != of.NOT_FINITE_AT_START)
    return StartEnds(
        points=points,
        cost=np.where(finite, cost, np.inf),
        settled=finite & (reasons >= of.SMALL_OFFSET) & (reasons <= of.ONE_STEP),
        iterations=ends.states[:, of.STEPS],
        evaluations=ends.states[:, of.EVALUATIONS],
    )
