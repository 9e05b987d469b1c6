"""The χ² law of squared norms: tails, and the noise that is left of what was cut off."""

from __future__ import annotations

from math import exp, fabs, log

from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

LOG_ROOT_PI = 0.5723649429247001
TERMS = 100000
SMALL = 1e-300

ROUNDS = 20
"""Rounds of variance and truncation in turn; each takes away most of what is left."""


def log_gamma_of_half(dof: Integer) -> Real:
    """log Γ(dof/2), dof ≥ 1."""
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
    """P(χ² > value): the incomplete gamma function, by series or by Lentz's fraction (`mbm.solution.gamma`)."""
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
        if fabs(d * c - 1.0) < 1e-16:
            break
    return front * product


def consistency(limit: Real, components: Integer) -> Real:
    """Variance that normal residuals have left inside ``limit``: below 1 since the tails are cut off."""
    share = 1.0 - chi_square_tail(limit, components)
    if share > 0.0:
        return (1.0 - chi_square_tail(limit, components + 2)) / share
    return 1.0


def untruncated(
    units: Integer,
    group: Integer,
    raw: Real,
    squares: ConstantReals,
    limits: ConstantReals,
    components: ConstantIntegers,
    groups: ConstantIntegers,
) -> Real:
    """The variance of the noise whose part inside the limits has the variance ``raw``, from a group's inliers."""
    variance = raw
    for _ in range(ROUNDS):
        share = 0.0
        total = 0.0
        last_limit = -1.0
        last_size = 0
        left = 1.0
        for u in range(units):
            if groups[u] == group and squares[u] <= limits[u]:
                if limits[u] != last_limit or components[u] != last_size:
                    last_limit = limits[u]
                    last_size = components[u]
                    left = consistency(last_limit / variance, last_size)
                share += float(components[u]) * left
                total += float(components[u])
        updated = raw / max(share / total, 0.1)
        if fabs(updated - variance) <= 1e-10 * variance:
            break
        variance = updated
    return variance


def noise_variances(
    units: Integer,
    dimension: Integer,
    groups_count: Integer,
    squares: ConstantReals,
    limits: ConstantReals,
    components: ConstantIntegers,
    groups: ConstantIntegers,
    rounding: ConstantReals,
    variances: Reals,
) -> None:
    """The variance (U,) of the noise, in place: as it is, or ``SSE/((n − p) κ)`` of the inliers with unknown noise.

    ``squares`` (U,) at the fit are inside ``limits`` (U,) for inliers; unknowns are shared out by number of residuals.
    """
    total = 0
    for u in range(units):
        if squares[u] <= limits[u]:
            total += components[u]
    for group in range(groups_count):
        count = 0
        summed = 0.0
        least = 1e-300
        for u in range(units):
            if groups[u] == group and squares[u] <= limits[u]:
                count += components[u]
                summed += squares[u]
                least = max(least, rounding[u])
        if count > 0:
            freedom = float(count) * (1.0 - float(dimension) / float(total))
            if freedom > 0.0:
                raw = max(summed / freedom, least)
                found = untruncated(units, group, raw, squares, limits, components, groups)
                for u in range(units):
                    if groups[u] == group:
                        variances[u] = found


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


ROUTINES = (
    log_gamma_of_half,
    chi_square_tail,
    consistency,
    untruncated,
    noise_variances,
    mark_inliers,
)
