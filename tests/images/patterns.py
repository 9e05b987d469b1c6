"""Boards as functions of places on them, for `rendering.rendered`: circles, markers, chessboards with markers.

Each gives the grey of small pixels whose middles are at x and y, in units of the board. What is measured is dark by the
part of a small pixel that it covers; the patterns inside of markers are looked up at the middles.
"""

from __future__ import annotations

import cv2
import numpy as np

from problems.reference import photographs
from tests.images.rendering import BRIGHT, DARK, Pattern


def shaded(dark: np.ndarray) -> np.ndarray:
    """The grey of what is dark to this part."""
    return BRIGHT + (DARK - BRIGHT) * np.clip(dark, 0, 1)


def width_of(at: np.ndarray) -> np.ndarray:
    """How wide a small pixel is on the board."""
    return np.hypot(*np.gradient(at))


def within(at: np.ndarray, width: np.ndarray, low: float, high: float) -> np.ndarray:
    """The part of small pixels at ``at``, so wide, that is between two edges."""
    return np.clip((at - low) / width + 0.5, 0, 1) * np.clip((high - at) / width + 0.5, 0, 1)


class Squares:
    """Squares on a board, drawn one by one where their small pixels are."""

    def __init__(self, x: np.ndarray, y: np.ndarray) -> None:
        self.x, self.y = x, y
        self.widths = width_of(x), width_of(y)
        self.margin = max(float(width.max()) for width in self.widths)

    def square(self, left: float, low: float, side: float):
        """Where its small pixels are, the part of each that it covers, and their places in parts of its side."""
        margin = self.margin
        near = (self.x > left - margin) & (self.x < left + side + margin)
        near &= (self.y > low - margin) & (self.y < low + side + margin)
        x, y = self.x[near], self.y[near]
        part = within(x, self.widths[0][near], left, left + side) * within(y, self.widths[1][near], low, low + side)
        return near, part, (x - left) / side, (y - low) / side


def circles(places: np.ndarray, radius: float, *, bright: bool = False) -> Pattern:
    """Circles about places (n, 2)."""

    def grey(x, y):
        width = np.sqrt(width_of(x) * width_of(y))
        square = np.full_like(x, np.inf)
        for u, v in places:
            np.minimum(square, (x - u) ** 2 + (y - v) ** 2, out=square)
        dark = np.clip((radius - np.sqrt(square)) / width + 0.5, 0, 1)
        return shaded(1 - dark if bright else dark)

    return grey


def bits_of(dictionary: str, number: int, border: int) -> np.ndarray:
    """A marker's squares, 1 where they are dark, its border among them."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    side = known.markerSize + 2 * border
    return (cv2.aruco.generateImageMarker(known, number, side, borderBits=border) == 0).astype(float)


def looked_up(bits: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Whether places in a marker, in parts of its side, are dark."""
    side = len(bits)
    column, row = (np.clip(np.floor(at * side), 0, side - 1).astype(int) for at in (x, y))
    return bits[row, column]


def markers(columns, rows, gap, dictionary, *, border=1, first=0, upward=False, joined=False) -> Pattern:
    """Markers of side 1, the first corner of the first at the origin."""
    pitch = 1 + gap

    def grey(x, y):
        squares, dark = Squares(x, y), np.zeros_like(x)
        for number in range(columns * rows):
            row, column = divmod(number, columns)
            near, part, across, down = squares.square(column * pitch, row * pitch, 1.0)
            bits = bits_of(dictionary, first + number, border)
            dark[near] += part * looked_up(bits, across, 1 - down if upward else down)
        for row in range(rows + 1 if joined else 0):
            for column in range(columns + 1):
                near, part, _, _ = squares.square(column * pitch - gap, row * pitch - gap, gap)
                dark[near] += part
        return shaded(dark)

    return grey


def charuco(columns, rows, marker, dictionary) -> Pattern:
    """A chessboard of squares of side 1 from the origin, the first dark; markers in the white ones, row by row."""

    def grey(x, y):
        # The reference board is told by its inner corners, the first at (0, 0) and the square after it dark, as here.
        squares, dark = Squares(x, y), photographs.chessboard(x - 1, y - 1, columns - 1, rows - 1)
        white = [(i, j) for j in range(rows) for i in range(columns) if (i + j) % 2]
        for number, (column, row) in enumerate(white):
            near, part, across, down = squares.square(column + (1 - marker) / 2, row + (1 - marker) / 2, marker)
            dark[near] += part * looked_up(bits_of(dictionary, number, 1), across, down)
        return shaded(dark)

    return grey
