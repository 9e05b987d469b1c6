"""How well trials explain the units: least median, number of outliers, truncated squares; none is scored in vain."""

from __future__ import annotations

from math import exp, inf, isfinite, log

from mbm.target.solver.consensus_order import STATED, selected
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals

LMEDS = 0
RANSAC = 1
MSAC = 2
GNC = 3
"""Kinds of scores, as in `mbm.solution.robust.estimators`."""


def rank_of_half(count: Integer, size: Integer) -> Integer:
    """``⌊n/2⌋ + ⌊(k + 1)/2⌋``, at most n: the units of the better half with subsets of ``size`` k."""
    found = count // 2 + (size + 1) // 2
    if found > count:
        return count
    return found


def least_median(
    units: Integer,
    groups_count: Integer,
    size: Integer,
    squares: ConstantReals,
    medians: ConstantReals,
    groups: ConstantIntegers,
    bound: Real,
    scratch: Reals,
) -> Real:
    """``Σ n log q`` over the noise groups, q the order statistic of the squared norms that breaks down last.

    Infinite where that exceeds ``bound`` for sure: with one group it is enough to count the norms below it.
    """
    total = 0.0
    for group in range(STATED, groups_count):
        count = 0
        for u in range(units):
            if groups[u] == group:
                scratch[count] = squares[u] / medians[u]
                count += 1
        if count > 0:
            place = rank_of_half(count, size)
            if count == units:
                reach = exp(bound / float(count)) * (1.0 + 1e-9)
                below = 0
                for i in range(count):
                    if scratch[i] <= reach:
                        below += 1
                if below < place:
                    return inf
            total += float(count) * log(max(selected(count, place - 1, scratch), 1e-30))
    if not isfinite(total):
        return inf
    return total


def truncated(units: Integer, squares: ConstantReals, limits: ConstantReals, bound: Real) -> Real:
    """The sum of the squared norms over their ``limits`` (U,), none counting more than 1; infinite above ``bound``."""
    total = 0.0
    for u in range(units):
        total += min(squares[u] / limits[u], 1.0)
        if total > bound:
            return inf
    return total


def outlier_count(units: Integer, squares: ConstantReals, limits: ConstantReals, bound: Real) -> Real:
    """The number of outliers, and a share below 1 for how far the others are off; infinite above ``bound``."""
    total = 0.0
    share = 1.0 / (float(units) + 1.0)
    for u in range(units):
        if squares[u] > limits[u]:
            total += 1.0
        total += share * min(squares[u] / limits[u], 1.0)
        if total > bound:
            return inf
    return total


ROUTINES = (
    rank_of_half,
    least_median,
    truncated,
    outlier_count,
)
