"""Point pairs → the similarity or rigid transform between them (Umeyama, IEEE PAMI 13 (4), 1991)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.rotations import nearest

RANK_TOLERANCE = 1e-10
"""Second singular value of the correlation beside the first, below which points of space lie on a line."""


def aligned(
    source: Floats, target: Floats, weights: Floats | None = None, *, scale: bool
) -> tuple[Floats, Floats, Floats]:
    """``c, R, t`` that minimise ``Σ w |y − (c R x + t)|²`` over ``x`` in ``source``, ``y`` in ``target``.

    ``source`` and ``target`` have shape (…, n, d) with d = 2 or 3, ``weights`` (…, n); c (…), R (…, d, d), t (…, d).
    R is a rotation also where the points are mirrored (Umeyama's determinant rule). NaN where the rotation is not
    determined: equal points, or points of space on one line.
    """
    w = np.ones(source.shape[:-1]) if weights is None else weights
    w = w / w.sum(axis=-1, keepdims=True)
    mean_source = np.einsum("...n,...nd->...d", w, source)
    mean_target = np.einsum("...n,...nd->...d", w, target)
    x, y = source - mean_source[..., None, :], target - mean_target[..., None, :]
    correlation = np.einsum("...n,...ni,...nj->...ij", w, y, x)
    R = nearest(correlation)
    values = np.linalg.svd(np.nan_to_num(correlation), compute_uv=False)
    decisive = values[..., -2]
    spread = np.sqrt(np.einsum("...n,...nd,...nd->...", w, x, x) * np.einsum("...n,...nd,...nd->...", w, y, y))
    with np.errstate(invalid="ignore", divide="ignore"):
        determined = (decisive > RANK_TOLERANCE * spread) & (spread > 0)
        if scale:
            c = np.einsum("...ij,...ij->...", R, correlation) / np.einsum("...n,...nd,...nd->...", w, x, x)
            determined &= c > 0
        else:
            c = np.ones(source.shape[:-2])
    c = np.where(determined, c, np.nan)
    R = np.where(determined[..., None, None], R, np.nan)
    t = mean_target - c[..., None] * np.einsum("...ij,...j->...i", R, mean_source)
    return c, R, t


def turned(source: Floats, target: Floats, weights: Floats | None = None) -> Floats:
    """R (…, d, d) that minimises ``Σ w |y − R x|²`` over directions or vectors x, y (…, n, d) (Wahba's problem).

    NaN where the rotation is not determined: in space, all vectors along one line.
    """
    w = np.ones(source.shape[:-1]) if weights is None else weights
    correlation = np.einsum("...n,...ni,...nj->...ij", w, target, source)
    values = np.linalg.svd(np.nan_to_num(correlation), compute_uv=False)
    decisive = values[..., 1] if source.shape[-1] == 3 else values[..., 0]
    determined = (decisive > RANK_TOLERANCE * values[..., 0]) & (values[..., 0] > 0)
    return np.where(determined[..., None, None], nearest(correlation), np.nan)
