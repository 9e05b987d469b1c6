"""Photographs: the measurements of one image together, with what a camera sees of the bodies in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.problem.tables import Table
from mbm.report.types import Floats, Mask
from mbm.report.view.hidden import MOST_STROKES, Faces, worth_drawing
from mbm.report.view.images import ImageRows, answer_lookup, right_up_forward, values_of
from mbm.report.view.model_panels import Line
from mbm.report.view.rays import placed_by_rays
from mbm.report.view.seeings import Sight
from mbm.report.view.solids import solid_of
from mbm.report.view.types import Solid
from mbm.report.view.viewpoint import outlines
from mbm.text.types import MbmError
from mbm.values import dataclass

NEAREST = 1e-3
"""Depth, as a share of the greatest, before which nothing of a body is drawn."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photograph:
    """Image points (n, 2) measured and predicted, covariances (n, 2, 2) of the predictions, and lines of bodies.

    ``measured_lines`` hold two points (2, 2) each.
    ``labels`` are the columns that hold the two coordinates, ``down`` tells whether the second grows downward and
    ``left`` whether the first grows to the left. ``file`` is the name of the photograph's file, if the data name one;
    ``path`` that of the photograph itself, if the data were read from it.
    """

    name: str
    measured: Floats
    predicted: Floats
    covariance: Floats
    used: Mask
    outlier: Mask
    lines: tuple[Line, ...]
    labels: tuple[str, str]
    down: bool
    left: bool
    file: str | None = None
    path: Path | None = None
    measured_lines: tuple[Floats, ...] = ()


def photographs(rows: Sequence[ImageRows], solution: Solution, library: frozenset[str]) -> tuple[Photograph, ...]:
    """All images, in the order of their numbers, or of the rows that speak of them."""
    cameras = {row.sight.camera.name for row in rows if row.sight.camera is not None}
    groups: dict[str, list[tuple[ImageRows, Mask]]] = {}
    for row in rows:
        names = np.array(row.photo)
        camera = row.sight.camera.name if row.sight.camera is not None and len(cameras) > 1 else ""
        for name in dict.fromkeys(row.photo):
            groups.setdefault(" ".join(filter(None, (camera, name))), []).append((row, names == name))
    order = sorted(groups, key=int) if all(name.isdecimal() for name in groups) else list(groups)
    return tuple(_photograph(name, groups[name], solution, library) for name in order)


def together(found: Sequence[Photograph]) -> tuple[Photograph, ...]:
    """The photographs, those of one name as one."""
    made: dict[str, Photograph] = {}
    for each in found:
        known = made.get(each.name)
        made[each.name] = each if known is None else _united(known, each)
    return tuple(made.values())


def _united(a: Photograph, b: Photograph) -> Photograph:
    return replace(
        a,
        measured=np.concatenate([a.measured, b.measured]),
        predicted=np.concatenate([a.predicted, b.predicted]),
        covariance=np.concatenate([a.covariance, b.covariance]),
        used=np.concatenate([a.used, b.used]),
        outlier=np.concatenate([a.outlier, b.outlier]),
        lines=(*a.lines, *b.lines),
        measured_lines=(*a.measured_lines, *b.measured_lines),
        path=a.path or b.path,
    )


def _photograph(
    name: str, parts: Sequence[tuple[ImageRows, Mask]], solution: Solution, library: frozenset[str]
) -> Photograph:
    first = parts[0][0]
    known: set[bytes] = set()
    lines = [line for row, mask in parts for line in _body_lines(row, mask, solution, library, known)]
    paper = first.sight.axes == "paper"
    placed = placed_by_rays(first, parts[0][1], solution) if first.sight.family is not None else None
    return Photograph(
        name=name,
        measured=np.concatenate([row.measured[mask] for row, mask in parts]),
        predicted=np.concatenate([row.predicted[mask] for row, mask in parts]),
        covariance=np.concatenate([row.covariance[mask] for row, mask in parts]),
        used=np.concatenate([row.used[mask] for row, mask in parts]),
        outlier=np.concatenate([row.outlier[mask] for row, mask in parts]),
        lines=tuple(lines),
        labels=("X", "Y") if paper else ("u", "v"),
        down=first.sight.axes == "opencv" if placed is None else placed.down,
        left=paper,
        file=_file(first, parts[0][1]),
        path=path_of(first.table, first.positions, parts[0][1]),
    )


