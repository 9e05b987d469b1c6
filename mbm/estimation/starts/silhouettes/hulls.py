"""How a shape's convex hull is seen for many values of what is unknown, by its support function in the image.

The hull of an image is the image of the hull: no outline has to be found. With n(φ) the directions of the image and
h(φ) = max x·n over the points x of a region, the mean of h is half its mean width, and that of 2 h n its Steiner point
(Schneider 1993, Convex bodies, §1.7): where it lies and how large it is, whatever its points are.

Contours are measured point by point: which rows see one silhouette, and what is not known of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.random_starts import directions, random_points, sobol
from mbm.expression.nodes import Outlined
from mbm.kernels.backends.calling import CallingStream
from mbm.kernels.outlines.arcs import NEAREST_DEPTH
from mbm.kernels.outlines.marks import Marks, kept, marks_of
from mbm.problem.types import BlockRole
from mbm.values import dataclass

FEWEST_POINTS = 8
"""Points of a contour that say something of its hull."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """Rows ``lines`` (n,) of a group that have measured ``points`` (n, 2) on the contours of one silhouette.

    ``touched`` (M,) marks the coordinates that these rows depend on.
    """

    group: Group = field(repr=False)
    stream: CallingStream = field(repr=False)
    call: int
    called: Outlined
    lines: Indices = field(repr=False)
    points: Floats = field(repr=False)
    touched: Mask = field(repr=False)

    def numbers(self, points: Floats) -> Floats:
        """The numbers (S, size) of the figure at points (S, N)."""
        first = int(self.lines[0])
        inputs = self.group.inputs_at(points, slice(first, first + 1))
        return self.stream.arguments(self.call, inputs)[:, : self.called.figure.size]

    def misfit(self, point: Floats) -> float:
        """The mean square distance of the measured points from the contours in px², infinite where there are none."""
        inputs = self.group.inputs_at(point[None], slice(0, self.group.rows))[self.lines]
        distances = self.stream.functions.values(self.called, self.stream.arguments(self.call, inputs))
        found = float(np.mean(np.square(distances)))
        return found if np.isfinite(found) else np.inf


def pictures_of(equations: Assembled, base: Floats, missing: Mask, seed: int) -> Iterator[Picture]:
    """The pictures that depend on some of the ``missing`` coordinates (M,), the richest first.

    Rows see one silhouette if its numbers are the same at random points. The measured points must not depend on what is
    missing.
    """
    found: list[Picture] = []
    probes = random_points(equations, base, missing, 2, seed)
    for group in equations.groups:
        if group.role is not BlockRole.OBSERVATION or not group.kernel.calls or not missing[group.touched].any():
            continue
        stream = group.cache.stream(group.number, group.kernel)
        if isinstance(stream, CallingStream):
            for number, (call, _) in enumerate(stream.calls):
                if isinstance(call.external, Outlined) and call.external.function == "contour-distance":
                    found += _of_call(group, stream, number, call.external, probes, len(missing))
    yield from sorted((p for p in found if (p.touched & missing).any()), key=lambda p: -len(p.lines))


def _of_call(
    group: Group, stream: CallingStream, number: int, called: Outlined, probes: Floats, coordinates: int
) -> Iterator[Picture]:
    size = called.figure.size
    first, second = (stream.arguments(number, group.inputs_at(p[None], slice(0, group.rows))) for p in probes)
    if not np.array_equal(first[:, size:], second[:, size:]) or not np.isfinite(first[:, size:]).all():
        return
    _, owner = np.unique(first[:, :size], axis=0, return_inverse=True)
    order = np.argsort(owner.ravel(), kind="stable")
    for lines in np.split(order, np.flatnonzero(np.diff(owner.ravel()[order])) + 1):
        if len(lines) >= FEWEST_POINTS:
            touched = np.zeros(coordinates, dtype=bool)
            touched[group.columns[lines[0]]] = True
            yield Picture(
                group=group,
                stream=stream,
                call=number,
                called=called,
                lines=lines,
                points=first[lines, size:],
                touched=touched,
            )


DIRECTIONS = 64
_TURN = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
IN_IMAGE = np.stack([np.cos(_TURN), np.sin(_TURN), np.zeros(DIRECTIONS)])
"""The directions (3, DIRECTIONS) of the image, which depth does not matter for."""

IN_SPACE = directions(sobol(DIRECTIONS, 2, 0)).T
"""Directions (3, DIRECTIONS) of space."""

PROBE = 1e-6
"""Of a coordinate, or of 1 where that is more, for differences of images."""

AT_A_TIME = 4_000_000
"""Numbers of an array of points by directions."""

MOST_MARKS, LEAST_POINTS = 1_000_000, 8
"""Points of a shape, at all points of unknown numbers together; and of these the least number: 100 MB or so."""


def support(places: Floats, ways: Floats) -> Floats:
    """h (S, DIRECTIONS) of points (S, K, 3) in the directions ``ways`` (3, DIRECTIONS)."""
    step = max(AT_A_TIME // (places.shape[1] * DIRECTIONS), 1)
    parts = [(places[i : i + step] @ ways).max(axis=1) for i in range(0, len(places), step)]
    return np.concatenate(parts)


BESIDE = 0.1
"""Of the extent of a contour: points that follow each other along it are nearer."""

GAP = 1.5
"""Usual distances of points: a wider one may have a corner in it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hulls:
    """What a picture's shape looks like at points (S, N) of all unknown numbers.

    ``wanted`` (DIRECTIONS,) is the support that it is to have in the directions ``ways`` (3, DIRECTIONS) of u, v and
    depth, ``size`` half the mean width of what was measured in px. ``open_ones`` are the coordinates that are sought.
    """

    picture: Picture
    layout: Layout
    open_ones: Indices
    size: float
    wanted: Floats
    ways: Floats
    marks: tuple[Marks, ...]

    def at_most(self, count: int) -> int:
        """So many points of unknown numbers, or fewer if the shape has very many of its own."""
        return min(count, max(MOST_MARKS // sum(len(each) for each in self.marks), LEAST_POINTS))

    def places(self, points: Floats) -> Floats:
        """u, v and depth (S, K, 3) of points of the shape."""
        numbers = self.picture.numbers(points)
        return self.picture.stream.functions.places(self.picture.called, numbers, self.marks)

    def misfits(self, points: Floats) -> Floats:
        """The wanted support less the shape's (S, DIRECTIONS); NaN where some of it is not in front of the camera."""
        places = self.places(points)
        found = self.wanted - support(places, self.ways)
        found[~(places[..., 2] >= NEAREST_DEPTH).all(axis=1)] = np.nan
        return found

    def steps(self, points: Floats, coordinates: Indices) -> tuple[Floats, Floats]:
        """Each of the points (S, N) after a small step of each coordinate (S·q, N), and the lengths (S, q)."""
        layout, count = self.layout, len(coordinates)
        number = layout.number[coordinates]
        length = np.where(number >= 0, PROBE * np.maximum(np.abs(points[:, number]), 1.0), PROBE)
        step = np.zeros((len(points), count, len(layout.number)))
        step[:, np.arange(count), coordinates] = length
        moved = layout.retract(np.repeat(points, count, axis=0), step.reshape(-1, step.shape[2]))
        return moved, length

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """``misfits`` and their derivatives (S, DIRECTIONS, q) by the open coordinates."""
        moved, length = self.steps(points, self.open_ones)
        found = self.misfits(np.concatenate([points, moved]))
        here, there = found[: len(points)], found[len(points) :].reshape(*length.shape, DIRECTIONS)
        return here, np.swapaxes((there - here[:, None]) / length[..., None], 1, 2)

    def thinned(self, points: Floats) -> Hulls:
        """The same without points of the shape that are never outermost, seen from where ``points`` say."""
        places = self.places(points)
        images = places[(places[..., 2] >= NEAREST_DEPTH).all(axis=1)]
        mask = np.zeros(places.shape[1], dtype=bool)
        step = max(AT_A_TIME // (images.shape[1] * DIRECTIONS), 1)
        for i in range(0, len(images), step):
            mask[np.unique(np.argmax(images[i : i + step] @ self.ways, axis=1))] = True
        return replace(self, marks=kept(self.marks, mask)) if mask.any() else self

    def solid(self, point: Floats) -> Hulls:
        """The same, but what is wanted is the solid where it is at ``point`` (N,), in space."""
        places = self.places(point[None])
        ways = IN_SPACE * np.array([1.0, 1.0, self.stretch(places)])[:, None]
        return replace(self, ways=ways, wanted=support(places, ways)[0])

    def stretch(self, places: Floats) -> float:
        """What depth (S, K, 3) is multiplied by to be about as large as the image."""
        return 2 * self.size / max(float(np.ptp(places[..., 2], axis=1).max()), NEAREST_DEPTH * 1e-3)


def corners_between(points: Floats) -> Floats:
    """The corners (k, 2) of a contour between points (n, 2) that follow each other along it, but for a gap.

    Beside corners nothing can be measured, and without them the hull is too small. A corner is where the lines through
    the points before and behind the gap meet. Points in another order have none.
    """
    after = np.roll(points, -1, axis=0)
    gaps = np.linalg.norm(after - points, axis=1)
    usual = float(np.median(gaps))
    if not 0 < usual < BESIDE * float(np.ptp(points, axis=0).max()):
        return points[:0]
    before, ahead = points - np.roll(points, 2, axis=0), np.roll(points, -3, axis=0) - after
    turn = before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0]
    way = after - points
    with np.errstate(all="ignore"):
        on = (way[:, 0] * ahead[:, 1] - way[:, 1] * ahead[:, 0]) / turn
        back = (way[:, 0] * before[:, 1] - way[:, 1] * before[:, 0]) / turn
        reach = np.maximum(on * np.linalg.norm(before, axis=1), -back * np.linalg.norm(ahead, axis=1))
    own = (gaps > GAP * usual) & (on > 0) & (back < 0) & (reach < gaps)
    return np.asarray(points[own] + on[own, None] * before[own])


def hulls_of(picture: Picture, layout: Layout, open_ones: Mask) -> Hulls:
    """Those of a picture of which the coordinates ``open_ones`` (M,) are sought."""
    points = np.concatenate([picture.points, corners_between(picture.points)])
    flat = np.column_stack([points, np.zeros(len(points))])
    wanted = support(flat[None], IN_IMAGE)[0]
    return Hulls(
        picture=picture,
        layout=layout,
        open_ones=np.flatnonzero(open_ones),
        size=float(wanted.mean()),
        wanted=wanted,
        ways=IN_IMAGE,
        marks=marks_of(picture.called.figure),
    )
