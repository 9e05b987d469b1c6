"""The rows of a clause: what they hold, and their residuals."""

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
