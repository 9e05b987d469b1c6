"""Graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020): from least squares to the truncated loss.

From the least squares and from the least absolute deviations. Deterministic, and without subsets, so for any number of
unknowns; it needs a least squares fit that is not too far off.
"""

from __future__ import annotations

from math import inf, isfinite, sqrt

from mbm.machine.words import Integer, Real
from mbm.solver.consensus_order import median, robust_variance
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.consensus_refine import GIVEN, refined
from mbm.solver.consensus_rows import squares_at
from mbm.solver.decisions import ABSOLUTE_ROUNDS, CONTROL_GROWTH, GRADUATED_FITS, GRADUATED_ROUNDS, STILL
from mbm.solver.description import Problem


def widen_limits(fresh: Integer, work: ConsensusWork) -> None:
    """Limits by the noise at the present squares; smaller ones stay unless ``fresh`` is 1."""
    units = work.units
    for group in range(-1, work.rules.groups):
        variance = 1.0
        if group >= 0:
            variance = robust_variance(units, work.left, work.here.squares, group, work.sorted)
        for u in range(units.count):
            if units.group[u] == group:
                wide = units.cuts[u] * variance
                units.limits[u] = wide if fresh == 1 else min(units.limits[u], wide)


def gnc_weight(square: Real, limit: Real, control: Real) -> Real:
    """The weight of the truncated loss made smooth (eq. 14 of the paper)."""
    if square <= control / (control + 1.0) * limit:
        return 1.0
    if square >= (control + 1.0) / control * limit:
        return 0.0
    between = sqrt(limit * control * (control + 1.0) / max(square, 1e-300)) - control
    return min(max(between, 0.0), 1.0)


def gnc_fit(absolute: Integer, problem: Problem, work: ConsensusWork) -> None:
    """The fit where weights have become 0 or 1, begun at least squares or least absolute deviations.

    Both leave out units without a value at the start; graduation takes those in that have one by then.
    """
    units = work.units
    weights = units.weights
    limits = units.limits
    squares_at(problem, work.here.point, work, work.here.squares)
    for u in range(units.count):
        weights[u] = 1.0 if isfinite(work.here.squares[u]) else 0.0
    refined(GIVEN, GRADUATED_FITS, STILL, 0, problem, work)
    for _ in range(absolute * ABSOLUTE_ROUNDS):
        for u in range(units.count):
            work.sorted[u] = sqrt(work.here.squares[u])
        least = 1e-3 * median(units.count, work.sorted) + 1e-300
        for u in range(units.count):
            weights[u] = 1.0 / max(sqrt(work.here.squares[u]), least)
        refined(GIVEN, 1, STILL, 0, problem, work)
    widen_limits(1, work)
    control = inf
    for u in range(units.count):
        square = work.here.squares[u]
        if isfinite(square):
            control = min(limits[u] / max(2.0 * square - limits[u], 1e-300), control)
    if not (control > 0.0 and isfinite(control)):
        return
    for _ in range(GRADUATED_ROUNDS):
        decided = 1
        for u in range(units.count):
            weights[u] = gnc_weight(work.here.squares[u], limits[u], control)
            if weights[u] >= 1e-6 and weights[u] <= 1.0 - 1e-6:
                decided = 0
        refined(GIVEN, 1, STILL, 0, problem, work)
        widen_limits(0, work)
        if decided == 1:
            break
        control = control * CONTROL_GROWTH
