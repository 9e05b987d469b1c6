"""From the best candidate to the fixed point of fit, noise and inliers; whether another candidate is as good."""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import Integer
from mbm.solver.chi_square import consistency
from mbm.solver.consensus_joint import joined
from mbm.solver.consensus_order import robust_variance, variances_at
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.consensus_refine import refined
from mbm.solver.consensus_truncation import mark_inliers
from mbm.solver.consensus_weights import TRUNCATED
from mbm.solver.decisions import APART, AS_GOOD, CONTRADICTED, REFINING_STEPS, SETTLING_ROUNDS, STATED, STILL
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied


def contradicted(problem: Problem, work: ConsensusWork) -> Integer:
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
    freedom = float(total - problem.n)
    if not freedom > 0.0:
        return 0
    excess = summed / freedom * float(total) / expected - 1.0
    return excess > CONTRADICTED * sqrt(2.0 / freedom)


def renew_variances(problem: Problem, work: ConsensusWork) -> None:
    """The noise at the present squares: of unknown groups, and of stated ones that the data contradict."""
    units = work.units
    squares = work.here.squares
    variances_at(units, problem.n, work.rules.groups, squares, work.sorted, work.fresh)
    wide = -1.0
    if contradicted(problem, work) == 1:
        wide = max(robust_variance(units, problem.n, squares, STATED, work.sorted), 1.0)
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
        renew_variances(problem, work)
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
