"""Points of boards in an image: found on a small copy of it by OpenCV, put in order, refined level by level. Which
corner of a grid is the first: the same for the same photograph, and where a board tells, the same for all. A
board's plane and the image of it: homographies, and what they do to steps on the board.

A detector gives the points of a board row by row, but from any corner of the board and in either sense. What a
chessboard or grid of circles looks like leaves some of these orders alike, so a rule decides, in this order:

1. The columns run along x and the rows along y such that x turns into y clockwise in the image: z points away from
   the camera, into the board.
2. The first square, between the first two points of the first two rows, is dark. A chessboard with an odd and an even
   side has one such order. (OpenCV's detector has the same.)
3. Of what is left, x points to the right in the image as far as it can.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.data.images import opencv
from mbm.data.images.faults import NoBoardError
from mbm.data.images.features import USUAL_BLUR, crossing
from mbm.data.images.fitting import NEAR_ENOUGH, Fitted, Floats, Grey, Patches, Pattern, fit
from mbm.values import dataclass

FEWEST = 4
"""Points that determine a homography."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """The homography (3, 3) from places on a board to the image."""

    matrix: Floats

    def points(self, places: Floats) -> Floats:
        """Places (n, 2) in the image."""
        seen = places @ self.matrix[:, :2].T + self.matrix[:, 2]
        return np.asarray(seen[:, :2] / seen[:, 2:])

    def steps(self, places: Floats) -> tuple[Floats, Floats]:
        """The derivatives (n, 2) of the points by x and by y of places (n, 2): pixels for a unit of length."""
        seen = places @ self.matrix[:, :2].T + self.matrix[:, 2]
        points = seen[:, :2] / seen[:, 2:]
        along, down = ((self.matrix[:2, i] - points * self.matrix[2, i]) / seen[:, 2:] for i in (0, 1))
        return np.asarray(along), np.asarray(down)

    def misfit(self, places: Floats, points: Floats) -> float:
        """Root mean square of how far points (n, 2) are from places (n, 2) in the image, in px."""
        return float(np.sqrt(np.mean(np.sum((self.points(places) - points) ** 2, axis=1))))


def plane_of(places: Floats, points: Floats) -> Plane | None:
    """The homography from places (n, 2) to points (n, 2); None if they do not determine it."""
    if len(places) < FEWEST or np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-9 * np.ptp(places)) < 2:
        return None
    matrix = opencv.homography(places, points)
    return None if matrix is None else Plane(matrix=matrix)


def clear(along: Floats, down: Floats) -> Floats:
    """The distance (n,) from a point to the nearer edge at the end of steps (n, 2) that cross: a parallelogram's."""
    across = np.abs(along[:, 0] * down[:, 1] - along[:, 1] * down[:, 0])
    return np.asarray(across / np.maximum(np.linalg.norm(along, axis=1), np.linalg.norm(down, axis=1)))


def orders(points: Floats, columns: int, rows: int) -> list[Floats]:
    """All grids (rows, columns, 2) of the points (rows·columns, 2) in which x turns into y clockwise."""
    grid = points.reshape(rows, columns, 2)
    found = [grid, grid[::-1, ::-1], grid[:, ::-1], grid[::-1]]
    if rows == columns:
        found += [each.transpose(1, 0, 2) for each in found]
    return [each for each in found if clockwise(each)]


def clockwise(grid: Floats) -> bool:
    """Whether columns turn into rows clockwise, y pointing down."""
    along, down = steps(grid)
    return bool(along[0] * down[1] - along[1] * down[0] > 0)


def steps(grid: Floats) -> tuple[Floats, Floats]:
    """The mean steps from point to point along the rows and along the columns."""
    return np.diff(grid, axis=1).mean(axis=(0, 1)), np.diff(grid, axis=0).mean(axis=(0, 1))


def most_to_the_right(grids: list[Floats]) -> Floats:
    """The grid whose x points to the right as far as it can; of two that point straight up or down, the latter."""
    return max(grids, key=lambda grid: tuple(steps(grid)[0].tolist()))


