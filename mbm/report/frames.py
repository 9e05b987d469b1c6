"""Columns → the tables that Python users get: a pandas frame, else a dict of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.report.intervals import intervals
from mbm.report.row_data import ResidualRow
from mbm.report.types import DerivedValue, Estimate, SolveReport

PROFILE_LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997)
"""Levels of the intervals of a profile."""


def frame(columns: Mapping[str, Any]) -> Any:
    """The columns as a pandas frame, as they are where pandas is not installed."""
    try:
        from pandas import DataFrame
    except ImportError:
        return dict(columns)
    return DataFrame(columns)


def residual_columns(solves: Sequence[SolveReport], clause: str | None) -> Mapping[str, NDArray[Any]]:
    """The residuals of a clause (None: of all), one row for each scalar.

    First the keys of the solves, then ``clause`` (without one), ``row`` and ``file_row`` (NaN where there is none),
    ``component``; the columns of the clause's table; ``raw`` (MODEL − MEASURED), ``whitened``, ``weight``, ``leverage``
    (NaN where unknown), ``used``, ``outlier``. Numbers are in SI. A column that is called as one of these, or as a key,
    is called ``table.NAME``.
    """
    found: dict[str, list[Any]] = {}
    keys = list(dict.fromkeys(name for solve in solves for name in solve.key))
    parts = [(solve, [row for row in solve.rows() if clause in (None, row.clause)]) for solve in solves]
    for name in keys:
        found[name] = [solve.key.get(name) for solve, rows in parts for _ in rows]
    every = [row for _, rows in parts for row in rows]
    if clause is None:
        found["clause"] = [row.clause for row in every]
    found["row"] = [np.nan if row.row is None else row.row for row in every]
    found["file_row"] = [np.nan if row.file_row is None else row.file_row for row in every]
    found["component"] = [row.component for row in every]
    own = {
        "raw": [row.value for row in every],
        "whitened": [row.residual for row in every],
        "weight": [row.weight for row in every],
        "leverage": [np.nan if row.leverage is None else row.leverage for row in every],
        "used": [row.used for row in every],
        "outlier": [row.outlier for row in every],
    }
    columns = {name: np.asarray(values) for name, values in found.items()}
    if clause is not None:
        for name, cells in _cells(parts, clause).items():
            columns[f"table.{name}" if name in found or name in own else name] = cells
    return columns | {name: np.asarray(values) for name, values in own.items()}


def _cells(parts: Sequence[tuple[SolveReport, list[ResidualRow]]], clause: str) -> Mapping[str, NDArray[Any]]:
    """The cells of the columns of a clause's table beside its residuals."""
    found: dict[str, list[NDArray[Any]]] = {}
    for solve, rows in parts:
        data = solve.row_data().get(clause)
        if data is None:
            return {}
        places = np.searchsorted(data.rows, [row.row or 0 for row in rows])
        for name, cells in data.columns.items():
            found.setdefault(name, []).append(cells[places])
    return {name: np.concatenate(cells) for name, cells in found.items()}


def profile_columns(item: Estimate | DerivedValue, place: int) -> Mapping[str, NDArray[Any]]:
    """The intervals of a scalar, by its place in the item, at `PROFILE_LEVELS`, in the unit shown.

    ``level``, ``k`` (the coverage factor), ``low``, ``high``, ``kind``.
    """
    found = [intervals(item, level) for level in PROFILE_LEVELS]
    return {
        "level": np.array(PROFILE_LEVELS),
        "k": np.array([each.k.ravel()[place] for each in found]),
        "low": np.array([each.low.ravel()[place] for each in found]),
        "high": np.array([each.high.ravel()[place] for each in found]),
        "kind": np.array([each.names().ravel()[place] for each in found], dtype=object),
    }
