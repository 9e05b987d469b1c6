"""The rows of a clause: what they hold, and their residuals. What pictures are drawn from: data beside the model, and
maps of places and what joins them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.text.types import DataPlace
from mbm.values import dataclass

NoiseReport: TypeAlias = float | Mapping[str, Any] | None
"""A factor; ``{factor, rho}`` or ``{covariance}``, in SI, where rows share noise; None where the noise was stated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualRow:
    """One scalar residual.

    ``row`` is the 1-based row of the unfiltered table (None: the clause has no table), ``file_row`` the row as in the
    file (header = 1), ``component`` counts from 1 within the equation; ``value`` is MODEL − MEASURED in SI,
    ``residual`` the whitened one: the same divided by its standard deviation, or a row of L⁻¹ times all components of
    the equation where its noise is a covariance L Lᵀ; ``weight`` is 1 without a robust loss, 0 if not ``used``;
    ``leverage`` is the share of its own reading in what is fitted to it, from 0 to 1, None where that was not computed.
    """

    clause: str
    row: int | None
    file_row: int | None
    component: int
    value: float
    residual: float
    weight: float
    used: bool
    outlier: bool = False
    leverage: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualSummary:
    """Residuals of one clause: rows there are, rows used, normalised root mean square (None without a used row).

    ``outliers`` are 1-based rows of the unfiltered table, ``outlier_places`` where the same stand in their files, one
    for each, if files have them and tell them apart.
    """

    rows: int
    used: int
    rms: float | None
    outliers: tuple[int, ...] = ()
    outlier_places: tuple[DataPlace, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowData:
    """Columns of the table of a clause: ``rows`` (n,) are numbers of the unfiltered table from 1, ascending.

    ``columns`` have n numbers in SI, or texts, by their names.
    """

    rows: NDArray[np.int64]
    columns: Mapping[str, NDArray[np.float64] | NDArray[np.object_]]


OVER_ROWS, OVER_POINTS, COORDINATE = "row", "point", "coordinate"
"""What the mean of a number is over, and those of a vector."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RootMean:
    """A root mean square of raw residuals in their ``unit`` (None: none is known); ``value`` None: it is not finite.

    ``per`` says over what: ``row`` (of numbers), ``point`` (of the lengths of vectors), ``coordinate`` (of all their
    components), ``coordinate 2`` (of one), ``coordinates 1-3`` (of the lengths of these, which have one unit).
    ``equation`` counts from 1 where the clause has several. ``brief``: tables show it, not documents alone.
    """

    per: str
    value: float | None
    unit: str | None
    equation: int | None = None
    brief: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class RawResiduals:
    """What is said of raw residuals: their root means, and the rows (from 1 in the unfiltered table) that see a point
    behind its camera.
    """

    means: tuple[RootMean, ...] = ()
    behind: tuple[int, ...] = ()


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
