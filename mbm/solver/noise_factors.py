"""Numbers and formulas by which the factors of unknown noise are found: for compiled texts and those in NumPy.

The rounds are the simplified Helmert iteration of Förstner (1979). Nothing is imported, as in `decisions`.
"""

from __future__ import annotations

from math import fabs, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mbm.machine.words import Integer, Real

NOISE_ROUNDS = 200
"""Rounds of variance components; each squares away most of the error unless a group has hardly any redundancy."""

SETTLED_FACTORS = 1e-9
"""Relative change of every noise factor that ends the rounds."""

LEAST_REDUNDANCY = 1e-9
"""A group with less redundancy than this is not checked by anything."""

FAINT = 0.05
"""Redundancy of each row of a group beside others' noise, below which a factor that falls may be nothing."""

BETWEEN = 5
"""Rounds after which such a factor is tried as nothing: each makes it smaller by the same share, often a small one."""

NOTHING_LEFT = 0.45
"""Share of the least redundancy that is left of a group that is nothing, twice that where its noise was as large as
that of the others: with a half, rounding would decide whether that is enough."""

AT_LIMIT = 1e-6
"""Relative difference of squares and redundancy where a group is nothing that may be none: beyond rounding."""

BESIDE_ROUNDS = 20
"""Rounds for the other groups while one is tried as nothing: enough for the sign of a slope."""

SHRINKINGS = 3
"""Times that a group which is fitted exactly is made smaller; rows that check one another do so all the same."""

FAR_APART = 100.0
"""Times that the noise a group starts with may be off, by what its rows and others say of the same unknowns."""

SLOW = 0.8
"""Share of a change in the next one from which rounds do not settle by themselves in half of those that there are."""

LONGEST_LEAP = 10.0
"""By how much the end of a sequence of factors may differ from where it is."""

VANISHED = 1e-12
"""A factor that falls below this share of its first value belongs to a group that is fitted exactly."""

TRIED = 2.0
"""By how much noise that nothing tells is made larger, to see what depends on it."""

SAME_COVARIANCES = 1e-9
"""Relative difference up to which two covariances are the same: far above rounding, far below any factor."""

OWN = 0.5
"""The same for noise that is estimated as nothing: what it is due to alone is four times as large with twice the noise,
while the share of it in anything else vanishes with it."""


def noise_ratio(squares: Real, redundancy: Real) -> Real:
    """By how much the noise factor of a group is wrong: ``√(SSE/r)`` of its whitened residuals (Förstner 1979).

    1 where nothing checks the group, or it is fitted exactly.
    """
    if redundancy > LEAST_REDUNDANCY and squares > 0.0:
        return sqrt(squares / redundancy)
    return 1.0


def nothing_left(redundancy: Real) -> Real:
    """By what a factor is multiplied to leave nothing of its group: faint redundancy falls with its square."""
    return min(1.0, sqrt(NOTHING_LEFT * LEAST_REDUNDANCY / max(redundancy, NOTHING_LEFT * LEAST_REDUNDANCY)))


def fading(squares: Real, redundancy: Real, count: Real) -> Real:
    """By what the factor of a group of ``count`` residuals is multiplied to see whether it is nothing; 1: it is not."""
    if redundancy > LEAST_REDUNDANCY and squares < redundancy and redundancy < FAINT * count:
        return nothing_left(redundancy)
    return 1.0


def is_nothing(squares: Real, redundancy: Real) -> Integer:
    """Whether the restricted likelihood has a maximum at 0, where a group is nothing: its slope there falls."""
    return 1 if squares <= redundancy * (1.0 + AT_LIMIT) else 0


def starting(least: Real, most: Real, redundancy: Real, count: Real) -> Real:
    """The factor with which a group starts: 1, unless that is far from the noise of the others.

    ``least`` to ``most`` times as much as other rows its rows tell of the unknowns of both (sums of squares of
    derivatives); ``most`` 0: there are none. ``redundancy``: that of its ``count`` residuals with 1.
    """
    if most > 0.0 and least > FAR_APART * FAR_APART and redundancy < FAINT * count:
        return sqrt(least)
    if most > 0.0 and most < 1.0 / (FAR_APART * FAR_APART):
        return sqrt(most)
    return 1.0


def leap(before: Real, ratio: Real) -> Real:
    """From a factor to the end of its sequence, by its last two ratios (Aitken 1926); 1 if rounds get there."""
    first = before - 1.0
    second = ratio - 1.0
    if first * second > 0.0 and SLOW * fabs(first) < fabs(second) and fabs(second) < fabs(first):
        return min(max(1.0 + second * second / (first - second), 1.0 / LONGEST_LEAP), LONGEST_LEAP)
    return 1.0


def changed(first: Real, second: Real, share: Real, size: Real) -> Integer:
    """Whether two covariances differ by more than a share of the larger, and than rounding of the ``size`` of the root
    of the product of the two variances.
    """
    return 1 if fabs(first - second) > max(share * max(fabs(first), fabs(second)), SAME_COVARIANCES * size) else 0
