"""How a shape's convex hull is seen for many values of what is unknown, by its support function in the image.

The hull of an image is the image of the hull: no outline has to be found. With n(φ) the directions of the image and
h(φ) = max x·n over the points x of a region, the mean of h is half its mean width, and that of 2 h n its Steiner point
(Schneider 1993, Convex bodies, §1.7): where it lies and how large it is, whatever its points are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.silhouettes.pictures import Picture
from mbm.kernels.outlines.arcs import NEAREST_DEPTH
from mbm.kernels.outlines.marks import Marks, kept, marks_of
from mbm.values import dataclass

DIRECTIONS = 64
_TURN = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
NORMALS = np.stack([np.cos(_TURN), np.sin(_TURN)])

SMALL_STEP = 1e-6
"""Of a coordinate, or of 1 where that is more, for differences of images."""

AT_A_TIME = 4_000_000
"""Numbers of an array of points by directions."""


def support(images: Floats) -> Floats:
    """h (S, DIRECTIONS) of points (S, K, 2)."""
    step = max(AT_A_TIME // (images.shape[1] * DIRECTIONS), 1)
    parts = [(images[i : i + step] @ NORMALS).max(axis=1) for i in range(0, len(images), step)]
    return np.concatenate(parts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hulls:
    """What a picture's shape looks like at points (S, N) of all unknown numbers; ``wanted`` (DIRECTIONS,) is measured.

    ``open_ones`` are the coordinates that are sought, ``size`` is half the mean width of what was measured.
    """

    picture: Picture
    layout: Layout
    open_ones: Indices
    wanted: Floats
    marks: tuple[Marks, ...]

    @property
    def size(self) -> float:
        """Half the mean width of the measured hull in px."""
        return float(self.wanted.mean())

    def places(self, points: Floats) -> Floats:
        """u, v and depth (S, K, 3) of points of the shape."""
        numbers = self.picture.numbers(points)
        return self.picture.stream.functions.places(self.picture.called, numbers, self.marks)

    def misfits(self, points: Floats) -> Floats:
        """Measured support less the shape's (S, DIRECTIONS); NaN where some of it is not in front of the camera."""
        places = self.places(points)
        found = self.wanted - support(places[..., :2])
        found[~(places[..., 2] >= NEAREST_DEPTH).all(axis=1)] = np.nan
        return found

    def steps(self, points: Floats, coordinates: Indices) -> tuple[Floats, Floats]:
        """Each of the points (S, N) after a small step of each coordinate (S·q, N), and the lengths (S, q)."""
        layout, count = self.layout, len(coordinates)
        number = layout.number[coordinates]
        length = np.where(number >= 0, SMALL_STEP * np.maximum(np.abs(points[:, number]), 1.0), SMALL_STEP)
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
        images = places[(places[..., 2] >= NEAREST_DEPTH).all(axis=1), :, :2]
        mask = np.zeros(places.shape[1], dtype=bool)
        step = max(AT_A_TIME // (images.shape[1] * DIRECTIONS), 1)
        for i in range(0, len(images), step):
            mask[np.unique(np.argmax(images[i : i + step] @ NORMALS, axis=1))] = True
        return replace(self, marks=kept(self.marks, mask)) if mask.any() else self


def hulls_of(picture: Picture, layout: Layout, open_ones: Mask) -> Hulls:
    """Those of a picture of which the coordinates ``open_ones`` (M,) are sought."""
    return Hulls(
        picture=picture,
        layout=layout,
        open_ones=np.flatnonzero(open_ones),
        wanted=support(picture.points[None])[0],
        marks=marks_of(picture.called.figure),
    )
