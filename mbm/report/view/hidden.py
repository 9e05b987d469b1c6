"""Which parts of lines are hidden behind faces: lines are cut where they may disappear, each piece is tested once.

All points are in the frame of the picture: x to the right, y up, z toward the viewer; the projection is parallel, so
that a face hides what lies below it along z. A line is cut exactly where it crosses the boundary of a plane face or
passes through one; over smooth patches, which are seen as facets, in steps (Appel 1967, in its plainest form).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from mbm.equations.types import Indices
from mbm.report.types import Floats, Mask
from mbm.report.view.solids import newell
from mbm.report.view.types import Stroke
from mbm.values import dataclass

STEPS = 160
"""Steps across the whole picture in which lines over smooth patches are cut."""

FLUSH = 1e-6
"""Depth, as a share of the picture's size, within which a line counts as lying in a plane face."""

ROUGH = 0.03
"""Depth, as a share of a facet's longest side, by which a curve may lie within those of its surface."""

_SLIVER = 1e-9
"""Area, as a share of the picture's, below which a face is seen edge on."""

STRAIGHT = 1e-6
"""Sine of the angle between steps below which a line goes straight on."""

_SPECK = 2
"""Steps over which a line over smooth patches is neither hidden nor seen on its own."""

_PAIRS = 4_000_000
"""Points times facets that are compared in one go."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """A part of a line: points (n, 3), and whether it is hidden."""

    points: Floats
    hidden: bool


class Faces:
    """Faces that hide lines: plane polygons (k, 3), and the cells of smooth patches (n, m, 3).

    ``edges`` (e, 2, 3) are the sides of all faces, those of one together.
    """

    def __init__(self, polygons: Sequence[Floats], patches: Sequence[Floats]) -> None:
        cells = np.concatenate([np.zeros((0, 3, 3)), *map(_cells, patches)])
        points = [*polygons, cells.reshape(-1, 3)]
        self.size = float(np.ptp(np.vstack(points), axis=0).max()) if sum(map(len, points)) else 0.0
        self.count = len(polygons) + len(cells)
        sides = [_sides(p) for p in polygons]
        self.edges = np.concatenate([np.zeros((0, 2, 3)), *sides, _sides(cells).reshape(-1, 2, 3)])
        self._sides = np.array([len(p) for p in polygons] + [3] * len(cells), dtype=np.int64)
        self._first = np.cumsum(self._sides) - self._sides
        crosses = np.cross(cells[:, 1] - cells[:, 0], cells[:, 2] - cells[:, 0])
        self._normals = np.concatenate([np.array([newell(p) for p in polygons]).reshape(-1, 3), crosses])
        self._corners = self.edges[self._first, 0]
        lengths = np.linalg.norm(_sides(cells)[..., 1, :] - _sides(cells)[..., 0, :], axis=2)
        longest, shortest = lengths.max(axis=1, initial=0.0), lengths.min(axis=1, initial=np.inf)
        flush = np.full(len(polygons), FLUSH * self.size)
        self._slack = np.concatenate([flush, ROUGH * longest])
        self._outline_slack = np.concatenate([flush, np.maximum(shortest, 0.1 * longest)])
        self._smooth = np.arange(self.count) >= len(polygons)
        ends = self.edges[:, 0]
        self._lo, self._hi = (f.reduceat(ends, self._first) if self.count else ends for f in (np.minimum, np.maximum))
        self._seen = np.abs(self._normals[:, 2]) > _SLIVER * self.size**2

    def stretches(self, line: Floats, *, outline: bool = False) -> Iterator[Stretch]:
        """The visible and hidden parts of a line through points (n, 3), in their order.

        An ``outline`` runs where facets of its own surface turn away: those within a facet's size do not hide it.
        """
        near = self._near(line)
        line = self._cut(line, near)
        if len(line) < 2:
            return
        hidden = self.hides((line[1:] + line[:-1]) / 2, near, outline=outline)
        if bool((near & self._smooth).any()):
            hidden = _without_specks(hidden)
        ends = np.flatnonzero(np.diff(hidden)) + 1
        for first, last in zip([0, *ends.tolist()], [*ends.tolist(), len(hidden)], strict=True):
            yield Stretch(points=_bends(line[first : last + 1]), hidden=bool(hidden[first]))

    def hides(self, points: Floats, among: Mask | None = None, *, outline: bool = False) -> Mask:
        """Which of points (n, 3) lie behind a face (one of ``among``)."""
        chosen = np.flatnonzero(self._near(points) if among is None else among)
        result = np.zeros(len(points), dtype=bool)
        if not len(chosen):
            return result
        slack = (self._outline_slack if outline else self._slack)[chosen]
        step = max(_PAIRS // len(chosen), 1)
        for first in range(0, len(points), step):
            part = slice(first, first + step)
            result[part] = self._covered(points[part], chosen, slack)
        return result

    def _near(self, points: Floats) -> Mask:
        """Faces whose bounds in the picture meet those of ``points``, and that reach above the lowest of them."""
        lo, hi = points.min(axis=0), points.max(axis=0)
        meet = (self._lo[:, :2] <= hi[:2]).all(axis=1) & (self._hi[:, :2] >= lo[:2]).all(axis=1)
        return np.asarray(self._seen & meet & (self._hi[:, 2] > lo[2]), dtype=bool)

    def _covered(self, points: Floats, chosen: Indices, slack: Floats) -> Mask:
        """Points inside a face as it is seen, with its plane above them."""
        corners, normals = self._corners[chosen], self._normals[chosen]
        depth = corners[:, 2] - ((points[:, None, :2] - corners[:, :2]) * normals[:, :2]).sum(-1) / normals[:, 2]
        inside = self._inside(points, chosen)
        return np.asarray((inside & (depth > points[:, None, 2] + slack)).any(axis=1))

    def _inside(self, points: Floats, chosen: Indices) -> Mask:
        """Whether points (n, 3) lie in faces (f,) in the picture, by the parity of sides to their right: (n, f).

        Of two faces with a common side, a point on it lies in one.
        """
        counts = self._sides[chosen]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        edges = self.edges[np.repeat(self._first[chosen] - first, counts) + np.arange(counts.sum()), :, :2]
        swapped = edges[:, 0, 1] > edges[:, 1, 1]
        edges[swapped] = edges[swapped, ::-1]  # the same numbers whichever way the side is run through
        (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
        x, y = points[:, :1], points[:, 1:2]
        with np.errstate(all="ignore"):
            crossed = (y0 <= y) & (y < y1) & (x < x0 + (y - y0) * ((x1 - x0) / (y1 - y0)))
        return np.asarray(np.add.reduceat(crossed, first, axis=1, dtype=np.int64) % 2 == 1)

    def _cut(self, line: Floats, near: Mask) -> Floats:
        """The line with more points: where it may vanish behind, or pass through, a face."""
        steps = np.diff(line, axis=0)
        parts = []
        boundary = self.edges[np.repeat(near & ~self._smooth, self._sides)]
        smooth = bool((near & self._smooth).any())
        plain = np.flatnonzero(near & ~self._smooth)
        for start, step in zip(line[:-1], steps, strict=True):
            shares = [_crossings(start, step, boundary), self._piercings(start, step, plain)]
            if smooth:
                count = int(np.ceil(np.hypot(*step[:2]) / (self.size / STEPS)))
                shares.append(np.arange(1, count) / count)
            inner = np.unique(np.concatenate(shares))
            inner = inner[np.diff(inner, prepend=0.0) > 1e-9]
            parts.append(start + np.concatenate([[0.0], inner])[:, None] * step)
        return np.concatenate([*parts, line[-1:]]) if parts else line

    def _piercings(self, start: Floats, step: Floats, plain: Indices) -> Floats:
        """Shares of a step at which it passes through the planes of faces."""
        normals, corners = self._normals[plain], self._corners[plain]
        slope = normals @ step
        with np.errstate(all="ignore"):
            share = ((corners - start) * normals).sum(axis=1) / slope
        return np.asarray(share[np.isfinite(share) & (share > 1e-9) & (share < 1 - 1e-9)])


MOST_STROKES = 300
"""Lines of a model up to which all of them are drawn, dashed where they are hidden."""

SHARP = np.cos(np.radians(30.0))
"""Cosine of the angle between faces from which their edge is a feature of a model of very many faces."""


def worth_drawing(strokes: Sequence[Stroke], towards: Callable[[Floats], Floats]) -> Sequence[Stroke]:
    """The lines that are drawn: of very many those between faces that meet sharply, and those of the silhouette.

    ``towards`` gives directions (n, 3) to the viewer from points (n, 3).
    """
    edges = [k for k, stroke in enumerate(strokes) if stroke.normals is not None]
    if len(strokes) <= MOST_STROKES or not edges:
        return strokes
    normals = np.array([strokes[k].normals for k in edges])
    ways = towards(np.array([strokes[k].points[0] for k in edges]))
    one, other = np.moveaxis(normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300), 1, 0)
    faced = np.einsum("eki,ei->ek", normals, ways)
    plain = (np.einsum("ei,ei->e", one, other) > SHARP) & (faced[:, 0] * faced[:, 1] > 0.0)
    left_out = {k for k, each in zip(edges, plain.tolist(), strict=True) if each}
    return [stroke for k, stroke in enumerate(strokes) if k not in left_out]


def _bends(points: Floats) -> Floats:
    """The same line without the points at which it goes straight on."""
    steps = np.diff(points, axis=0)
    steps = steps / np.maximum(np.linalg.norm(steps, axis=1)[:, None], 1e-300)
    turned = np.linalg.norm(np.cross(steps[:-1], steps[1:]), axis=1) > STRAIGHT
    return np.asarray(points[np.concatenate([[True], turned, [True]])])


def _without_specks(hidden: Mask) -> Mask:
    """Runs of one or two steps take the state of what is before them: facets are not quite smooth."""
    hidden = hidden.copy()
    ends = np.flatnonzero(np.diff(hidden)) + 1
    for first, last in pairwise(ends.tolist()):
        if last - first <= _SPECK:
            hidden[first:last] = hidden[first - 1]
    return hidden


def _crossings(start: Floats, step: Floats, edges: Floats) -> Floats:
    """Shares of a step at which it crosses edges (e, 2, 3) in the picture."""
    way, gap = edges[:, 1, :2] - edges[:, 0, :2], edges[:, 0, :2] - start[:2]
    across = step[0] * way[:, 1] - step[1] * way[:, 0]
    with np.errstate(all="ignore"):
        share = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / across
        other = (gap[:, 0] * step[1] - gap[:, 1] * step[0]) / across
    good = np.isfinite(share) & (share > 1e-9) & (share < 1 - 1e-9) & (other > -1e-9) & (other < 1 + 1e-9)
    return np.asarray(share[good])


def _sides(polygons: Floats) -> Floats:
    """The sides (…, k, 2, 3) of polygons (…, k, 3)."""
    return np.stack([polygons, np.roll(polygons, -1, axis=-2)], axis=-2)


def _cells(patch: Floats) -> Floats:
    """Two triangles (t, 3, 3) for each cell of a grid (n, m, 3)."""
    n, m = len(patch) - 1, patch.shape[1] - 1
    a, b, c, d = (patch[i : i + n, j : j + m].reshape(-1, 3) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
