"""Grids of circles: spots that make a grid, ellipses fitted to them, and the centres of the circles they are images of.

The centre of the ellipse that a circle goes to is not the image of the circle's centre. For a circle of radius r, with
a map m from the board to the image, it is away from it by r²/8 (∇²m + 2 J ∇ ln det J) to first order: by
r² sin θ cos θ/f for a board tilted by θ, with r in px as seen straight on (J. Heikkilä, "Geometric camera calibration
using circular control points", 2000). All circles of an image tell the map, and how large they are: it is taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.data.images import opencv
from mbm.data.images.boards import (
    SMALLEST_PATCH,
    TWO_BOARDS,
    Found,
    Plane,
    clear,
    most_to_the_right,
    orders,
    plane_of,
    refined,
)
from mbm.data.images.faults import NoBoardError
from mbm.data.images.features import USUAL_BLUR, disc
from mbm.data.images.fitting import Fitted, Floats, Grey, Patches
from mbm.values import dataclass

MOST_SPOTS, SPOTS = 4, 300
"""Times as many spots as circles among which a grid is looked for, or so many: the time grows with their square."""

LARGEST = 24.0
"""The radius in px up to which circles are measured in the full image: larger ones in a copy of half the size."""

MARGIN = 4.0
"""Pixels around a circle that belong to its patch."""

ANOTHER_ORDER, ALIKE, MISPLACED = 2.0, 0.02, 0.3
"""Orders of a grid fit alike whose misfits differ by less than this factor, or are less than this part of a step; none
fits that misses by the last."""

MIRRORED = "its circles are those of the mirrored board"
BENT, TERMS = 3, 10
"""The degree of the polynomial that stands for a lens, and how many terms it has; it needs twice as many circles."""

AROUND = 48
"""Points on a circle by which the centre of its image is worked out: exact to 1e-6 of the radius."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CircleGrid:
    """Circles in rows; of an ``asymmetric`` grid every second row is shifted by half of the distance in a row."""

    columns: int
    rows: int
    asymmetric: bool

    def places(self) -> Floats:
        """The centres (rows·columns, 2) in units of the distance of the rows."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        x = 2 * column + row % 2 if self.asymmetric else column
        return np.column_stack([x, row]).astype(np.float64)


def grid_of_circles(image: Grey, board: CircleGrid) -> Found:
    """The centres of all circles.

    Raises:
        NoBoardError

    """
    levels = opencv.pyramid(image)
    grid, sizes = _grid(levels[-1], board)
    places = board.places()
    plane = plane_of(places, grid)
    if plane is None:
        raise NoBoardError
    radius = float(np.median(sizes / np.sqrt(_areas(plane, places))))
    largest = float(sizes.max()) * 2 ** (len(levels) - 1)
    coarse = min(max(int(np.ceil(np.log2(largest / LARGEST))), 0), len(levels) - 1)
    fitted = _without_bias(places, refined(levels[coarse:], grid, _prepared(board, radius), disc))
    for _ in range(coarse):
        fitted = replace(fitted, points=2 * fitted.points + 0.5, covariances=4 * fitted.covariances)
    return Found(numbers=np.arange(1, len(places) + 1), fitted=fitted)


def _grid(image: Grey, board: CircleGrid) -> tuple[Floats, Floats]:
    """The circles (rows·columns, 2) to a pixel or so in the order of their places, and their radii (rows·columns,)."""
    count = board.columns * board.rows
    for bright in (False, True):
        spots, radii = opencv.blobs(image, bright=bright)
        if not count <= len(spots) <= max(MOST_SPOTS * count, SPOTS):
            continue
        found = _found(image, board, bright=bright)
        if found is None:
            continue
        grid = _ordered(found, board)
        away = np.linalg.norm(spots[:, None] - grid, axis=2)
        sizes = radii[away.argmin(axis=0)]
        if len(spots) >= 2 * count:
            rest = opencv.without_spots(image, grid, 1.5 * float(sizes.max()))
            if _found(rest, board, bright=bright) is not None:
                raise NoBoardError(TWO_BOARDS)
        return grid, sizes
    raise NoBoardError


def _found(image: Grey, board: CircleGrid, *, bright: bool) -> Floats | None:
    return opencv.circles(image, board.columns, board.rows, asymmetric=board.asymmetric, bright=bright)


def _ordered(points: Floats, board: CircleGrid) -> Floats:
    """The points of a grid in the order of their places, by the rule of `orders`, among the orders that fit a plane."""
    places = board.places()
    fits = []
    read = _readings(points, board)
    for grid in (order for each in read for order in orders(each, board.columns, board.rows)):
        plane = plane_of(places, grid.reshape(-1, 2))
        if plane is not None:
            step = float(np.sqrt(_areas(plane, places).mean()))
            fits.append((plane.misfit(places, grid.reshape(-1, 2)) / step, grid))
    least = min((misfit for misfit, _ in fits), default=np.inf)
    if least > MISPLACED:
        raise NoBoardError(MIRRORED if fits else None)
    alike = [grid for misfit, grid in fits if misfit <= min(max(ANOTHER_ORDER * least, ALIKE), MISPLACED)]
    return most_to_the_right(alike).reshape(-1, 2)


def _readings(points: Floats, board: CircleGrid) -> list[Floats]:
    """The points (rows·columns, 2) row by row, as detectors may mean them.

    Of an asymmetric grid with an even number of rows they exchange neighbouring rows, and take columns for rows.
    """
    if not board.asymmetric or board.rows % 2:
        return [points]
    upright = points.reshape(board.rows, board.columns, 2)
    row, column = np.divmod(np.arange(board.rows * board.columns), board.columns)
    turned = points.reshape(2 * board.columns, board.rows // 2, 2)
    turned = turned[2 * column + row % 2, row // 2].reshape(upright.shape)
    pairs = [each.reshape(-1, 2, board.columns, 2)[:, ::-1].reshape(upright.shape) for each in (upright, turned)]
    return [upright, turned, *pairs]


def _areas(plane: Plane, places: Floats) -> Floats:
    """Square pixels (n,) for a square of the board at places (n, 2)."""
    along, down = plane.steps(places)
    return np.abs(along[:, 0] * down[:, 1] - along[:, 1] * down[:, 0])


def _prepared(board: CircleGrid, radius: float) -> Callable[[Floats], Patches]:
    """Patches about circles whose radius is that in units of the distance of the rows."""
    places = board.places()

    def prepared(points: Floats) -> Patches:
        plane = plane_of(places, points) or Plane(matrix=np.eye(3))
        along, down = plane.steps(places)
        shape = np.stack([along, down], axis=2)
        conics = np.linalg.inv(shape @ shape.transpose(0, 2, 1)) / radius**2
        widest = radius * np.linalg.norm(shape, ord=2, axis=(1, 2))
        near = (along + down, down - along) if board.asymmetric else (along, down)
        free = clear(*near) - radius * np.sqrt(_areas(plane, places)) - USUAL_BLUR
        parameters = [conics[:, 0, 0], conics[:, 0, 1], conics[:, 1, 1], np.full(len(points), np.log(USUAL_BLUR))]
        radii = np.maximum(np.minimum(widest + MARGIN, free), SMALLEST_PATCH)
        return Patches(points=points, radii=radii, parameters=np.column_stack(parameters))

    return prepared


def _without_bias(places: Floats, fitted: Fitted) -> Fitted:
    """The images of the circles' centres, from the centres of ellipses that were fitted."""
    good = fitted.good
    plane = plane_of(places[good], fitted.points[good])
    if plane is None:
        return fitted
    seen = _Seen.of(plane, places[good], fitted.points[good])
    first, mixed, last = (fitted.parameters[good, i] for i in range(3))
    areas = np.pi / np.sqrt(first * last - mixed**2)
    unit, _ = seen.circles(places[good], 1e-3)
    radius = float(np.median(np.sqrt(areas / unit))) * 1e-3
    _, middles = seen.circles(places, radius)
    return replace(fitted, points=fitted.points + seen.points(places) - middles)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """How an image shows the plane of a board: a homography, and a polynomial (terms, 2) behind it for the lens."""

    plane: Plane
    middle: Floats
    scale: float
    bend: Floats

    @classmethod
    def of(cls, plane: Plane, places: Floats, points: Floats) -> _Seen:
        """That which goes best with points (n, 2) at places (n, 2)."""
        straight = plane.points(places)
        middle, scale = straight.mean(axis=0), float(np.ptp(straight))
        bend: Floats = np.zeros((TERMS, 2))
        if len(places) >= 2 * TERMS:
            terms = _terms((straight - middle) / scale)
            bend = np.asarray(np.linalg.lstsq(terms, points - straight, rcond=None)[0], dtype=np.float64)
        return cls(plane=plane, middle=middle, scale=scale, bend=bend)

    def points(self, places: Floats) -> Floats:
        """Places (n, 2) in the image."""
        straight = self.plane.points(places)
        return np.asarray(straight + _terms((straight - self.middle) / self.scale) @ self.bend)

    def circles(self, places: Floats, radius: float) -> tuple[Floats, Floats]:
        """Areas (n,) and centroids (n, 2) of the images of circles about places (n, 2), as polygons."""
        angles = np.arange(AROUND) * (2 * np.pi / AROUND)
        around = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        middles = self.points(places)
        ring = self.points((places[:, None] + around).reshape(-1, 2)).reshape(-1, AROUND, 2) - middles[:, None]
        after = np.roll(ring, -1, axis=1)
        across = ring[..., 0] * after[..., 1] - ring[..., 1] * after[..., 0]
        areas = across.sum(axis=1) / 2
        centroids = ((ring + after) * across[..., None]).sum(axis=1) / (6 * areas[:, None])
        return np.abs(areas), middles + centroids


def _terms(at: Floats) -> Floats:
    """The products (n, terms) of powers of x and y up to the degree of the polynomial."""
    x, y = at.T
    return np.column_stack([x**i * y**j for i in range(BENT + 1) for j in range(BENT + 1 - i)])
