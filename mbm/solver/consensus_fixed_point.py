"""From the best candidate to the fixed point of fit, noise and inliers; whether another candidate is as good.

Where noise is unknown: fit, noise and limits of the units that agree, solved for together.

The noise of a group is ``SSE/(r κ)`` of its inliers; r is how much of them shows in residuals (Förstner 1979), κ
depends on their limits, limits on the noise, and weights in the fit, and by them r, on the noise again. Given which
units are inside, all that is a function of the point, so that steps end at rounding: the answer depends on the
units that agree, and not on the way to them.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.chi_square import consistency, mark_inliers, untruncated
from mbm.solver.consensus_constraints import moved
from mbm.solver.consensus_records import ConsensusWork, Fit
from mbm.solver.consensus_refine import TRUNCATED, measure, refined, weighted_step
from mbm.solver.consensus_scores import robust_variance, variances_at
from mbm.solver.consensus_units import linearised, spread_weights
from mbm.solver.decisions import (
    APART,
    ARRIVED,
    AS_GOOD,
    CONTRADICTED,
    JOINT_STEPS,
    REFINING_STEPS,
    SETTLING_ROUNDS,
    STATED,
    STILL,
)
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied, dot, solve_lower
from mbm.solver.noise_factors import LEAST_REDUNDANCY, NOISE_ROUNDS, SETTLED_FACTORS


def contradicted(work: ConsensusWork) -> Integer:
    """Whether the inliers with stated noise scatter by more than that."""
    units = work.units
    total = 0
    expected = 0.0
    summed = 0.0
    last_cut = -1.0
    last_size = 0
    left = 1.0
    for u in range(units.count):
        if units.inlier[u] == 1 and units.group[u] == STATED:
            if units.cuts[u] != last_cut or units.components[u] != last_size:
                last_cut = units.cuts[u]
                last_size = units.components[u]
                left = consistency(last_cut, last_size)
            total += units.components[u]
            expected += float(units.components[u]) * left
            summed += work.here.squares[u]
    freedom = float(total - work.left)
    if not freedom > 0.0:
        return 0
    excess = summed / freedom * float(total) / expected - 1.0
    return excess > CONTRADICTED * sqrt(2.0 / freedom)


def renew_variances(work: ConsensusWork) -> None:
    """The noise at the present squares: of unknown groups, and of stated ones that the data contradict."""
    units = work.units
    squares = work.here.squares
    variances_at(units, work.spent, work.rules.groups, squares, work.sorted, work.fresh)
    wide = -1.0
    if contradicted(work) == 1:
        wide = max(robust_variance(units, work.spent, squares, STATED, work.sorted), 1.0)
    for u in range(units.count):
        if units.group[u] != STATED:
            units.variances[u] = work.fresh[u]
        elif wide > 0.0:
            units.variances[u] = wide


def set_limits(work: ConsensusWork) -> None:
    """Limits (U,) from cuts and variances."""
    units = work.units
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * units.variances[u]


def at_fixed_point(problem: Problem, work: ConsensusWork) -> None:
    """The point where fit, scale and inliers agree with one another, from the variances in the work."""
    units = work.units
    for u in range(units.count):
        units.inlier[u] = -1
    for _ in range(SETTLING_ROUNDS):
        set_limits(work)
        refined(TRUNCATED, REFINING_STEPS, STILL, 0, problem, work)
        if mark_inliers(units.count, work.here.squares, units.limits, units.inlier) == 1:
            break
        renew_variances(work)
    set_limits(work)


def finished(problem: Problem, work: ConsensusWork) -> Integer:
    """The fixed point reached from where the fit is, and the variances in the work; how many units are inside.

    Limits and inliers hold at it; `noise` is the variance of the noise.
    """
    units = work.units
    at_fixed_point(problem, work)
    mark_inliers(units.count, work.here.squares, units.limits, units.inlier)
    copied(units.count, units.variances, units.noise)
    if work.rules.groups > 0:
        joined(problem, work)
    count = 0
    for u in range(units.count):
        count += units.inlier[u]
    return count


def rival(best: Integer, last: Integer, work: ConsensusWork) -> Integer:
    """Whether another of the first ``last`` candidates is as good, at a place that contradicts the best one's inliers.

    Inliers are judged by the cuts and variances in the work.
    """
    units = work.units
    own = work.candidate_squares[best * units.count :]
    lowest = work.objectives[best]
    here = 0.0
    for u in range(units.count):
        if own[u] <= units.cuts[u] * units.variances[u]:
            here += own[u] / units.variances[u]
    for k in range(last):
        if work.objectives[k] < lowest + AS_GOOD:
            theirs = work.candidate_squares[k * units.count :]
            there = 0.0
            for u in range(units.count):
                if own[u] <= units.cuts[u] * units.variances[u]:
                    there += min(theirs[u] / units.variances[u], 1e6)
            if there > here + APART:
                return 1
    return 0


def group_noise(group: Integer, squares: ConstantReals, work: ConsensusWork) -> None:
    """Noise and limits of one group of unknown noise, from its inliers and the variances that are there."""
    units = work.units
    freedom = 0.0
    wide = 0
    summed = 0.0
    least = 1e-300
    for u in range(units.count):
        if units.group[u] == group and units.inlier[u] == 1:
            freedom += units.redundancy[u]
            summed += squares[u]
            least = max(least, units.rounding[u])
            if work.rules.thresholded == 0 and squares[u] > units.limits[u]:
                wide = 1
    if freedom > LEAST_REDUNDANCY:
        found = untruncated(units, group, wide, max(summed / freedom, least))
        for u in range(units.count):
            if units.group[u] == group:
                units.noise[u] = found
    if wide == 1:
        for u in range(units.count):
            if units.group[u] == group:
                units.limits[u] = max(units.limits[u], units.reaches[u] * units.noise[u])


def noise_and_limits(squares: ConstantReals, work: ConsensusWork) -> None:
    """Noise (U,), as stated or that of the inliers, and limits (U,) at squared norms (U,); the inliers stay.

    Where the limits of the robust scale leave out units that are inside, three deviations of their noise are the limit.
    """
    units = work.units
    variances_at(units, work.spent, work.rules.groups, squares, work.sorted, work.fresh)
    for u in range(units.count):
        units.noise[u] = work.fresh[u] if units.group[u] != STATED else units.variances[u]
        units.limits[u] = units.cuts[u] * units.noise[u]
    for group in range(work.rules.groups):
        group_noise(group, squares, work)
    for u in range(units.count):
        if units.inlier[u] == 1:
            units.limits[u] = max(units.limits[u], squares[u])


def share_unknowns(work: ConsensusWork) -> None:
    """The redundancy of the inliers as if all of them told the unknowns alike."""
    units = work.units
    total = 0
    for u in range(units.count):
        if units.inlier[u] == 1:
            total += units.components[u]
    each = 1.0 - float(work.left) / float(total) if total > 0 else 0.0
    for u in range(units.count):
        units.redundancy[u] = float(units.components[u]) * each


def tell_redundancy(problem: Problem, chunk: ConstantReals, work: ConsensusWork) -> Real:
    """The redundancy of the inliers by the factor that `weighted_step` left; by how much that changes it at most."""
    n = problem.n
    units = work.units
    row = work.gradient
    change = 0.0
    for u in range(units.count):
        if units.inlier[u] == 1:
            left = float(units.components[u])
            for i in range(units.components[u]):
                for j in range(n):
                    row[j] = chunk[j * problem.chunk + units.place[u] + i * LANES] / work.scale[j]
                solve_lower(n, work.normal, row)
                left -= units.weights[u] * dot(n, row, row)
            left = max(left, 0.0)
            change = max(change, fabs(left - units.redundancy[u]))
            units.redundancy[u] = left
    return change


def promised(count: Integer, rest: Real, fit: Fit, problem: Problem, work: ConsensusWork) -> Real:
    """What a step from a fit promises, with weights by the noise of the inliers there; infinite: no value.

    Where rows have several noises, redundancy and noise are found by rounds.
    """
    units = work.units
    total = rest
    for u in range(units.count):
        if units.inlier[u] == 1:
            total += fit.squares[u]
    if not isfinite(total):
        return inf
    promise = 0.0
    change = inf
    for _ in range(NOISE_ROUNDS):
        noise_and_limits(fit.squares, work)
        for u in range(units.count):
            units.weights[u] = 1.0 / units.noise[u] if units.inlier[u] == 1 else 0.0
        spread_weights(units, count, work.by_row)
        promise = weighted_step(problem, count, 0.0, fit.chunk, work)
        if work.alike == 1 or change <= SETTLED_FACTORS:
            break
        change = tell_redundancy(problem, fit.chunk, work)
    return promise


def fitted_jointly(problem: Problem, work: ConsensusWork) -> None:
    """The fit to the inliers: Gauss-Newton steps as long as they promise less and less."""
    count = linearised(problem, work.rows, work.here.point, work, work.here.chunk)
    rest = measure(problem, count, work.here, work)
    share_unknowns(work)
    promise = promised(count, rest, work.here, problem, work)
    for _ in range(JOINT_STEPS):
        if not (promise > ARRIVED and isfinite(promise)):
            break
        here = work.here
        there = work.there
        moved(problem, here.point, work.step, work, there.point)
        linearised(problem, work.rows, there.point, work, there.chunk)
        rest_there = measure(problem, count, there, work)
        further = promised(count, rest_there, there, problem, work)
        if not further < promise:
            break
        promise = further
        work.here = there
        work.there = here
    if work.alike == 0:
        promised(count, rest, work.here, problem, work)
    noise_and_limits(work.here.squares, work)


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
