"""The noise of the units that agree: its variance, free of what cutting off the tails takes from it."""

from __future__ import annotations

import numpy as np

from mbm.solution.robust.agree import Agreed
from mbm.solution.robust.units import STATED, Units, consistency
from mbm.solution.types import Floats, Mask

ROUNDS = 20
"""Rounds of variance and truncation in turn; each takes away most of what is left."""


def noise_variances(agreed: Agreed, units: Units, dimension: int) -> Floats:
    """The variance (U,) of the noise: as stated, or ``SSE/((n − p) κ)`` of the inliers with unknown noise.

    κ is what normal noise of that variance has left inside the limits; unknowns are shared out by the number of
    residuals. Without redundancy the robust variance stays.
    """
    found = agreed.variances.copy()
    total = int(units.components[agreed.inliers].sum())
    for group in np.unique(units.group[units.group != STATED]).tolist():
        mine = (units.group == group) & agreed.inliers
        count = int(units.components[mine].sum())
        freedom = count * (1.0 - dimension / total) if total else 0.0
        if freedom > 0.0:
            found[units.group == group] = _variance(agreed, units, mine, freedom)
    return found


def _variance(agreed: Agreed, units: Units, mine: Mask, freedom: float) -> float:
    squares = float(agreed.squares[mine].sum())
    variance = raw = max(squares / freedom, float(units.rounding[mine].max(initial=0.0)), 1e-300)
    for _ in range(ROUNDS):
        left = consistency(units.components[mine], agreed.limits[mine] / variance)
        share = float((units.components[mine] * left).sum() / units.components[mine].sum())
        updated = raw / max(share, 0.1)
        if abs(updated - variance) <= 1e-10 * variance:
            break
        variance = updated
    return variance


def truncation_of(agreed: Agreed, units: Units, variances: Floats) -> Floats:
    """κ (U,): the share of their variance that inliers keep, which their information has to be multiplied by."""
    return consistency(units.components, agreed.limits / variances)
