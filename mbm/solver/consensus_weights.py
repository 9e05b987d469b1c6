"""Rules of the local search behind consensus, at one point.

A rule says which units count at a point, and an objective that a fit to those units lowers: the truncated sum of
squares ``Σ min(s, L)``, or, where the noise is unknown, the trimmed one of concentration steps.
"""

from __future__ import annotations

from math import inf, isfinite, log

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.consensus_order import selected
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.consensus_scores import rank_of_half
from mbm.solver.decisions import STATED

TRUNCATED = 0
"""Units inside their limits count with the inverse of their variances."""

TRIMMED = 1
"""The better half of each group of unknown noise counts, and units of stated noise inside their limits."""

GIVEN = 2
"""Weights as they are."""


def trimmed_mean(group: Integer, squares: ConstantReals, work: ConsensusWork) -> Real:
    """The mean of a group's better half; `threshold` (3,): its largest norm, ties of it that count, its units."""
    units = work.units
    values = work.sorted
    threshold = work.threshold
    count = 0
    for u in range(units.count):
        if units.group[u] == group:
            values[count] = squares[u] / units.medians[u]
            count += 1
    threshold[0] = -1.0
    threshold[1] = 0.0
    threshold[2] = float(count)
    if count == 0:
        return 1.0
    half = rank_of_half(count, work.size)
    middle = selected(count, half - 1, values)
    total = 0.0
    ties = 0.0
    for i in range(half):
        total += values[i]
        if values[i] == middle:
            ties += 1.0
    threshold[0] = middle
    threshold[1] = ties
    return max(total / float(half), 1e-300)


@distinct_arrays
def truncated_weights(
    units: Integer, squares: ConstantReals, limits: ConstantReals, variances: ConstantReals, weights: Reals
) -> Real:
    """``Σ min(s, L)/variance``, and the weights (U,): one over the variance inside the limits (U,), 0 outside."""
    for u in range(units):
        weights[u] = 1.0 / variances[u]
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    for i in range(units // 4):
        s0 += min(squares[4 * i], limits[4 * i]) * weights[4 * i]
        s1 += min(squares[4 * i + 1], limits[4 * i + 1]) * weights[4 * i + 1]
        s2 += min(squares[4 * i + 2], limits[4 * i + 2]) * weights[4 * i + 2]
        s3 += min(squares[4 * i + 3], limits[4 * i + 3]) * weights[4 * i + 3]
    for i in range(4 * (units // 4), units):
        s0 += min(squares[i], limits[i]) * weights[i]
    for u in range(units):
        weights[u] = weights[u] if squares[u] <= limits[u] else 0.0
    return (s0 + s1) + (s2 + s3)


def objective_of(rule: Integer, squares: ConstantReals, rest: Real, work: ConsensusWork) -> Real:
    """The objective at squared norms (U,), with the weights (U,) of the units there put down in the work.

    ``rest`` is the sum of squares that no rule touches.
    """
    units = work.units
    weights = units.weights
    limits = units.limits
    total = rest
    if rule == GIVEN:
        for u in range(units.count):
            if weights[u] > 0.0:
                total += weights[u] * squares[u]
        return total if isfinite(total) else inf
    if rule == TRUNCATED:
        total += truncated_weights(units.count, squares, limits, units.variances, weights)
        return total if isfinite(total) else inf
    for u in range(units.count):
        if units.group[u] == STATED:
            total += min(squares[u], limits[u])
            weights[u] = 1.0 if squares[u] <= limits[u] else 0.0
    threshold = work.threshold
    for group in range(work.rules.groups):
        mean = trimmed_mean(group, squares, work)
        ties = threshold[1]
        for u in range(units.count):
            if units.group[u] == group:
                normed = squares[u] / units.medians[u]
                weights[u] = 0.0
                if normed < threshold[0]:
                    weights[u] = 1.0 / mean
                elif normed == threshold[0] and ties > 0.0:
                    weights[u] = 1.0 / mean
                    ties -= 1.0
        total += threshold[2] * log(mean)
    return total if isfinite(total) else inf
