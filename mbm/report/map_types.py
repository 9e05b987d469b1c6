"""What pictures are drawn from: data beside the model, and maps of places and what joins them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """Places of families that measurements join, in SI: of poses, and of vectors.

    ``places`` (n, d), d = 2 or 3, with covariances ``spreads`` (n, d, d), NaN where they are not known; ``moving``
    (n,) are the poses, the others landmarks. ``edges`` (m, 2) join places, ``residuals`` (m,) are the root mean squares
    of their normalised residuals, ``next_to`` (m,) marks those between neighbours in the order of keys.
    """

    name: str
    unit: str
    places: NDArray[np.float64]
    spreads: NDArray[np.float64]
    moving: NDArray[np.bool_]
    edges: NDArray[np.int64]
    residuals: NDArray[np.float64]
    next_to: NDArray[np.bool_]
