"""Order statistics and the robust scale; how well trials explain the units: medians, outliers, truncated squares."""

from __future__ import annotations

from math import exp, inf, isfinite, log

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.consensus_records import Units
from mbm.solver.decisions import STATED
from mbm.solver.linear_algebra import divided


def below_first(first: Integer, last: Integer, pivot: Real, values: Reals) -> Integer:
    """Bring the values from ``first`` to ``last`` that are below the pivot to the front: where these end.

    Nothing branches on the values: no processor would foresee the way.
    """
    end = first
    for i in range(first, last + 1):
        value = values[i]
        values[i] = values[end]
        values[end] = value
        end += value < pivot
    return end


def equal_first(first: Integer, last: Integer, pivot: Real, values: Reals) -> Integer:
    """The same for values that are equal to the pivot."""
    end = first
    for i in range(first, last + 1):
        value = values[i]
        values[i] = values[end]
        values[end] = value
        end += value == pivot
    return end


def selected(count: Integer, place: Integer, values: Reals) -> Real:
    """The value of rank ``place`` (from 0) of so many; ``values`` are put in another order (Hoare 1961)."""
    low = 0
    high = count - 1
    while low < high:
        pivot = values[(low + high) // 2]
        end = below_first(low, high, pivot, values)
        if place < end:
            high = end - 1
        else:
            low = equal_first(end, high, pivot, values)
            if place < low:
                return pivot
    return values[place]


def median(count: Integer, values: Reals) -> Real:
    """The middle value, or the mean of the two in the middle; ``values`` are put in another order."""
    upper = selected(count, count // 2, values)
    if count % 2 == 1:
        return upper
    lower = values[0]
    for i in range(1, count // 2):
        lower = max(values[i], lower)
    return 0.5 * (lower + upper)


def squares_of_group(units: Units, squares: ConstantReals, group: Integer, found: Reals) -> Integer:
    """The squared norms of a group's units, each over the median of its law; how many there are."""
    count = 0
    for u in range(units.count):
        if units.group[u] == group:
            found[count] = squares[u] / units.medians[u]
            count += 1
    return count


def robust_variance(units: Units, dimension: Integer, squares: ConstantReals, group: Integer, scratch: Reals) -> Real:
    """``(1.4826 (1 + 5/(n − p)))² med`` of the squared norms of a group's units, each over the median of its law.

    n counts the residuals of all units, ``dimension`` p the unknowns of the fit; 0 without any unit. Infinite norms are
    allowed, NaN is not.
    """
    count = squares_of_group(units, squares, group, scratch)
    if count == 0:
        return 0.0
    left = units.scalars - dimension
    if left < 1:
        left = 1
    small = 1.0 + 5.0 / float(left)
    return median(count, scratch) * small * small


def variances_at(
    units: Units, dimension: Integer, groups: Integer, squares: ConstantReals, scratch: Reals, variances: Reals
) -> None:
    """The variance (U,) of each unit's noise at a point: 1 where it is stated, else the robust one of its group.

    It is no smaller than what rounding makes of most of them: that of a unit that is grossly wrong says nothing.
    """
    for u in range(units.count):
        variances[u] = 1.0
    for group in range(groups):
        found = robust_variance(units, dimension, squares, group, scratch)
        found = max(found, 1e-300)
        count = 0
        for u in range(units.count):
            if units.group[u] == group:
                scratch[count] = units.rounding[u]
                count += 1
        if count > 0:
            found = max(found, median(count, scratch))
        for u in range(units.count):
            if units.group[u] == group:
                variances[u] = found


LMEDS = 0
RANSAC = 1
MSAC = 2
GNC = 3
"""Kinds of scores; the last one is that of truncated squares, for graduated non-convexity, which takes no subsets.

`LMEDS`: order statistics of the squared norms (Rousseeuw and Leroy 1987), `RANSAC`: units outside their limits
(Fischler and Bolles 1981), `MSAC`: squared norms up to their limits (Torr and Zisserman 2000).
"""


def rank_of_half(count: Integer, size: Integer) -> Integer:
    """``⌊n/2⌋ + ⌊(k + 1)/2⌋``, at most n: the units of the better half with subsets of ``size`` k."""
    found = count // 2 + (size + 1) // 2
    if found > count:
        return count
    return found


@distinct_arrays
def within(count: Integer, reach: Real, values: ConstantReals) -> Integer:
    """How many values are no larger than ``reach``."""
    found = 0
    for i in range(count):
        if values[i] <= reach:
            found += 1
    return found


def least_median(
    units: Integer,
    groups_count: Integer,
    sizes: ConstantIntegers,
    squares: ConstantReals,
    medians: ConstantReals,
    groups: ConstantIntegers,
    bound: Real,
    scratch: Reals,
) -> Real:
    """``Σ n log q`` over the noise groups, q the order statistic of the squared norms that breaks down last.

    ``sizes`` (U,) are those of the subsets of the groups. Beside unknown noise, stated noise is no smaller than stated.
    Infinite where that exceeds ``bound`` for sure: with one group it is enough to count the norms below it.
    """
    total = 0.0
    for group in range(STATED, groups_count):
        count = units
        size = sizes[0]
        least = 1e-30
        if groups_count == 0:
            divided(units, squares, medians, scratch)
        else:
            count = 0
            for u in range(units):
                if groups[u] == group:
                    scratch[count] = squares[u] / medians[u]
                    size = sizes[u]
                    count += 1
            if group == STATED:
                least = 1.0
        if count > 0:
            place = rank_of_half(count, size)
            if count == units:
                reach = exp(bound / float(count)) * (1.0 + 1e-9)
                if within(count, reach, scratch) < place:
                    return inf
            total += float(count) * log(max(selected(count, place - 1, scratch), least))
    if not isfinite(total):
        return inf
    return total


@distinct_arrays
def truncated(units: Integer, width: Real, squares: ConstantReals, limits: ConstantReals) -> Real:
    """The sum of the squared norms over ``width`` times their ``limits`` (U,), none counting more than 1."""
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    for i in range(units // 4):
        s0 += min(squares[4 * i] / (width * limits[4 * i]), 1.0)
        s1 += min(squares[4 * i + 1] / (width * limits[4 * i + 1]), 1.0)
        s2 += min(squares[4 * i + 2] / (width * limits[4 * i + 2]), 1.0)
        s3 += min(squares[4 * i + 3] / (width * limits[4 * i + 3]), 1.0)
    for i in range(4 * (units // 4), units):
        s0 += min(squares[i] / (width * limits[i]), 1.0)
    return (s0 + s1) + (s2 + s3)


@distinct_arrays
def inlier_count(units: Integer, squares: ConstantReals, limits: ConstantReals) -> Integer:
    """The units whose squared norms are within their ``limits`` (U,)."""
    count = 0
    for u in range(units):
        if squares[u] <= limits[u]:
            count += 1
    return count


def outlier_count(units: Integer, squares: ConstantReals, limits: ConstantReals, sum_of_squares: Real) -> Real:
    """The number of outliers, and a share below 1 for how far the others are off: their truncated sum of squares."""
    return float(units - inlier_count(units, squares, limits)) + sum_of_squares / (float(units) + 1.0)
