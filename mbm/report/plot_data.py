"""What pictures are drawn from: data beside the model, and maps of places and what joins them."""

from __future__ import annotations

from typing import TypeAlias

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


Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A smooth line for a picture: ``values`` (m, c) over ``abscissa`` (m,), which ascends or descends.

    ``band`` (2, m) are the ends of the intervals of its only column at ``coverage``, ``reading`` those of new readings
    (None: not known).
    """

    abscissa: Floats
    values: Floats
    band: Floats | None = None
    reading: Floats | None = None
    coverage: float = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlotData:
    """Data against model for a picture: ``measured`` and ``model`` (n, c) over ``abscissa`` (n,), c = 1 or 2.

    Numbers are as they are to be shown; ``abscissa_label`` and ``labels`` (c of them) name the columns, with units if
    they have any. With c = 2 and no abscissa the two columns are drawn against each other. ``curve`` is the model
    between the rows and beyond them (None: it is known in the rows only); of a derived quantity n = 0.
    """

    clause: str
    measured: Floats
    model: Floats
    labels: tuple[str, ...]
    abscissa: Floats | None = None
    abscissa_label: str | None = None
    curve: Curve | None = None
