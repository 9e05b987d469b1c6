"""Ranges to as many known stations as there are unknowns → the places, with or without a common offset.

Differences of squared distances are linear (Nishida et al., eqs 6-11): with one row less than unknowns they leave a
line, which the sphere of the first station meets twice.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.linear_algebra import add_multiple, numbered

FLAT = 1e-9
"""A pivot below this share of the largest is none: the stations leave more than a line."""

PARALLEL = 1e-12
"""A line that meets the quadric once only, in the units of the stations' extent."""


def null_line(rows: Integer, matrix: Reals, right: Reals, order: Integers, point: Reals, line: Reals) -> Integer:
    """A point and the direction of the line on which ``rows`` equations in rows + 1 unknowns hold; 0 if it is more.

    ``matrix`` (rows, rows + 1) and ``right`` (rows,) are used up by elimination with complete pivoting; ``order``
    (rows + 1,) is scratch. ``point`` and ``line`` have shape (rows + 1,).
    """
    width = rows + 1
    first = 0.0
    numbered(width, order)
    for k in range(rows):
        best = -1.0
        row = k
        column = k
        for i in range(k, rows):
            for j in range(k, width):
                if fabs(matrix[i * width + j]) > best:
                    best = fabs(matrix[i * width + j])
                    row = i
                    column = j
        first = max(first, best)
        if not best > FLAT * first:
            return 0
        for j in range(width):
            kept = matrix[k * width + j]
            matrix[k * width + j] = matrix[row * width + j]
            matrix[row * width + j] = kept
        kept = right[k]
        right[k] = right[row]
        right[row] = kept
        for i in range(rows):
            kept = matrix[i * width + k]
            matrix[i * width + k] = matrix[i * width + column]
            matrix[i * width + column] = kept
        place = order[k]
        order[k] = order[column]
        order[column] = place
        for i in range(k + 1, rows):
            factor = matrix[i * width + k] / matrix[k * width + k]
            add_multiple(width - k - 1, -factor, matrix[k * width + k + 1 :], matrix[i * width + k + 1 :])
            right[i] -= factor * right[k]
    point[order[rows]] = 0.0
    line[order[rows]] = 1.0
    for back in range(rows):
        k = rows - 1 - back
        value = right[k]
        slope = -matrix[k * width + rows]
        for j in range(k + 1, rows):
            value -= matrix[k * width + j] * point[order[j]]
            slope -= matrix[k * width + j] * line[order[j]]
        point[order[k]] = value / matrix[k * width + k]
        line[order[k]] = slope / matrix[k * width + k]
    return 1


def difference_equations(
    d: Integer, offset: Integer, scale: Real, spheres: ConstantReals, matrix: Reals, right: Reals
) -> None:
    """The equations of all rows but the first, less that of the first: linear in the place seen from its station.

    Lengths are in units of ``scale``.
    """
    m = d + offset
    wide = d + 3
    length = spheres[d] / scale
    extra = spheres[d + 1] / (scale * scale)
    for i in range(1, m):
        total = 0.0
        for j in range(d):
            away = (spheres[i * wide + j] - spheres[j]) / scale
            matrix[(i - 1) * m + j] = 2.0 * away
            total += away * away
        other = spheres[i * wide + d] / scale
        if offset == 1:
            matrix[(i - 1) * m + d] = 2.0 * (other - length) * spheres[d + 2]
        more = spheres[i * wide + d + 1] / (scale * scale) - extra
        right[i - 1] = total + more - (other - length) * (other + length)


def places_from_spheres(
    d: Integer,
    offset: Integer,
    even: Integer,
    spheres: ConstantReals,
    found: Reals,
    order: Integers,
    scratch: Reals,
) -> Integer:
    """Solutions (up to 2, m) of ``|p − s|² + e = (l + β b)²`` for m rows (s, l, e, β), m = d + offset.

    ``spheres`` (m, d + 3) holds s, l, e, β of each row; ``offset`` 1: b is unknown too, and stands behind p; ``even``
    1: its sign is open, and taken positive. ``order`` (m,) and ``scratch`` (m (m + 4),) are scratch. How many there are
    is given: two, also where they are equal since the spheres do not quite meet, one where the line meets the quadric
    once, or none.
    """
    m = d + offset
    wide = d + 3
    scale = 0.0
    for i in range(1, m):
        for j in range(d):
            scale = max(fabs(spheres[i * wide + j] - spheres[j]), scale)
    if not scale > 0.0:
        return 0
    matrix = scratch
    right = scratch[m * m :]
    point = scratch[m * (m + 1) :]
    line = scratch[m * (m + 2) :]
    length = spheres[d] / scale
    slope = spheres[d + 2]
    extra = spheres[d + 1] / (scale * scale)
    difference_equations(d, offset, scale, spheres, matrix, right)
    if null_line(m - 1, matrix, right, order, point, line) == 0:
        return 0
    a = 0.0
    half = 0.0
    c = extra - length * length
    for j in range(d):
        a += line[j] * line[j]
        half += line[j] * point[j]
        c += point[j] * point[j]
    if offset == 1:
        a -= slope * slope * line[d] * line[d]
        half -= line[d] * slope * (length + slope * point[d])
        c -= slope * point[d] * (2.0 * length + slope * point[d])
    count = 2
    if fabs(a) > PARALLEL:
        root = sqrt(max(half * half - a * c, 0.0))
        first = (root - half) / a
        second = (-root - half) / a
    else:
        first = -c / (2.0 * half)
        second = inf
        count = 1
    if not isfinite(first):
        return 0
    for j in range(d):
        found[j] = spheres[j] + scale * (point[j] + first * line[j])
        found[m + j] = spheres[j] + scale * (point[j] + second * line[j])
    if offset == 1:
        found[d] = scale * (point[d] + first * line[d])
        found[m + d] = scale * (point[d] + second * line[d])
        if even == 1:
            found[d] = fabs(found[d])
            found[m + d] = fabs(found[m + d])
    return count
