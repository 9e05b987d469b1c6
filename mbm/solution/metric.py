"""The scale of each coordinate: by how much the residuals feel it, or else the constraints."""

from __future__ import annotations

import numpy as np

from mbm.solution.solvers.scaled import column_norms
from mbm.solution.types import Floats


def metric(jacobian: Floats, slopes: Floats) -> Floats:
    """The scale of each coordinate (n,) > 0: the norm of its column; where that is zero, from the constraints."""
    scale = column_norms(jacobian)
    felt = scale > 0.0
    if not bool(felt.all()):
        sizes = np.abs(slopes)
        known = np.sqrt(np.square(np.divide(slopes, scale, out=np.zeros_like(slopes), where=felt)).sum(axis=1))
        known = np.where(known > 0.0, known, sizes.max(axis=1, initial=0.0))
        shares = sizes / np.where(known > 0.0, known, 1.0)[:, None]
        scale = np.where(felt, scale, shares.max(axis=0, initial=0.0))
    return np.where((scale > 0.0) & np.isfinite(scale), scale, 1.0)
