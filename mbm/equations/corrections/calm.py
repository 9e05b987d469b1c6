"""Projection onto the model by plain Newton steps: they converge where corrections are small beside the curvature."""

from __future__ import annotations

import numpy as np

from mbm.equations.corrections.steps import curved_up, step
from mbm.equations.corrections.types import Conditions, Feet
from mbm.equations.types import Floats

MOST = 8
"""Steps; where Newton's method goes well it needs three or four from the measured values."""

NEAR = 1e-2
"""… if the last one was as short as this at least."""

LAST = 1e-10
"""The search is over where the next step would be shorter than this, beside 1 + |u| standard deviations."""


def calm_feet(conditions: Conditions, start: Floats, multipliers: Floats) -> Feet | None:
    """The feet that full steps from ``start`` (R, q) lead to, or None where the search needs care.

    Each step must be shorter than half of the one before, and each end a nearest point, not a farthest.
    """
    here, last = start, np.inf
    local = conditions.at(here, multipliers)
    for _ in range(MOST):
        target, multipliers = step(local.slopes, local.curvature, conditions.noisy, local.values, here)
        size = float(np.abs(target - here).max(initial=0.0))
        if not size < 0.5 * last:
            return None
        coming = size * (size / last) ** 2 if last < np.inf else size  # Newton's method converges quadratically
        here, last = target, size
        local = conditions.at(here, multipliers)
        if coming <= LAST * (1.0 + float(np.abs(here).max(initial=0.0))) and size < NEAR:
            break
    else:
        return None
    misclosures = local.values - np.einsum("rkq,rq->rk", local.slopes, here)
    everywhere = np.ones(len(here), dtype=bool)
    if not np.isfinite(misclosures).all():
        return None
    if not curved_up(local.slopes, local.curvature, conditions.noisy, everywhere).all():
        return None
    return Feet(
        corrections=here,
        multipliers=multipliers,
        slopes=local.slopes,
        misclosures=misclosures,
        found=everywhere,
    )
