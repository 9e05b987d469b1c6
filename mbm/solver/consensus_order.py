"""Order statistics, and the robust scale that the median of squared norms gives."""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.consensus_records import Units


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
