"""The variance of noise whose tails were cut off."""

from __future__ import annotations

from math import fabs

from mbm.machine.words import ConstantReals, Integer, Integers, Real
from mbm.solver.chi_square import consistency
from mbm.solver.consensus_records import Units
from mbm.solver.decisions import LEAST_KEPT, ROUNDED, SECANTS


def share_left(units: Units, group: Integer, wide: Integer, variance: Real) -> Real:
    """Share of their variance that a group's inliers keep inside their limits, or reaches if these are wider.

    ``wide`` 1: the limits are three standard deviations at least; 0: they are as they are.
    """
    share = 0.0
    total = 0.0
    last_limit = -1.0
    last_size = 0
    left = 1.0
    for u in range(units.count):
        if units.group[u] == group and units.inlier[u] == 1:
            limit = units.limits[u] / variance
            if wide == 1:
                limit = max(limit, units.reaches[u])
            if limit != last_limit or units.components[u] != last_size:
                last_limit = limit
                last_size = units.components[u]
                left = consistency(last_limit, last_size)
            share += float(units.components[u]) * left
            total += float(units.components[u])
    return max(share / total, LEAST_KEPT)


def untruncated(units: Units, group: Integer, wide: Integer, raw: Real) -> Real:
    """The variance v of the noise whose part inside the limits has the variance ``raw``, from a group's inliers.

    What is left inside, ``v κ(v)``, grows with v: secants, kept inside of what brackets the solution.
    """
    before = raw
    left = share_left(units, group, wide, raw)
    off_before = left - 1.0
    low = raw
    high = raw / LEAST_KEPT
    variance = raw / left
    for _ in range(SECANTS):
        left = share_left(units, group, wide, variance)
        off = variance / raw * left - 1.0
        if off <= 0.0:
            low = variance
        else:
            high = variance
        if fabs(off) <= ROUNDED or fabs(variance - before) <= ROUNDED * variance or off == off_before:
            break
        following = variance - off * (variance - before) / (off - off_before)
        if not (low < following and following < high):
            following = 0.5 * (low + high)
        before = variance
        off_before = off
        variance = following
    return variance


def mark_inliers(units: Integer, squares: ConstantReals, limits: ConstantReals, inliers: Integers) -> Integer:
    """1 for units whose squared norm is within its limit, else 0; 1 is given if nothing has changed."""
    same = 1
    for u in range(units):
        inside = 0
        if squares[u] <= limits[u]:
            inside = 1
        if inliers[u] != inside:
            same = 0
        inliers[u] = inside
    return same
