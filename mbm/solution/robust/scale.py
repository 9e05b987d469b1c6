"""The noise of the units that agree: its variance, free of what cutting off the tails takes from it."""

from __future__ import annotations

import numpy as np

from mbm.solution.robust.units import Units, consistency
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.decisions import LEAST_KEPT, ROUNDED, SECANTS, STATED


def noise_and_limits(
    squares: Floats, inliers: Mask, variances: Floats, units: Units, dimension: int, cut: Floats, reach: Floats | None
) -> tuple[Floats, Floats]:
    """The variance (U,) of the noise, as stated or ``SSE/((n − p) κ)`` of the inliers, and the limits (U,) it has.

    The limits are ``cut`` (U,) times ``variances`` (U,), what a robust scale says; where that leaves out units of a
    group that are ``inliers`` (U,), ``reach`` (U,) times their noise, if that is more (None: never). κ is what normal
    noise has left inside the limits; unknowns are shared out by the number of residuals. Without redundancy
    ``variances`` stay. ``squares`` (U,) are those at the fit to the inliers, all of which are within the limits.
    """
    noise = variances.copy()
    limits = cut * variances
    total = int(units.components[inliers].sum())
    for group in np.unique(units.group[units.group != STATED]).tolist():
        mine = units.group == group
        inside = mine & inliers
        short = reach is not None and bool((squares[inside] > limits[inside]).any())
        wide = reach if short and reach is not None else np.zeros(units.count)
        count = int(units.components[inside].sum())
        freedom = count * (1.0 - dimension / total) if total else 0.0
        if freedom > 0.0:
            least = max(float(units.rounding[inside].max()), 1e-300)
            raw = max(float(squares[inside].sum()) / freedom, least)
            noise[mine] = _untruncated(raw, limits[inside], wide[inside], units.components[inside])
        limits[mine] = np.maximum(limits[mine], wide[mine] * noise[mine])
    return noise, np.where(inliers, np.maximum(limits, squares), limits)


def _untruncated(raw: float, limits: Floats, wide: Floats, components: Indices) -> float:
    """The variance v of the noise whose part inside ``max(limits, wide · v)`` has the variance ``raw``.

    What is left inside, ``v κ(v)``, grows with v: secants, kept inside of what brackets the solution.
    """

    def left(variance: float) -> float:
        kept = consistency(components, np.maximum(limits / variance, wide))
        return max(float((components * kept).sum() / components.sum()), LEAST_KEPT)

    before, off_before = raw, left(raw) - 1.0
    low, high = raw, raw / LEAST_KEPT
    variance = raw / left(raw)
    for _ in range(SECANTS):
        off = variance / raw * left(variance) - 1.0
        low, high = (variance, high) if off <= 0.0 else (low, variance)
        if abs(off) <= ROUNDED or abs(variance - before) <= ROUNDED * variance or off == off_before:
            break
        following = variance - off * (variance - before) / (off - off_before)
        if not low < following < high:
            following = 0.5 * (low + high)
        before, off_before, variance = variance, off, following
    return variance
