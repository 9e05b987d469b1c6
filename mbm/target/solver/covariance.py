"""Covariance of the estimates from the triangle: ``(JᵀJ)⁻¹`` on the surface of the bounds and constraints that hold.

JᵀJ is never formed. Only movements along the surface count: `tangent` turns the constraints that hold away.
"""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.target.solver.description import COORDINATES
from mbm.target.solver.linear_algebra import append_rows, copied, dot, filled, inverted_upper
from mbm.target.solver.tangent import along_surface, from_surface, turn_constraints
from mbm.target.solver.workspace import (
    FLAGS,
    matrix_at,
    slopes_at,
    small_rows_at,
    small_triangle_at,
    step_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

DEPENDENT = 1e-12
"""A pivot of the column-scaled triangle below this share of the largest is none."""

SUSPECT = 1e-9
GAP = 1e4
"""Between DEPENDENT and SUSPECT it is none where a gap this wide parts it from the larger ones: the derivatives of
large coordinates, and a point a rounding away from the surface, leave dependences with such errors."""


def set_covariance(
    system: ConstantIntegers,
    triangle: ConstantReals,
    sides: ConstantIntegers,
    holding: Integer,
    held: ConstantReals,
    work: Reals,
    flags: Integers,
    covariance: Reals,
) -> Real:
    """The covariance (n, n), and the condition of the column-scaled triangle; infinite where it is deficient.

    ``triangle`` (n + 1, n + 1) of ``[J r]``; ``sides`` (n,) not 0 where a bound holds a coordinate. Of
    the first constraints, as many as ``holding`` says, hold where ``held[k]`` is their unit; 0: it does not.
    """
    n = system[COORDINATES]
    scale = work[step_at(system, 11) :]
    line = work[step_at(system, 12) :]
    part = work[matrix_at(system, 1) :]
    reflections = work[matrix_at(system, 2) :]
    inverse = work[matrix_at(system, 3) :]
    small = work[small_triangle_at(system) :]
    slopes = work[slopes_at(system) :]
    chosen = flags[FLAGS:]
    count = 0
    for j in range(n):
        if sides[j] == 0:
            chosen[count] = j
            count += 1
    filled(n * n, 0.0, covariance)
    set_scales(n, count, chosen, triangle, holding, held, slopes, scale)
    turned = turn_constraints(n, count, chosen, scale, holding, held, slopes, reflections)
    width = count - turned
    if width == n:
        for i in range(n):
            for k in range(i, n):
                small[i * (n + 1) + k] = triangle[i * (n + 1) + k] / scale[k]
    else:
        rows = work[small_rows_at(system) :]
        set_reduced(n, count, turned, chosen, triangle, scale, reflections, line, rows, small)
    if full_rank(width, small) == 0:
        return undetermined(n, sides, covariance)
    for i in range(width):
        for k in range(width):
            part[i * width + k] = small[i * (width + 1) + k]
    inverted_upper(width, part, inverse)
    condition = sqrt(float(count) * dot(width * width, inverse, inverse))
    if turned > 0:
        for k in range(width):
            filled(count, 0.0, line)
            for i in range(k + 1):
                line[turned + i] = inverse[i * width + k]
            from_surface(count, turned, reflections, line)
            for i in range(count):
                part[i * width + k] = line[i]
        copied(count * width, part, inverse)
    for i in range(count):
        for k in range(i + 1):
            first = i if turned == 0 else 0
            value = dot(width - first, inverse[i * width + first :], inverse[k * width + first :])
            value /= scale[i] * scale[k]
            covariance[chosen[i] * n + chosen[k]] = value
            covariance[chosen[k] * n + chosen[i]] = value
    return condition


def set_scales(
    n: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    triangle: ConstantReals,
    holding: Integer,
    held: ConstantReals,
    slopes: ConstantReals,
    scale: Reals,
) -> None:
    """The lengths (count,) of the chosen columns; of those that no residual feels what constraints make of them."""
    for k in range(count):
        square = 0.0
        for i in range(n):
            value = triangle[i * (n + 1) + chosen[k]] if i <= chosen[k] else 0.0
            square += value * value
        scale[k] = sqrt(square)
        for c in range(holding):
            if held[c] != 0.0 and square == 0.0:
                value = slopes[c * n + chosen[k]] / held[c]
                scale[k] = sqrt(scale[k] * scale[k] + value * value)
        if scale[k] == 0.0:
            scale[k] = 1.0


def set_reduced(
    n: Integer,
    count: Integer,
    turned: Integer,
    chosen: ConstantIntegers,
    triangle: ConstantReals,
    scale: ConstantReals,
    reflections: ConstantReals,
    line: Reals,
    rows: Reals,
    small: Reals,
) -> None:
    """``small`` (w + 1, w + 1), w = count - turned: the triangle of the chosen columns, scaled, along the surface."""
    width = count - turned
    for i in range(n):
        for k in range(count):
            line[k] = triangle[i * (n + 1) + chosen[k]] / scale[k] if i <= chosen[k] else 0.0
        along_surface(count, turned, reflections, line)
        for k in range(width):
            rows[k * n + i] = line[turned + k]
    filled(n, 0.0, rows[width * n :])
    filled((width + 1) * (width + 1), 0.0, small)
    append_rows(width + 1, n, n, rows, small)


def full_rank(width: Integer, small: ConstantReals) -> Integer:
    """0 where a pivot of ``small`` (width + 1, width + 1) is none; see `DEPENDENT` and `GAP`."""
    largest = 0.0
    for i in range(width):
        pivot = fabs(small[i * (width + 1) + i])
        if pivot > largest:
            largest = pivot
    for i in range(width):
        pivot = fabs(small[i * (width + 1) + i])
        if not pivot > DEPENDENT * largest:
            return 0
        if pivot <= SUSPECT * largest:
            above = largest
            for k in range(width):
                other = fabs(small[k * (width + 1) + k])
                if other > pivot and other < above:
                    above = other
            if pivot * GAP <= above:
                return 0
    return 1


def undetermined(n: Integer, sides: ConstantIntegers, covariance: Reals) -> Real:
    """No covariance: NaN for all that no bound holds."""
    for i in range(n):
        for k in range(n):
            if sides[i] == 0 and sides[k] == 0:
                covariance[i * n + k] = inf - inf
    return inf


ROUTINES = (set_scales, set_reduced, full_rank, undetermined, set_covariance)
