"""Points near the image of a curve: what was measured, and the nearest places of the curve at the estimates.

Their distance d is a formula of the point p alone, and its derivative by p the unit vector along the way to the foot:
the foot is p − d ∇d, beside the ends of the curve too.

Points on the outline of a body in an image: what was measured, and the nearest points of the estimated outline.

Lines in images: those that were measured, as (α, ρ), and the edges that the answer predicts, from end to end. Both ends
of a predicted edge stand beside their feet on the measured line: what they are apart is what α and ρ say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.equations.binding import Group
from mbm.estimation.search.solution import Solution
from mbm.kernels.outlines.measuring import Outlines
from mbm.problem.rows import Positions
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.report.types import Floats, Mask
from mbm.report.view.images import answer_lookup, values_of, with_groups
from mbm.report.view.model_panels import Line
from mbm.report.view.photographs import Photograph, path_of
from mbm.report.view.seeings import ContourSeeing, CurveSeeing, LineSeeing, Seen

ASIDE = 1e-4
"""Of central differences, as a share of the spread of the points: rounding and what is left are below 1e-7 of it."""

PROLONGED = 0.2
"""Of an edge's length: how far its measured line is drawn beyond either end, to be told from the edge."""

FINE = 4
"""Parts that a chord of a curve is drawn in."""


def curve_photographs(problem: Problem, solution: Solution, seen: Seen) -> Iterator[Photograph]:
    """The images in which distances from curves are measured, told apart by the column ``photo``."""
    for seeing, group, rows in with_groups(problem, solution, seen.curves):
        measured = values_of(seeing.point, answer_lookup(solution, rows, group.positions), group.rows)
        feet = _feet(solution, rows, seeing, group, measured)
        names = names_of(rows, group)
        lines: list[tuple[np.ndarray, Line]] = []
        for name in dict.fromkeys(names.tolist()):
            first = int(np.flatnonzero(names == name)[0])
            positions = None if group.positions is None else group.positions[first : first + 1]
            lines += [(names == name, line) for line in _lines(solution, rows, seeing, positions)]
        yield from pictured(solution, rows, group, seeing, measured, feet, lines)


def _feet(solution: Solution, table: Table | None, seeing: CurveSeeing, group: Group, points: Floats) -> Floats:
    def distances(x: Floats, y: Floats) -> Floats:
        given = dict(zip(seeing.place, (x, y), strict=True))
        return values_of((seeing.distance,), answer_lookup(solution, table, group.positions, given), group.rows)[:, 0]

    x, y = points.T
    step = ASIDE * max(float(np.ptp(points, axis=0).max()), 1e-9)
    slopes = [distances(x + step, y) - distances(x - step, y), distances(x, y + step) - distances(x, y - step)]
    ways = np.stack(slopes, axis=1) / (2 * step)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return np.asarray(points - distances(x, y)[:, None] * ways)


def _lines(solution: Solution, table: Table | None, seeing: CurveSeeing, positions: Positions | None) -> Iterator[Line]:
    """The pieces of the curve as one row sees it, without what is out of sight."""
    curve = seeing.curve
    known = answer_lookup(solution, table, positions)
    for piece in curve.pieces:
        first, last = values_of((piece.first, piece.last), known, 1)[0]
        at = np.linspace(first, last, FINE * curve.chords + 1)
        here = answer_lookup(solution, table, positions, {curve.parameter: at})
        points = values_of(piece.point, here, len(at))
        if piece.seen is not None:
            points = points[values_of((piece.seen,), here, len(at))[:, 0] >= 0.0]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) > 1:
            yield Line(points=points, hidden=False)


def contour_photographs(problem: Problem, solution: Solution, seen: Seen) -> Iterator[Photograph]:
    """The images in which distances from outlines are measured, told apart by the column ``photo``."""
    outlines = Outlines()
    for contour, group, rows in with_groups(problem, solution, seen.contours):
        known = answer_lookup(solution, rows, group.positions)
        numbers = values_of(contour.distance.arguments, known, group.rows)
        feet, lines = np.full((group.rows, 2), np.nan), list[tuple[Mask, Line]]()
        for own, found in outlines.traced(contour.outlined, numbers):
            mask = np.zeros(group.rows, dtype=bool)
            mask[own] = True
            feet[own] = found.feet
            lines += [(mask, Line(points=points, hidden=False)) for points in found.lines]
        yield from pictured(solution, rows, group, contour, numbers[:, -2:], feet, lines)


def line_photographs(problem: Problem, solution: Solution, seen: Seen) -> Iterator[Photograph]:
    """The images in which lines are measured, told apart by the column ``photo``."""
    for seeing, group, rows in with_groups(problem, solution, seen.lines):
        known = answer_lookup(solution, rows, group.positions)
        alpha, rho = values_of(seeing.measured, known, group.rows).T
        ends = values_of((*seeing.ends[0], *seeing.ends[1]), known, group.rows).reshape(-1, 2, 2)
        normals = np.stack([-np.sin(alpha), np.cos(alpha)], axis=1)
        away = np.einsum("nki,ni->nk", ends, normals) - rho[:, None]
        feet = ends - away[..., None] * normals[:, None]
        beyond = PROLONGED * (feet[:, 1] - feet[:, 0])
        drawn = np.stack([feet[:, 0] - beyond, feet[:, 1] + beyond], axis=1)
        own = np.eye(group.rows, dtype=bool)
        edges = [(mask, Line(points=each, hidden=False)) for mask, each in zip(own, ends, strict=True)]
        yield from pictured(solution, rows, group, seeing, feet, ends, edges, drawn)


def pictured(
    solution: Solution,
    table: Table | None,
    group: Group,
    seeing: ContourSeeing | CurveSeeing | LineSeeing,
    measured: Floats,
    feet: Floats,
    lines: Sequence[tuple[Mask, Line]],
    measured_lines: Floats | None = None,
) -> Iterator[Photograph]:
    """One image for each name: points (n, 2), or (n, k, 2) with k of each row, the nearest ones of what they were
    measured on, its lines, and those (n, 2, 2) that were measured, one of each row.
    """
    outputs = 2 if isinstance(seeing, LineSeeing) else 1
    places = np.arange(group.first, group.first + group.count).reshape(group.rows, -1)[:, seeing.at.output :][
        :, :outputs
    ]
    used, outlier = np.ones(places.shape, bool), np.zeros(places.shape, bool)
    if solution.weights is not None:
        used = solution.weights[places] > 0.0
    if solution.outliers is not None:
        outlier = solution.outliers[places]
    names = names_of(table, group)
    for name in dict.fromkeys(names.tolist()):
        mask = names == name
        points = measured[mask].reshape(-1, 2)
        each = len(points) // int(mask.sum())
        yield Photograph(
            name=name,
            measured=points,
            predicted=feet[mask].reshape(-1, 2),
            covariance=np.full((len(points), 2, 2), np.nan),
            used=np.repeat(used[mask].all(axis=1), each),
            outlier=np.repeat(outlier[mask].any(axis=1), each),
            lines=tuple(line for own_rows, line in lines if (own_rows & mask).any()),
            measured_lines=() if measured_lines is None else tuple(measured_lines[mask]),
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
