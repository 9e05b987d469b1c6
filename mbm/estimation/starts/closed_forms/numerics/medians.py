"""Points among which some are wrong: random samples, and the one with the least median of squares (Rousseeuw 1984)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices, Mask

SAMPLES = 100
"""Samples of at most four points: with 30 % wrong ones, one is right but in one of 10¹¹ cases."""

APART = 4.0
"""Distance, in medians of all, beyond which a point is wrong: 4.7 standard deviations of normal noise in a plane."""

LEAST = 8
"""Points from which on the median tells wrong ones."""


def contaminated(squares: Floats) -> bool:
    """Whether some squared misfits (n,) stand out so far that the fit must not be trusted."""
    return len(squares) >= LEAST and not bool(squares.max() <= APART**2 * np.median(squares))


def samples_of(count: int, size: int) -> Indices:
    """Random samples (k, size) of ``count`` points, the same ones at each call."""
    every = np.tile(np.arange(count), (SAMPLES, 1))
    return np.asarray(np.random.default_rng(0).permuted(every, axis=1)[:, :size])


def agreeing(squares: Floats) -> Mask:
    """Which points agree with the fit whose squared misfits, of those of all fits (k, n), have the least median."""
    best = squares[int(np.argmin(np.median(squares, axis=1)))]
    return np.asarray(best <= APART**2 * np.median(best))
