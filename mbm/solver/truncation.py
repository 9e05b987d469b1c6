"""A normal distribution cut by a half space: its mean and variance across the cut (Shimada et al. 1997, eqs 24-29).

For ``x ~ N(0, 1)`` given ``x ≤ c``: mean ν = −φ(c)/Φ(c), variance τ = 1 + cν − ν². Equation (27) as printed divides 0
by 0 for cuts far on the left, and τ cancels there: both come from the continued fraction of Mills' ratio instead,
whose tail is what is left after the cancellation.
"""

from __future__ import annotations

from math import exp

from mbm.machine.words import Real

FRACTION_FROM = 1.0
"""How far left of the mean a cut is from which the continued fraction serves."""

DEEP = 450.0
"""The fraction is as deep as this divided by the square of the distance, and `LEAST_DEEP`: its error falls as
``exp(−2 t √N)``, here below 1e-18."""

LEAST_DEEP = 12.0

NO_CUT = 38.0
"""Deviations beyond which nothing is cut off: φ is 0."""

ROOT_TWO_PI = 2.5066282746310002
SMALL_TERM = 1e-18
"""A term of the series is left out from this share of their sum on."""


def fraction_tail(distance: Real, level: Real) -> Real:
    """``t + (l + 1)/(t + (l + 2)/(t + …))``: the continued fraction of the hazard of a normal distribution."""
    most = level
    while most < level + LEAST_DEEP + DEEP / (distance * distance):
        most += 1.0
    found = distance
    while most > level:
        found = distance + most / found
        most -= 1.0
    return found


def share_below(cut: Real) -> Real:
    """``Φ(c) / φ(c)`` for c > −2 or so, by the series of positive terms ``c + c³/3 + c⁵/15 + …``."""
    term = cut
    total = cut
    odd = 1.0
    while term * term > SMALL_TERM * SMALL_TERM * total * total:
        odd += 2.0
        term *= cut * cut / odd
        total += term
    return 0.5 * ROOT_TWO_PI * exp(0.5 * cut * cut) + total


def cut_mean(cut: Real) -> Real:
    """ν: the mean of N(0, 1) given that it is at most ``cut``."""
    if cut > NO_CUT:
        return 0.0
    if cut < -FRACTION_FROM:
        return -fraction_tail(-cut, 0.0)
    return -1.0 / share_below(cut)


def cut_variance(cut: Real) -> Real:
    """τ: its variance."""
    if cut > NO_CUT:
        return 1.0
    if cut < -FRACTION_FROM:
        third = fraction_tail(-cut, 3.0)
        second = -cut + 3.0 / third
        first = -cut + 2.0 / second
        return (-cut + 4.0 / second - 3.0 / third) / (second * first * first)
    mean = cut_mean(cut)
    return 1.0 + cut * mean - mean * mean
