"""How far quantities vary that are computed from the estimates, by linear propagation."""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals
from mbm.solver.linear_algebra import dot, filled

OPEN = -2
"""The column of a coordinate that the data do not determine."""


def gather_gradient(
    n: Integer,
    which: Integer,
    count: Integer,
    rows: ConstantIntegers,
    tangents: ConstantIntegers,
    columns: ConstantIntegers,
    slopes: ConstantReals,
    gradient: Reals,
) -> Integer:
    """``gradient`` (n,) of quantity ``which``, from the derivatives (count,) that are not zero everywhere.

    ``rows`` are their quantities, ``tangents`` the coordinates, whose places in the gradient are ``columns``; -1: it
    stays. 0: the quantity depends on an `OPEN` one.
    """
    filled(n, 0.0, gradient)
    for k in range(count):
        if rows[k] == which and slopes[k] != 0.0:
            place = columns[tangents[k]]
            if place == OPEN:
                return 0
            if place >= 0:
                gradient[place] += slopes[k]
    return 1


def held_by_bounds(n: Integer, sides: ConstantIntegers, gradient: ConstantReals) -> Integer:
    """1 where a quantity with the ``gradient`` (n,) varies only as estimates leave the bounds that hold them.

    ``sides`` (n,) are not 0 where a bound holds a coordinate.
    """
    held = 0
    for i in range(n):
        if gradient[i] != 0.0:
            if sides[i] == 0:
                return 0
            held = 1
    return held


def put_spread(
    n: Integer,
    count: Integer,
    factor: ConstantReals,
    touched: ConstantIntegers,
    gradients: Reals,
    covariance: Reals,
    deviations: Reals,
) -> None:
    """The covariance (count, count) of quantities with these ``gradients`` (count, n) by what has covariance ``UᵀU``.

    NaN, and -1 of the standard deviations, of what depends on coordinates that are ``touched``, or has no derivative.
    """
    lines = gradients[count * n :]
    for c in range(count):
        for i in range(n):
            lines[c * n + i] = dot(n, factor[i * n :], gradients[c * n :])
            if touched[i] == 1 and gradients[c * n + i] != 0.0:
                gradients[c * n] = inf - inf
    for c in range(count):
        for d in range(count):
            covariance[c * count + d] = dot(n, lines[c * n :], lines[d * n :])
        variance = covariance[c * count + c]
        deviations[c] = sqrt(variance) if variance < inf else -1.0
