"""Points of boards in an image: found on a small copy of it by OpenCV, put in order, refined level by level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.data.images import opencv
from mbm.data.images.faults import NoBoardError
from mbm.data.images.features import USUAL_BLUR, crossing
from mbm.data.images.fitting import NEAR_ENOUGH, Fitted, Floats, Grey, Patches, Pattern, fit
from mbm.data.images.orientation import oriented
from mbm.data.images.planes import clear
from mbm.values import dataclass

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
