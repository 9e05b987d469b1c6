"""Errors of trajectories for programs: the field ``trajectory`` of the result document, and rows for CSV."""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np

from mbm.data.writers import DelimitedLines
from mbm.report.exports import key_cell, key_titles, number_cell
from mbm.report.trajectories.types import DEGREE, Errors, Floats, Segments, Statistics, Trajectory

MAIN = "translation"
"""The part whose numbers stand at the top, as CONTRACT §2 has them; the other parts stand under their names."""


def trajectory_document(found: Trajectory) -> dict[str, Any]:
    """``{"observation", "estimate", "reference", "ape", "rpe", "segments"}``; ``rpe`` is the first of the segments."""
    said = [_segments(each) for each in found.rpe]
    return {
        "observation": found.clause,
        "estimate": found.sides[0].rstrip("."),
        "reference": found.sides[1].rstrip("."),
        "ape": _errors(found.ape),
        "rpe": said[0] if said else None,
        "segments": said,
    }


def _segments(found: Segments) -> dict[str, Any]:
    named = {} if found.name is None else {"pair": found.name}
    return {
        **_errors(found.errors),
        **named,
        "by": found.by,
        "step": found.step,
        "step_unit": found.unit,
        "drift": dict(found.drift()),
    }


def _errors(errors: Errors) -> dict[str, Any]:
    parts = errors.statistics()
    main = _statistics(parts[MAIN])
    return {**main, **{name: _statistics(part) for name, part in parts.items() if name != MAIN}}


def _statistics(found: Statistics) -> dict[str, Any]:
    return {
        "rmse": found.rmse,
        "mean": found.mean,
        "median": found.median,
        "std": found.std,
        "min": found.minimum,
        "max": found.maximum,
        "percentiles": {str(level): value for level, value in found.percentiles.items()},
        "rows": found.rows,
        "unit": found.unit,
    }


def error_rows(trajectories: Sequence[Trajectory]) -> str:
    """One row for each pose, as CSV: keys, row of the table, time, errors of the pose and of the step that ends there.

    Lengths are in the unit of the measurement, rotations in deg. Cells are empty where there is no number.
    """
    stream = StringIO(newline="")
    keys = tuple(trajectories[0].key) if trajectories else ()
    header = ["row", "t", "ape", "ape_rotation", "rpe", "rpe_rotation"]
    lines = DelimitedLines(stream)
    lines.row([*key_titles(keys, set(header)), *header])
    for found in trajectories:
        count = len(found.rows)
        columns = [np.full(count, np.nan) if found.times is None else found.times]
        columns += _columns(found.ape, np.arange(count), count)
        step = found.rpe[0] if found.rpe else None
        columns += [np.full(count, np.nan)] * 2 if step is None else _columns(step.errors, step.end, count)
        own = [key_cell(found.key[name]) for name in keys]
        for row, *cells in zip(found.rows.tolist(), *(column.tolist() for column in columns), strict=True):
            lines.row([*own, str(row), *map(number_cell, cells)])
    return stream.getvalue()


def _columns(errors: Errors, places: np.ndarray, count: int) -> list[Floats]:
    found = []
    for values, factor in ((errors.translation, errors.factor), (errors.rotation, DEGREE)):
        column = np.full(count, np.nan)
        if values is not None:
            column[places] = values / factor
        found.append(column)
    return found
