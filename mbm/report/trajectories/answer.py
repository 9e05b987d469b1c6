"""What ``mbm trajectory`` answers: the result of the solve, and the errors of its trajectories, for
documents and CSV.

Problems that leave nothing to estimate: both trajectories are compared as they are, or at a stated alignment.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np

from mbm.data.writers import DelimitedLines
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import layout
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.report.document import document
from mbm.report.exports import key_cell, key_titles, number_cell
from mbm.report.trajectories import faults
from mbm.report.trajectories.sides import Place
from mbm.report.trajectories.trajectory import trajectory
from mbm.report.trajectories.types import DEGREE, Errors, Floats, Segments, Statistics, Trajectory
from mbm.report.types import Result, ResultStatus
from mbm.text.types import MbmError
from mbm.values import dataclass


def known_place(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> Place | None:
    """Where a problem stands all of whose unknowns are fixed; None for any other, which has to be solved."""
    request = found.problem.request
    if any(u.fixed is None for u in found.problem.unknowns) or request.for_each or request.window is not None:
        return None
    starts = {name: np.asarray(given, dtype=np.float64) for name, given in found.starts.items()}
    places = layout(found.problem, found.tables, starts)
    if not bool(places.fixed.all()) or not bool(np.isfinite(places.start).all()):
        return None
    binder = Binder(problem=found.problem, layout=places, tables=found.tables, cache=cache)
    return Place(
        problem=found.problem,
        groups=binder.equations(kernels),
        layout=places,
        numbers=places.start,
        tables=found.tables,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryAnswer:
    """The errors of the trajectories of each solve.

    ``result`` is that of the solve; it has no solves where nothing was to be estimated, as the alignment is known.
    """

    result: Result
    trajectories: tuple[Trajectory, ...]

    @property
    def status(self) -> ResultStatus:
        """That of the solve; ``ok`` where nothing was to be solved."""
        return self.result.status if self.result.solves else ResultStatus.OK

    def document(self) -> dict[str, Any]:
        """The result document, each solve with its ``trajectory``."""
        found = document(self.result)
        found["status"] = self.status.value
        solves: list[dict[str, Any]] = found["solves"] or [{"key": {}}]
        for solve, each in zip(solves, self.trajectories, strict=True):
            solve["trajectory"] = trajectory_document(each)
        found["solves"] = solves
        return found


def trajectories_of(
    result: Result, deltas: Sequence[str] = (), observation: str | None = None
) -> tuple[Trajectory, ...]:
    """The errors of each solve of a result; arguments and errors as `trajectory` has them."""
    found = []
    for solve in result.solves:
        if solve.made_from is None:
            raise MbmError(faults.without_equations())
        problem, solution = solve.made_from()
        place = Place(
            problem=problem,
            groups=solution.groups,
            layout=solution.layout,
            numbers=solution.numbers,
            tables=solution.tables,
        )
        with solution.lock:
            found.append(trajectory(place, solve.key, deltas, observation))
    return tuple(found)


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
