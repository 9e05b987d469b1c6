"""Points on the outline of a body in an image: what was measured, and the nearest points of the estimated outline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.equations.binding import Group
from mbm.estimation.search.solution import Solution
from mbm.kernels.outlines.measuring import Outlines
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.report.types import Floats, Mask
from mbm.report.view.model_panels import Line
from mbm.report.view.photographs import Photograph, path_of
from mbm.report.view.tracing import ContourSeeing, CurveSeeing, Seen
from mbm.report.view.values import answer_lookup, values_of


def contour_photographs(problem: Problem, solution: Solution, seen: Seen) -> Iterator[Photograph]:
    """The images in which distances from outlines are measured, told apart by the column ``photo``."""
    outlines = Outlines()
    for contour in seen.contours:
        for group in solution.groups:
            if (group.kernel.owner, group.kernel.case) == (contour.block, contour.case) and group.rows:
                yield from _photographs(problem, solution, contour, group, outlines)


@np.errstate(all="ignore")  # where there is no outline, nothing is drawn
def _photographs(
    problem: Problem, solution: Solution, contour: ContourSeeing, group: Group, outlines: Outlines
) -> Iterator[Photograph]:
    table = problem.blocks[contour.block].table
    rows = solution.tables[table] if table is not None else None
    known = answer_lookup(solution, rows, group.positions)
    numbers = values_of(contour.distance.arguments, known, group.rows)
    feet, lines = np.full((group.rows, 2), np.nan), list[tuple[Mask, Line]]()
    for own, found in outlines.traced(contour.outlined, numbers):
        mask = np.zeros(group.rows, dtype=bool)
        mask[own] = True
        feet[own] = found.feet
        lines += [(mask, Line(points=points, hidden=False)) for points in found.lines]
    yield from pictured(solution, rows, group, contour, numbers[:, -2:], feet, lines)


def pictured(
    solution: Solution,
    table: Table | None,
    group: Group,
    seeing: ContourSeeing | CurveSeeing,
    measured: Floats,
    feet: Floats,
    lines: Sequence[tuple[Mask, Line]],
) -> Iterator[Photograph]:
    """One image for each name: points (n, 2), the nearest ones of what they were measured on, and its lines."""
    places = np.arange(group.first, group.first + group.count).reshape(group.rows, -1)[:, seeing.output]
    used = np.ones(group.rows, bool) if solution.weights is None else solution.weights[places] > 0.0
    outlier = np.zeros(group.rows, bool) if solution.outliers is None else solution.outliers[places]
    names = names_of(table, group)
    for name in dict.fromkeys(names.tolist()):
        mask = names == name
        yield Photograph(
            name=name,
            measured=measured[mask],
            predicted=feet[mask],
            covariance=np.full((int(mask.sum()), 2, 2), np.nan),
            used=np.asarray(used[mask]),
            outlier=np.asarray(outlier[mask]),
            lines=tuple(line for own_rows, line in lines if (own_rows & mask).any()),
            labels=("X", "Y") if seeing.upward else ("u", "v"),
            down=not seeing.upward,
            left=seeing.upward,
            path=path_of(table, group.positions, mask),
        )


def names_of(table: Table | None, group: Group) -> np.ndarray:
    """The photograph of each row; without a name where the table names none."""
    column = None if table is None or group.positions is None else table.columns.get("photo")
    if column is None or column.texts is None or group.positions is None:
        return np.full(group.rows, "")
    return np.array([column.texts[int(position)] for position in group.positions])
