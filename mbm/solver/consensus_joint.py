"""Where noise is unknown: fit, noise and limits of the units that agree, solved for together.

The noise of a group is ``SSE/((n − p) κ)`` of its inliers, κ depends on their limits, limits on the noise, and weights
in the fit on the noise again. Given which units are inside, all that is a function of the point, so that steps end at
rounding: the answer depends on the units that agree, and not on the way to them.
"""

from __future__ import annotations

from math import inf, isfinite

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.consensus_order import variances_at
from mbm.solver.consensus_records import ConsensusWork, Fit
from mbm.solver.consensus_refine import measure, weighted_step
from mbm.solver.consensus_rows import linearised, moved, spread_weights
from mbm.solver.consensus_truncation import untruncated
from mbm.solver.decisions import ARRIVED, JOINT_STEPS, STATED
from mbm.solver.description import Problem


def group_noise(group: Integer, freedom_each: Real, squares: ConstantReals, work: ConsensusWork) -> None:
    """Noise and limits of one group of unknown noise, from its inliers and the variances that are there.

    ``freedom_each`` is the redundancy of one residual: unknowns are shared out by the number of residuals.
    """
    units = work.units
    count = 0
    wide = 0
    summed = 0.0
    least = 1e-300
    for u in range(units.count):
        if units.group[u] == group and units.inlier[u] == 1:
            count += units.components[u]
            summed += squares[u]
            least = max(least, units.rounding[u])
            if work.rules.thresholded == 0 and squares[u] > units.limits[u]:
                wide = 1
    freedom = float(count) * freedom_each
    if freedom > 0.0:
        found = untruncated(units, group, wide, max(summed / freedom, least))
        for u in range(units.count):
            if units.group[u] == group:
                units.noise[u] = found
    if wide == 1:
        for u in range(units.count):
            if units.group[u] == group:
                units.limits[u] = max(units.limits[u], units.reaches[u] * units.noise[u])


def noise_and_limits(problem: Problem, squares: ConstantReals, work: ConsensusWork) -> None:
    """Noise (U,), as stated or that of the inliers, and limits (U,) at squared norms (U,); the inliers stay.

    Where the limits of the robust scale leave out units that are inside, three deviations of their noise are the limit.
    """
    n = problem.n
    units = work.units
    variances_at(units, n, work.rules.groups, squares, work.sorted, work.fresh)
    total = 0
    for u in range(units.count):
        units.noise[u] = work.fresh[u] if units.group[u] != STATED else units.variances[u]
        units.limits[u] = units.cuts[u] * units.noise[u]
        if units.inlier[u] == 1:
            total += units.components[u]
    freedom_each = 1.0 - float(n) / float(total) if total > 0 else 0.0
    for group in range(work.rules.groups):
        group_noise(group, freedom_each, squares, work)
    for u in range(units.count):
        if units.inlier[u] == 1:
            units.limits[u] = max(units.limits[u], squares[u])


def promised(count: Integer, rest: Real, fit: Fit, problem: Problem, work: ConsensusWork) -> Real:
    """What a step from a fit promises, with weights by the noise of the inliers there; infinite: no value."""
    units = work.units
    noise_and_limits(problem, fit.squares, work)
    total = rest
    for u in range(units.count):
        units.weights[u] = 0.0
        if units.inlier[u] == 1:
            units.weights[u] = 1.0 / units.noise[u]
            total += fit.squares[u]
    if not isfinite(total):
        return inf
    spread_weights(units, count, work.by_row)
    return weighted_step(problem, count, 0.0, fit.chunk, work)


def fitted_jointly(problem: Problem, work: ConsensusWork) -> None:
    """The fit to the inliers: Gauss-Newton steps as long as they promise less and less."""
    count = linearised(problem, work.rows, work.here.point, work.here.chunk)
    rest = measure(problem, count, work.here, work)
    promise = promised(count, rest, work.here, problem, work)
    for _ in range(JOINT_STEPS):
        if not (promise > ARRIVED and isfinite(promise)):
            break
        here = work.here
        there = work.there
        moved(problem, work.rows.constants, here.point, work.step, there.point)
        linearised(problem, work.rows, there.point, there.chunk)
        rest_there = measure(problem, count, there, work)
        further = promised(count, rest_there, there, problem, work)
        if not further < promise:
            break
        promise = further
        work.here = there
        work.there = here
    noise_and_limits(problem, work.here.squares, work)


def joined(problem: Problem, work: ConsensusWork) -> None:
    """The joint solution near the fit, with the units that come in by it.

    Three standard deviations of the inliers take units back where the robust scale came out low, unless limits are
    stated. The variances hold for stated noise; inliers, limits and noise are answered.
    """
    units = work.units
    more = 1
    while more == 1:
        more = 0
        fitted_jointly(problem, work)
        for u in range(units.count):
            wider = units.limits[u]
            if work.rules.thresholded == 0 and units.group[u] != STATED:
                wider = max(wider, units.reaches[u] * units.noise[u])
            if units.inlier[u] == 0 and work.here.squares[u] <= wider:
                units.inlier[u] = 1
                more = 1
