"""Active bounds: those with a non-zero multiplier; a bound whose multiplier is zero is released.

Where data leave a combination of unknowns free, an iteration may end anywhere along it: whether that is just at a
bound, and to which side rounding then tips the slope, says nothing.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import ConstantReals, Integer, Integers, Real
from mbm.solver.decisions import IDLE, ROUNDED_PUSH
from mbm.solver.linear_algebra import column_product, gradient_of


def release_inactive(
    n: Integer, triangle: ConstantReals, x: ConstantReals, cost: Real, pulls: ConstantReals, sides: Integers
) -> None:
    """``sides`` (n,) become 0 where the slope ``Jᵀ r`` is nothing beside the length of its column and ``cost`` = rᵀ r.

    ``triangle`` (n + 1, n + 1) of ``[J r]``; ``x`` (n,) are the coordinates, ``pulls`` (n,) what constraints add to
    the slope.
    """
    width = n + 1
    bounded = 0
    for j in range(n):
        if sides[j] != 0:
            bounded += 1
    if bounded == 0:
        return
    made_of = 0.0
    for j in range(n):
        made_of += column_product(j + 1, width, triangle[j:], triangle[j:]) * x[j] * x[j]
    for j in range(n):
        if sides[j] != 0:
            length = column_product(j + 1, width, triangle[j:], triangle[j:])
            slope = pulls[j] + gradient_of(n, j, triangle)
            if fabs(slope) <= sqrt(length) * (IDLE * sqrt(cost) + ROUNDED_PUSH * sqrt(made_of)):
                sides[j] = 0
