"""The variance of noise whose tails were cut off, and what is left of its information."""

from __future__ import annotations

from math import exp, fabs, isfinite, log
from typing import TYPE_CHECKING

from mbm.machine.words import ConstantReals, Integer, Integers, Real
from mbm.solver.consensus_records import Units
from mbm.solver.decisions import LEAST_KEPT, LEAST_SHARE, ROUNDED, SECANTS, STATED

if TYPE_CHECKING:
    from mbm.machine.words import ConstantIntegers, Reals


LOG_ROOT_PI = 0.5723649429247001
HALF_LOG_TWO_PI = 0.9189385332046727
STIRLING_FROM = 64
"""Degrees of freedom from which on Stirling's series gives all digits with four terms: the next is below 1e-17."""

TERMS = 100000
SMALL = 1e-300
ROUNDED_TO_ONE = 4e-16
"""Distance from 1 of a factor that changes nothing any more: rounding leaves two units of the last place of some."""


def log_gamma_of_half(dof: Integer) -> Real:
    """log Γ(dof/2), dof ≥ 1."""
    if dof >= STIRLING_FROM:
        a = 0.5 * float(dof)
        square = 1.0 / (a * a)
        series = ((1.0 / 1260.0 - square / 1680.0) * square - 1.0 / 360.0) * square + 1.0 / 12.0
        return (a - 0.5) * log(a) - a + HALF_LOG_TWO_PI + series / a
    total = 0.0
    start = 2
    if dof % 2 == 1:
        total = LOG_ROOT_PI
        start = 1
    while start < dof:
        total += log(0.5 * float(start))
        start += 2
    return total


def chi_square_tail(value: Real, dof: Integer) -> Real:
    """P(χ² > value) for ``dof`` degrees of freedom: the regularised incomplete gamma function Q(dof/2, value/2).

    Series below the mean, Lentz's continued fraction above (Press et al., Numerical Recipes, 6.2); relative errors of
    1e-12 for some hundred degrees of freedom, 1e-9 for a million.
    """
    a = 0.5 * float(dof)
    x = 0.5 * value
    if x <= 0.0:
        return 1.0
    if x > 1e300:
        return 0.0
    front = exp(a * log(x) - x - log_gamma_of_half(dof))
    if x < a + 1.0:
        term = 1.0 / a
        total = term
        for n in range(1, TERMS):
            term = term * (x / (a + float(n)))
            total += term
            if term < total * 1e-17:
                break
        return min(max(1.0 - front * total, 0.0), 1.0)
    if front <= 0.0:
        return 0.0
    b = x + 1.0 - a
    c = 1.0 / SMALL
    d = 1.0 / b
    product = d
    for n in range(1, TERMS):
        numerator = -float(n) * (float(n) - a)
        b += 2.0
        d = numerator * d + b
        if not fabs(d) > SMALL:
            d = SMALL
        d = 1.0 / d
        c = b + numerator / c
        if not fabs(c) > SMALL:
            c = SMALL
        product = product * (d * c)
        if fabs(d * c - 1.0) < ROUNDED_TO_ONE:
            break
    return front * product


def chi_square_tails(count: Integer, values: ConstantReals, dof: ConstantIntegers, tails: Reals) -> Integer:
    """P(χ² > value) of so many values, each with its own degrees of freedom; 0 is given."""
    for k in range(count):
        tails[k] = chi_square_tail(values[k], dof[k])
    return 0


def consistency(limit: Real, components: Integer) -> Real:
    """Variance that normal residuals have left inside ``limit``: below 1 since the tails are cut off."""
    share = 1.0 - chi_square_tail(limit, components)
    if share > 0.0:
        return (1.0 - chi_square_tail(limit, components + 2)) / share
    return 1.0


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


def share_of_strays(units: Units, group: Integer, squares: ConstantReals) -> Real:
    """The share of a group's inliers that are outliers by rights: their errors are large, but not these.

    Outliers that are spread evenly over a ball of v times the volume of the limits are inside with probability 1/v, and
    so one of them for each of ``∫ dv/v²`` outside: each that is left out adds ``(limit/square)^d``, those far off next
    to nothing.
    """
    kept = 0
    strays = 0.0
    for u in range(units.count):
        if units.group[u] == group:
            if units.inlier[u] == 1:
                kept += isfinite(units.limits[u])
            elif squares[u] > units.limits[u]:
                term = 1.0
                for _ in range(units.components[u]):
                    term *= units.limits[u] / squares[u]
                strays += term
    if kept == 0:
        return 0.0
    return min(strays / float(kept), 1.0 - LEAST_SHARE)


def inform_units(units: Units, groups: Integer, squares: ConstantReals) -> None:
    """`information` of the units at squared norms (U,): by what the rows of inliers count in the inverse covariance.

    Hard rejection is the M-estimator with ψ(r) = r inside. A share c of the inliers are strays, spread evenly over the
    limit L, so that ``E ψψᵀ`` is (1 − c) κ + c L/(d + 2), while ``E Dψ`` = (1 − c) κ: the strays that a step brings in
    undo what those inside say. The information is ``(E Dψ)²/E ψψᵀ``. Unknown noise has ``E ψψᵀ``/κ in place of its
    variance already, which leaves ``(1 − c)² κ``.
    """
    for group in range(STATED, groups):
        strays = share_of_strays(units, group, squares)
        good = 1.0 - strays
        last_limit = -1.0
        last_size = 0
        left = 1.0
        for u in range(units.count):
            if units.group[u] == group:
                limit = units.limits[u] / units.noise[u]
                size = units.components[u]
                if limit != last_limit or size != last_size:
                    last_limit = limit
                    last_size = size
                    left = consistency(limit, size)
                units.information[u] = good * good * left
                if not isfinite(limit):  # it was not judged
                    units.information[u] = 1.0
                elif group == STATED:
                    units.information[u] *= left / (good * left + strays * limit / float(size + 2))
