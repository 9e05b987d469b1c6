"""Ranges to known stations → the places that they may come from, by all rows at once (Nishida et al., eqs 6-11).

Differences of squared ranges are linear in the place. Where the stations lie in a plane (on a line in two dimensions),
or nearly so, these say little of one direction, and the mean of the squares tells it, with two signs. A common offset
is one more such coordinate, whose square counts negatively: pseudo-ranges, circles and spheres are the same case.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.covariance import singular_values
from mbm.solver.linear_algebra import add_multiple, append_rows, copied, dot, filled
from mbm.solver.minimal_spheres import PARALLEL
from mbm.solver.workspace import MOST_PLACES, Ranges

FLAT = 1e-6
"""Extent of the stations across their plane (or line) beside the extent along it, below which they count as flat."""

NEARLY_FLAT = 0.1
"""The same, below which the coordinate across is also taken from the mean of the squares: differences barely tell."""

LEAST_LENGTH = 1e-3
"""Share of the typical length below which a shorter range weighs no more: its square would seem to have no error."""

AT_A_TIME = 16
"""Rows that are triangularised together."""

CHUNK_AT = 81


def weigh_squares(ranges: Ranges) -> None:
    """Weights of squared ranges: their errors are 2 l times those of the ranges.

    Squares that are measured have lengths of 0, and their own errors.
    """
    wide = ranges.d + 3
    total = 0.0
    count = 0
    for i in range(ranges.rows):
        size = ranges.weights[i]
        for j in range(wide):
            size += fabs(ranges.spheres[i * wide + j])
        if not (ranges.weights[i] > 0.0 and isfinite(size * size)):
            ranges.weights[i] = 0.0
        else:
            total += ranges.spheres[i * wide + ranges.d] * ranges.spheres[i * wide + ranges.d]
            count += 1
    if ranges.offset == 0 and total > 0.0:
        least = LEAST_LENGTH * sqrt(total / float(count))
        for i in range(ranges.rows):
            if ranges.weights[i] > 0.0:
                ranges.weights[i] /= max(fabs(ranges.spheres[i * wide + ranges.d]), least)


def centre_of(ranges: Ranges, centre: Reals) -> Real:
    """The weighted mean of stations and lengths (d + 1,), and the sum of the weights."""
    d = ranges.d
    total = 0.0
    filled(d + 1, 0.0, centre)
    for i in range(ranges.rows):
        if ranges.weights[i] > 0.0:
            weight = ranges.weights[i] * ranges.weights[i]
            for j in range(d + 1):
                centre[j] += weight * ranges.spheres[i * (d + 3) + j]
            total += weight
    for j in range(d + 1):
        centre[j] = centre[j] / total if total > 0.0 else 0.0
    return total


def excess_of(ranges: Ranges, i: Integer, centre: ConstantReals) -> Real:
    """``|s|² + e − l²`` of a row, seen from the centre; with an offset l counts from the mean length."""
    d = ranges.d
    sphere = ranges.spheres[i * (d + 3) :]
    length = sphere[d] - centre[d] if ranges.offset == 1 else sphere[d]
    total = sphere[d + 1] - length * length
    for j in range(d):
        total += (sphere[j] - centre[j]) * (sphere[j] - centre[j])
    return total


def set_differences(ranges: Ranges, centre: ConstantReals, mean: Real, chunk: Reals, triangle: Reals) -> None:
    """The triangle (m + 1, m + 1) of ``√w [s, l, excess / 2]``, each less its mean: the last column is the right side.

    ``chunk`` (m + 1, `AT_A_TIME`) is scratch.
    """
    d = ranges.d
    m = d + ranges.offset
    filled((m + 1) * (m + 1), 0.0, triangle)
    there = 0
    for i in range(ranges.rows):
        if ranges.weights[i] > 0.0:
            root = ranges.weights[i]
            for j in range(m):
                chunk[j * AT_A_TIME + there] = root * (ranges.spheres[i * (d + 3) + j] - centre[j])
            chunk[m * AT_A_TIME + there] = 0.5 * root * (excess_of(ranges, i, centre) - mean)
            there += 1
            if there == AT_A_TIME:
                append_rows(m + 1, there, AT_A_TIME, chunk, triangle)
                there = 0
    if there > 0:
        append_rows(m + 1, there, AT_A_TIME, chunk, triangle)


def signed_product(d: Integer, m: Integer, a: ConstantReals, b: ConstantReals) -> Real:
    """``a·b``, in which the offset counts negatively."""
    found = dot(d, a, b)
    return found - a[d] * b[d] if m > d else found


def put_place(ranges: Ranges, centre: ConstantReals, place: ConstantReals, found: Reals) -> Integer:
    """A place (m,), seen from the centre, as numbers p and b; 0 where it is none."""
    d = ranges.d
    size = 0.0
    for j in range(d):
        found[j] = centre[j] + place[j]
        size += fabs(found[j])
    if ranges.offset == 1:
        slope = 0.0
        for i in range(ranges.rows):
            if slope == 0.0 and ranges.weights[i] > 0.0:
                slope = ranges.spheres[i * (d + 3) + d + 2]
        found[d] = (place[d] - centre[d]) / slope if slope != 0.0 else 0.0
        if ranges.even == 1:
            found[d] = fabs(found[d])
        size += fabs(found[d])
    return 1 if isfinite(size) else 0


def places_of_ranges(ranges: Ranges, found: Reals) -> Integer:
    """The places (up to `MOST_PLACES`, m) that fit, m = d + offset, and how many there are.

    By differences alone, the first, unless the stations are flat; then, where they are nearly flat, both sides of their
    plane, the one first that lies below along the axis that grows most. None where the rows leave more than a line.
    """
    d = ranges.d
    m = d + ranges.offset
    centre = ranges.scratch
    singular = ranges.scratch[4:]
    local = ranges.scratch[8:]
    within = ranges.scratch[12:]
    place = ranges.scratch[16:]
    lines = ranges.scratch[24:]
    axes = ranges.scratch[40:]
    triangle = ranges.scratch[56:]
    weigh_squares(ranges)
    total = centre_of(ranges, centre)
    if not total > 0.0:
        return 0
    mean = 0.0
    for i in range(ranges.rows):
        if ranges.weights[i] > 0.0:
            mean += ranges.weights[i] * ranges.weights[i] * excess_of(ranges, i, centre)
    mean /= total
    set_differences(ranges, centre, mean, ranges.scratch[CHUNK_AT:], triangle)
    singular_values(m, triangle, lines, axes, singular)
    if not singular[0] > 0.0 or not singular[m - 2] > FLAT * singular[0]:
        return 0
    flat = 0 if singular[m - 1] > FLAT * singular[0] else 1
    filled(m, 0.0, within)
    for k in range(m):
        share = 0.0
        if k < m - 1 or flat == 0:
            for i in range(m):
                across = dot(m - i, triangle[i * (m + 1) + i :], axes[k * m + i :])
                share += across * triangle[i * (m + 1) + m]
            share /= singular[k] * singular[k]
        copied(m, within, local)
        add_multiple(m, share, axes[k * m :], local)
        if k < m - 1:
            copied(m, local, within)
    count = 0
    if flat == 0:
        count += put_place(ranges, centre, local, found)
    if singular[m - 1] < NEARLY_FLAT * singular[0]:
        count += put_sides(ranges, centre, mean, within, axes[(m - 1) * m :], place, found[count * m :])
    return count


def put_sides(
    ranges: Ranges,
    centre: ConstantReals,
    mean: Real,
    within: ConstantReals,
    axis: ConstantReals,
    place: Reals,
    found: Reals,
) -> Integer:
    """The places on the line from ``within`` (m,) along ``axis`` (m,) whose square the mean excess gives; how many."""
    d = ranges.d
    m = d + ranges.offset
    leading = 0
    for j in range(1, m):
        if fabs(axis[j]) > fabs(axis[leading]):
            leading = j
    a = signed_product(d, m, axis, axis)
    half = signed_product(d, m, within, axis)
    rest = signed_product(d, m, within, within) + mean
    count = 0
    for side in range(2):
        sign = -1.0 if side == 0 else 1.0
        if axis[leading] * a < 0.0:
            sign = -sign
        along = 0.0
        if fabs(a) > PARALLEL:
            along = (sign * sqrt(max(half * half - a * rest, 0.0)) - half) / a
        elif half != 0.0:
            along = -0.5 * rest / half
        if fabs(a) > PARALLEL or (side == 1 and half != 0.0):
            copied(m, within, place)
            add_multiple(m, along, axis, place)
            count += put_place(ranges, centre, place, found[count * m :])
    return count


def places_of_many(ranges: Ranges, sets: Integer, found: Reals, counts: Integers) -> None:
    """`places_of_ranges` for sets that stand one after the other: ``found`` (sets, `MOST_PLACES`, m)."""
    m = ranges.d + ranges.offset
    spheres = ranges.spheres
    weights = ranges.weights
    for k in range(sets):
        ranges.spheres = spheres[k * ranges.rows * (ranges.d + 3) :]
        ranges.weights = weights[k * ranges.rows :]
        counts[k] = places_of_ranges(ranges, found[k * MOST_PLACES * m :])
