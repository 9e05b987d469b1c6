"""Many starts of one system of equations, in native code: where they lead to, to moderate accuracy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.solution.assembly import Assembled
from mbm.solution.batch import batch
from mbm.solution.excerpt import excerpt
from mbm.solution.native.system import handled, system_of
from mbm.solution.settings import Settings
from mbm.solution.solvers.batched import Batched
from mbm.solution.types import Floats, Indices
from mbm.target.decisions import MEMORY
from mbm.target.solver import description as of

SETTLED = 1e-6
"""Relative offset at which a descent ends: what is left is far below what tells two ends apart."""


def native_ends(
    equations: Assembled,
    starts: Floats,
    columns: Indices,
    units: Indices | None,
    iterations: int,
    settings: Settings,
) -> Batched | None:
    """Where the starts (T, N) lead to, as `solvers.batched.minimise_all` has it; None: not for the native solver.

    ``columns`` and ``units`` say which coordinates move and which units count, as in `batch`. ``settings`` give the
    threads, on whose number the ends do not depend, and stop them where they are. Those that were not begun by then
    have the cost of their starts, as far as one batch of residuals goes, the others inf.
    """
    if not handled(replace(equations, constraints=())):
        return None
    part = excerpt(equations, columns, np.unique(equations.units) if units is None else units)
    system = system_of(part, Settings(max_iterations=iterations, tolerance=SETTLED), strict=False)
    if system is None:
        return None
    ends = system.solve(starts, workers=settings.threads(len(starts)), stopped=settings.stopped)
    reasons, points, cost = ends.states[:, of.REASON], ends.numbers, ends.results[:, of.COST]
    idle = np.flatnonzero(ends.states[:, of.EVALUATIONS] == 0)
    if idle.size:
        points[idle], cost[idle] = starts[idle], np.inf
        stack = batch(equations, columns=columns, units=units)
        known = idle[: max(1, MEMORY // max(1, stack.count * stack.dimension))]
        with np.errstate(all="ignore"):
            cost[known] = np.square(stack.residuals(starts[known])).sum(axis=1)
    finite = np.isfinite(cost) & (reasons != of.NOT_FINITE_AT_START)
    return Batched(
        points=points,
        cost=np.where(finite, cost, np.inf),
        settled=finite & (reasons >= of.SMALL_OFFSET) & (reasons <= of.ONE_STEP),
        iterations=ends.states[:, of.STEPS],
        evaluations=ends.states[:, of.EVALUATIONS],
    )
