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

NOTHING_LEFT = 0.5
"""Share of the least redundancy that is left of a group that is nothing."""

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


def fading(squares: Real, redundancy: Real, count: Real) -> Real:
    """By what the factor of a group of ``count`` residuals is multiplied to see whether it is nothing; 1: it is not.

    The restricted likelihood has a maximum at 0 where the squares are less than the redundancy there.
    """
    if redundancy > LEAST_REDUNDANCY and squares < redundancy and redundancy < FAINT * count:
        return sqrt(NOTHING_LEFT * LEAST_REDUNDANCY / redundancy)
    return 1.0


def changed(first: Real, second: Real, share: Real, size: Real) -> Integer:
    """Whether two covariances differ by more than a share of the larger, and than rounding of the ``size`` of the root
    of the product of the two variances.
    """
    return 1 if fabs(first - second) > max(share * max(fabs(first), fabs(second)), SAME_COVARIANCES * size) else 0
