"""What a picture of data against a model is drawn from."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.values import dataclass

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
