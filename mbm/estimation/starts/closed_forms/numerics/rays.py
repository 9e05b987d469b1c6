"""Rays from known places → the point where they meet."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats

PARALLEL_RAYS = 1e-12
"""Reciprocal condition of the normal equations below which all rays have one direction."""


def meeting_points(origins: Floats, directions: Floats, weights: Floats | None = None) -> Floats:
    """The points (…, d) that are nearest to all lines ``origins + s · directions`` (…, n, d), directions of length 1.

    Minimises ``Σ w |(1 − d dᵀ)(p − c)|²``; NaN where all lines are parallel.
    """
    d = directions.shape[-1]
    w = np.ones(directions.shape[:-1]) if weights is None else weights
    Q = w[..., None, None] * (np.eye(d) - directions[..., :, None] * directions[..., None, :])
    normal = Q.sum(axis=-3)
    right = np.einsum("...nij,...nj->...i", Q, origins)
    finite = np.isfinite(normal).all(axis=(-2, -1)) & np.isfinite(right).all(axis=-1)
    values = np.linalg.eigvalsh(np.where(finite[..., None, None], normal, 0.0))
    usable = finite & (values[..., 0] > PARALLEL_RAYS * values[..., -1])
    safe = np.where(usable[..., None, None], normal, np.eye(d))
    return np.where(usable[..., None], np.linalg.solve(safe, np.nan_to_num(right)[..., None])[..., 0], np.nan)
