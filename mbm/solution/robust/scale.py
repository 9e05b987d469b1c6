"""The noise of the units that agree: its variance, free of what cutting off the tails takes from it."""

from __future__ import annotations

import numpy as np

from mbm.solution.robust.units import STATED, Units, consistency
from mbm.solution.types import Floats, Indices, Mask

ROUNDS = 20
"""Rounds of variance and truncation in turn; each takes away most of what is left."""


def noise_variances(squares: Floats, limits: Floats, variances: Floats, units: Units, dimension: int) -> Floats:
    """The variance (U,) of the noise: as stated, or ``SSE/((n − p) κ)`` of the inliers with unknown noise.

    ``squares`` (U,) at the fit are inside ``limits`` (U,) for inliers. κ is what normal noise of that variance has left
    inside the limits; unknowns are shared out by the number of residuals. Without redundancy ``variances`` (U,) stay.
    """
    found = variances.copy()
    inliers = squares <= limits
    total = int(units.components[inliers].sum())
    for group in np.unique(units.group[units.group != STATED]).tolist():
        mine = (units.group == group) & inliers
        count = int(units.components[mine].sum())
        freedom = count * (1.0 - dimension / total) if total else 0.0
        if freedom > 0.0:
            least = max(float(units.rounding[mine].max()), 1e-300)
            raw = max(float(squares[mine].sum()) / freedom, least)
            found[units.group == group] = _untruncated(raw, limits, units.components, mine)
    return found


def _untruncated(raw: float, limits: Floats, components: Indices, mine: Mask) -> float:
    """The variance of the noise whose part inside the limits has the variance ``raw``."""
    variance = raw
    for _ in range(ROUNDS):
        left = consistency(components[mine], limits[mine] / variance)
        share = float((components[mine] * left).sum() / components[mine].sum())
        updated = raw / max(share, 0.1)
        if abs(updated - variance) <= 1e-10 * variance:
            break
        variance = updated
    return variance


def information_left(limits: Floats, variances: Floats, units: Units) -> Floats:
    """κ (U,): the share of their variance that inliers keep, which their information has to be multiplied by."""
    return consistency(units.components, limits / variances)
