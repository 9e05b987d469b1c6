"""Where noise is unknown: fit, noise and limits of the units that agree, together (`mbm.solution.robust.joint`)."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.decisions import ARRIVED, JOINT_STEPS, STATED
from mbm.target.solver.consensus_description import Bench, Fit
from mbm.target.solver.consensus_laws import untruncated
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_refine import measure, weighted_step
from mbm.target.solver.consensus_rows import linearised, moved, spread_weights
from mbm.target.solver.description import Problem
from mbm.target.words import ConstantReals, Integer, Real


def group_noise(group: Integer, freedom_each: Real, squares: ConstantReals, bench: Bench) -> None:
    """Noise and limits of one group of unknown noise, from its inliers and the variances that are there.

    ``freedom_each`` is the redundancy of one residual: unknowns are shared out by the number of residuals.
    """
    units = bench.units
    count = 0
    wide = 0
    summed = 0.0
    least = 1e-300
    for u in range(units.count):
        if units.group[u] == group and units.inside[u] == 1:
            count += units.components[u]
            summed += squares[u]
            least = max(least, units.rounding[u])
            if bench.rules.thresholded == 0 and squares[u] > units.limits[u]:
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


def noise_and_limits(system: Problem, squares: ConstantReals, bench: Bench) -> None:
    """Noise (U,), as stated or that of the inliers, and limits (U,) at squared norms (U,); the inliers stay.

    Where the limits of the robust scale leave out units that are inside, three deviations of their noise are the limit.
    """
    n = system.n
    units = bench.units
    variances_at(units, n, bench.rules.groups, squares, bench.sorted, bench.fresh)
    total = 0
    for u in range(units.count):
        units.noise[u] = bench.fresh[u] if units.group[u] != STATED else units.variances[u]
        units.limits[u] = units.cuts[u] * units.noise[u]
        if units.inside[u] == 1:
            total += units.components[u]
    freedom_each = 1.0 - float(n) / float(total) if total > 0 else 0.0
    for group in range(bench.rules.groups):
        group_noise(group, freedom_each, squares, bench)
    for u in range(units.count):
        if units.inside[u] == 1:
            units.limits[u] = max(units.limits[u], squares[u])


def promised(count: Integer, rest: Real, fit: Fit, system: Problem, bench: Bench) -> Real:
    """What a step from a fit promises, with weights by the noise of the inliers there; infinite: no value."""
    units = bench.units
    noise_and_limits(system, fit.squares, bench)
    total = rest
    for u in range(units.count):
        units.weights[u] = 0.0
        if units.inside[u] == 1:
            units.weights[u] = 1.0 / units.noise[u]
            total += fit.squares[u]
    if not isfinite(total):
        return inf
    spread_weights(units, count, bench.by_row)
    return weighted_step(system, count, 0.0, fit.chunk, bench)


def fitted_jointly(system: Problem, bench: Bench) -> None:
    """The fit to the inliers: Gauss-Newton steps as long as they promise less and less."""
    count = linearised(system, bench.rows, bench.here.point, bench.here.chunk)
    rest = measure(system, count, bench.here, bench)
    promise = promised(count, rest, bench.here, system, bench)
    for _ in range(JOINT_STEPS):
        if not (promise > ARRIVED and isfinite(promise)):
            break
        here = bench.here
        there = bench.there
        moved(system, bench.rows.constants, here.point, bench.step, there.point)
        linearised(system, bench.rows, there.point, there.chunk)
        rest_there = measure(system, count, there, bench)
        further = promised(count, rest_there, there, system, bench)
        if not further < promise:
            break
        promise = further
        bench.here = there
        bench.there = here
    noise_and_limits(system, bench.here.squares, bench)


def joined(system: Problem, bench: Bench) -> None:
    """The joint solution near the fit, with the units that come in by it.

    Three standard deviations of the inliers take units back where the robust scale came out low, unless limits are
    stated. The variances hold for stated noise; inliers, limits and noise are answered.
    """
    units = bench.units
    more = 1
    while more == 1:
        more = 0
        fitted_jointly(system, bench)
        for u in range(units.count):
            wider = units.limits[u]
            if bench.rules.thresholded == 0 and units.group[u] != STATED:
                wider = max(wider, units.reaches[u] * units.noise[u])
            if units.inside[u] == 0 and bench.here.squares[u] <= wider:
                units.inside[u] = 1
                more = 1
