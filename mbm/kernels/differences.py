"""Derivatives by central differences, for many points at once.

The step of an argument a is h = ε^⅓·max(|a|, `SMALLEST`), with ε the relative noise of the values: a truncation error
of h²f‴/6 and a rounding error of εf/h are then of one size where f varies on the scale of a. Near zero an argument does
not tell its scale, and h is too small: as long as rounding dominates, a step `GROWTH` times as large is tried, up to
ε^⅓·max(|a|, 1), and taken if both derivatives agree within their rounding errors (Lepski's rule: the widest step that
no narrower one contradicts). What is chosen for a point depends on nothing but that point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mbm.kernels.types import Floats

EXACT = float(np.finfo(np.float64).eps)
"""Relative noise of values that are rounded once."""

ROUNDED = EXACT ** (2 / 3)
"""Relative noise of differences of such values."""

SMALLEST = 1e-9
"""The smallest scale that a step is made for, in SI: a nanometre."""

GROWTH = 100.0
GOOD = 27.0
"""Rounding errors up to so many times ε^⅔ of a derivative are left: what steps of the argument's own size give where
the values are not much larger than they vary."""


def differences(function: Callable[[Floats], Floats], points: Floats, wanted: Sequence[int], noise: float) -> Floats:
    """Derivatives (points, n, w) of ``function`` ((p, m) → (p, n)) by the arguments at the positions ``wanted``.

    Args:
        function: values at many points; NaN where there are none, and then there is no derivative.
        points: arguments (points, m).
        wanted: w positions among the arguments.
        noise: relative noise of the values, ε.
    """
    count, w = len(points), len(wanted)
    lines, columns = np.repeat(np.arange(count), w), np.tile(np.asarray(wanted, dtype=np.int64), count)
    size = np.abs(points[lines, columns])
    step = noise ** (1 / 3) * np.maximum(size, SMALLEST)
    largest = noise ** (1 / 3) * np.maximum(size, 1.0)

    def central(some: np.ndarray) -> tuple[Floats, Floats]:
        """Derivatives and their rounding errors (some, n) with the present steps."""
        above, below = points[lines[some]], points[lines[some]]
        own = np.arange(len(some)), columns[some]
        above[own] += step[some]
        below[own] -= step[some]
        width = (above[own] - below[own])[:, None]
        values = function(np.concatenate([above, below]))
        high, low = values[: len(some)], values[len(some) :]
        return (high - low) / width, noise * (np.abs(high) + np.abs(low)) / width

    slopes, errors = central(np.arange(len(lines)))
    open_ones = np.ones(slopes.shape, dtype=bool)
    good = GOOD * noise ** (2 / 3)
    while True:
        open_ones &= errors > good * np.abs(slopes)
        some = np.flatnonzero(open_ones.any(axis=1) & (step < largest))
        if len(some) == 0:
            return np.asarray(slopes.reshape(count, w, -1).swapaxes(1, 2))
        step[some] = np.minimum(step[some] * GROWTH, largest[some])
        wider, smaller = central(some)
        taken = open_ones[some] & (np.abs(wider - slopes[some]) <= errors[some] + smaller)
        slopes[some] = np.where(taken, wider, slopes[some])
        errors[some] = np.where(taken, smaller, errors[some])
        open_ones[some] &= taken
