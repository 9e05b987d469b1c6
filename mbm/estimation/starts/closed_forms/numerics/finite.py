"""Which parts of an array are numbers."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask


def finite(array: Floats, axes: int | tuple[int, ...]) -> Mask:
    """Where all entries along ``axes`` are finite."""
    return np.asarray(np.isfinite(array).all(axis=axes), dtype=bool)
