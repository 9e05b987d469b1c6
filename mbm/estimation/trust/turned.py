"""Angles and rotations that are known no better than if nothing were known of them."""

from __future__ import annotations

from functools import partial

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Indices
from mbm.estimation.trust import faults
from mbm.estimation.trust.fits import Said
from mbm.problem.manifold import Piece

ANY_TURN = np.pi / np.sqrt(3.0)
"""The standard deviation of an angle of which nothing is known, rad: that of the uniform distribution on a turn."""


def turned_anyhow(layout: Layout, free: Indices, sigma: Floats) -> Said:
    """The warnings about K solves whose free coordinates have the standard deviations ``sigma`` (K, n)."""
    turning = layout.angle.copy()
    for curved in layout.curved:
        turning[curved.coordinates] |= curved.piece in (Piece.QUATERNION, Piece.SPHERE)
    wide = turning[free] & np.isfinite(sigma) & (sigma > ANY_TURN)
    for place in np.flatnonzero(wide.any(axis=1)).tolist():
        for entry in layout.entries:
            mine = wide[place] & (free >= entry.coordinates.start) & (free < entry.coordinates.stop)
            if mine.any():
                names = [layout.name(each) for each in free[mine].tolist()]
                widest = float(sigma[place][mine].max())
                yield place, partial(faults.any_turn, entry.unknown.span, names, widest)