def _file(row: ImageRows, mask: Mask) -> str | None:
    """The cell of the column ``photo`` or ``image``, where that is a text that names a file."""
    if row.table is None or row.positions is None:
        return None
    for name in ("photo", "image"):
        column = row.table.columns.get(name)
        if column is not None and column.texts is not None:
            text = column.texts[int(row.positions[mask][0])]
            if "." in text:
                return text
    return None


def path_of(table: Table | None, positions: np.ndarray | None, mask: Mask) -> Path | None:
    """The image that the rows of a mask were read from."""
    if table is None or positions is None:
        return None
    source = table.source(int(positions[mask][0]))
    return None if source.pixels is None else Path(source.path)


def _body_lines(
    row: ImageRows, mask: Mask, solution: Solution, library: frozenset[str], known: set[bytes]
) -> Iterator[Line]:
    """What the camera sees of the body that the features of some rows belong to, unless that is ``known``."""
    body = row.sight.body
    if body is None:
        return
    positions = None if row.positions is None else row.positions[mask][:1]
    try:
        solid = solid_of(body, row.clause, library, answer_lookup(solution, row.table, positions))
    except MbmError:  # a body whose size differs from row to row
        return
    shape = np.round(np.concatenate([stroke.points for stroke in solid.strokes] or [np.zeros((0, 3))]), 9).tobytes()
    if shape in known:
        return
    known.add(shape)
    yield from image_lines(solid, row.sight, solution, row, positions)


def image_lines(
    solid: Solid, sight: Sight, solution: Solution, row: ImageRows, positions: np.ndarray | None
) -> Iterator[Line]:
    """The lines of a solid in the frame of a camera as its image shows them, hidden parts told apart.

    Seen through a lens, x/depth, y/depth and 1/depth are a parallel projection: planes stay planes, and what is nearer
    is higher.
    """
    frame = right_up_forward(sight.axes)
    lo, hi = solid.bounds()
    nearest = NEAREST * float(np.abs(np.stack([lo, hi])).max())

    def flattened(points: Floats) -> Floats:
        turned = points @ frame.T
        depth = turned[..., 2:]
        return np.concatenate([turned[..., :2] / depth, 1.0 / depth], axis=-1)

    def before(points: Floats) -> bool:
        return bool(((points @ frame[2]) > nearest).all())

    def image(points: Floats) -> Floats:
        depth = 1.0 / points[:, 2:]
        space = np.concatenate([points[:, :2] * depth, depth], axis=1) @ frame
        given = dict(zip(sight.ray, space.T, strict=True))
        known = answer_lookup(solution, row.table, positions, given)
        return values_of(sight.lens, known, len(space))

    patches = [flattened(p) for p in solid.patches if before(p)]
    faces = Faces([flattened(f) for f in solid.faces if before(f)], patches)
    many = len(solid.strokes) > MOST_STROKES
    for stroke in worth_drawing(solid.strokes, np.negative):
        if before(stroke.points):
            for each in faces.stretches(flattened(stroke.points)):
                if not (many and each.hidden):
                    yield Line(points=image(_finer(each.points)), hidden=each.hidden)
    for patch in patches:
        for outline in outlines(patch):
            for each in faces.stretches(outline, outline=True):
                yield Line(points=image(each.points), hidden=each.hidden)


def _finer(points: Floats, parts: int = 8) -> Floats:
    """A line cut finer, so that a lens may bend it."""
    if len(points) > parts:
        return points
    share = np.linspace(0.0, 1.0, parts + 1)[:-1, None]
    cut = [a + share * (b - a) for a, b in pairwise(points)]
    return np.concatenate([*cut, points[-1:]])
