"""Covariance of the estimates from the triangle: ``(JᵀJ)⁻¹`` on the surface of the bounds and constraints that hold.

JᵀJ is never formed. A constraint that holds takes part as a row so heavy that nothing moves across it.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.target.solver.description import COORDINATES
from mbm.target.solver.linear_algebra import append_rows, dot, filled, inverted_upper
from mbm.target.solver.workspace import (
    FLAGS,
    matrix_at,
    slopes_at,
    small_rows_at,
    small_triangle_at,
    step_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals, distinct_arrays

HEAVY = 1e8
"""Weight of a constraint that holds, in units of the scaled columns: movements across it keep a variance of 1e-16."""

DEPENDENT = 1e-12
"""A pivot of the column-scaled triangle below this is none."""


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
    part = work[matrix_at(system, 1) :]
    inverse = work[matrix_at(system, 3) :]
    rows = work[small_rows_at(system) :]
    small = work[small_triangle_at(system) :]
    chosen = flags[FLAGS:]
    count = 0
    for j in range(n):
        if sides[j] == 0:
            chosen[count] = j
            count += 1
    filled(n * n, 0.0, covariance)
    filled((count + 1) * (count + 1), 0.0, small)
    slopes = work[slopes_at(system) :]
    triangular = 1 if count == n else 0
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
    for c in range(holding):
        if held[c] != 0.0:
            triangular = 0
            filled((count + 1) * n, 0.0, rows)
            for k in range(count):
                rows[k * n] = HEAVY * slopes[c * n + chosen[k]] / (held[c] * scale[k])
            append_rows(count + 1, 1, n, rows, small)
    if triangular == 1:
        for i in range(n):
            for k in range(i, n):
                small[i * (n + 1) + k] = triangle[i * (n + 1) + k] / scale[k]
    else:
        append_chosen(n, count, chosen, triangle, scale, rows, small)
    for i in range(count):
        if not small[i * (count + 1) + i] * small[i * (count + 1) + i] > DEPENDENT * DEPENDENT:
            return undetermined(n, sides, covariance)
        for k in range(count):
            part[i * count + k] = small[i * (count + 1) + k]
    inverted_upper(count, part, inverse)
    for i in range(count):
        for k in range(i + 1):
            value = dot(count - i, inverse[i * count + i :], inverse[k * count + i :]) / (scale[i] * scale[k])
            covariance[chosen[i] * n + chosen[k]] = value
            covariance[chosen[k] * n + chosen[i]] = value
    return sqrt(float(count) * dot(count * count, inverse, inverse))


@distinct_arrays
def append_chosen(
    n: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    triangle: ConstantReals,
    scale: ConstantReals,
    rows: Reals,
    small: Reals,
) -> None:
    """The chosen columns of ``triangle`` (n + 1, n + 1), each over its scale, as further rows of ``small``."""
    for k in range(count):
        for i in range(n):
            rows[k * n + i] = triangle[i * (n + 1) + chosen[k]] / scale[k] if i <= chosen[k] else 0.0
    filled(n, 0.0, rows[count * n :])
    append_rows(count + 1, n, n, rows, small)


def undetermined(n: Integer, sides: ConstantIntegers, covariance: Reals) -> Real:
    """No covariance: NaN for all that no bound holds."""
    for i in range(n):
        for k in range(n):
            if sides[i] == 0 and sides[k] == 0:
                covariance[i * n + k] = inf - inf
    return inf


ROUTINES = (append_chosen, undetermined, set_covariance)
