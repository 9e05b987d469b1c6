"""Which corner of a grid is the first: the same for the same photograph, and where a board tells, the same for all.

A detector gives the points of a board row by row, but from any corner of the board and in either sense. What a
chessboard or grid of circles looks like leaves some of these orders alike, so a rule decides, in this order:

1. The columns run along x and the rows along y such that x turns into y clockwise in the image: z points away from
   the camera, into the board.
2. The first square, between the first two points of the first two rows, is dark. A chessboard with an odd and an even
   side has one such order. (OpenCV's detector has the same.)
3. Of what is left, x points to the right in the image as far as it can.
"""

from __future__ import annotations

import numpy as np

from mbm.data.images.fitting import Floats, Grey


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