def oriented(image: Grey, points: Floats, columns: int, rows: int) -> Floats | None:
    """The points of a chessboard as a grid (rows, columns, 2) by the rule; None if they make no grid."""
    grids = orders(points, columns, rows)
    dark = [grid for grid in grids if _dark_first(image, grid)]
    return most_to_the_right(dark or grids) if grids else None


def _dark_first(image: Grey, grid: Floats) -> bool:
    """Whether the first square is darker than its neighbours, by the middles of all squares."""
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    height, width = image.shape
    columns, rows = (np.clip(np.rint(middles[..., i]), 0, n - 1).astype(int) for i, n in ((0, width), (1, height)))
    grey = image[rows, columns].astype(np.float64)
    even = np.add.outer(np.arange(grey.shape[0]), np.arange(grey.shape[1])) % 2 == 0
    return bool(grey[even].mean() < grey[~even].mean())


LARGEST_PATCH, SMALLEST_PATCH = 8.0, 2.5
"""Radii of patches in px: lenses bend the edges of larger ones, smaller ones have too few pixels."""

TWO_BOARDS = "it shows two boards"

CLEAR = 0.8
"""Part of the distance to the next edge that a patch may reach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Points of a board in one image: their numbers on the board from 1 (n,), and how they were fitted."""

    numbers: NDArray[np.int64]
    fitted: Fitted


def refined(levels: list[Grey], points: Floats, prepared: Callable[[Floats], Patches], pattern: Pattern) -> Fitted:
    """Points (n, 2) of the last level, fitted there and on all levels before it; in px of the first.

    ``prepared`` makes patches of points. What cannot be fitted on a level goes on as it was, but is not good.
    """
    good = np.ones(len(points), dtype=bool)
    for number, level in enumerate(reversed(levels)):
        if number:
            points = 2 * points + 0.5
        fitted = fit(level, prepared(points), pattern, NEAR_ENOUGH)
        good &= fitted.good
        points = np.where(fitted.good[:, None], fitted.points, points)
    patches = prepared(points)  # about what was found, so that patches do not hang on the start
    parameters = np.where(fitted.good[:, None], fitted.parameters, patches.parameters)
    fitted = fit(levels[0], replace(patches, parameters=parameters), pattern)
    points = np.where(fitted.good[:, None], fitted.points, points)
    return replace(fitted, points=points, good=good & fitted.good)


def chessboard(image: Grey, columns: int, rows: int) -> Found:
    """The inner corners of a chessboard.

    Raises:
        NoBoardError

    """
    levels = opencv.pyramid(image)
    points = opencv.chessboard(levels[-1], columns, rows)
    grid = None if points is None else oriented(levels[-1], points, columns, rows)
    if points is None or grid is None:
        raise NoBoardError
    if opencv.chessboard_beside(levels[-1], columns, rows, points):
        raise NoBoardError(TWO_BOARDS)

    def prepared(at: Floats) -> Patches:
        return grid_patches(at.reshape(rows, columns, 2))

    fitted = refined(levels, grid.reshape(-1, 2), prepared, crossing)
    return Found(numbers=np.arange(1, rows * columns + 1), fitted=fitted)


def grid_patches(grid: Floats) -> Patches:
    """Patches about the points of a grid (rows, columns, 2) in which edges run along rows and columns."""
    along, down = (np.gradient(grid, axis=axis).reshape(-1, 2) for axis in (1, 0))
    return crossed_patches(grid.reshape(-1, 2), along, down, clear(along, down))


def crossed_patches(points: Floats, along: Floats, down: Floats, room: Floats) -> Patches:
    """Patches about points (n, 2) at which edges cross in two directions (n, 2); ``room`` (n,) px have nothing else."""
    angles = [np.arctan2(step[:, 1], step[:, 0]) for step in (along, down)]
    return Patches(
        points=points,
        radii=np.clip(CLEAR * room, SMALLEST_PATCH, LARGEST_PATCH),
        parameters=np.column_stack([*angles, np.full(len(points), np.log(USUAL_BLUR))]),
    )
