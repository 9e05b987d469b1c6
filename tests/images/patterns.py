"""Boards as functions of places on them, for `rendering.rendered`: circles, markers, chessboards with markers.

Each gives the grey of small pixels whose middles are at x and y, in units of the board. What is measured is dark by the
part of a small pixel that it covers; the patterns inside of markers are looked up at the middles.
"""

from __future__ import annotations

import cv2
import numpy as np

from problems.reference import photographs
from tests.images.rendering import BRIGHT, DARK, Pattern

WHITE_AROUND = 1.0


def shaded(dark: np.ndarray) -> np.ndarray:
    """The grey of what is dark to this part."""
    return BRIGHT + (DARK - BRIGHT) * np.clip(dark, 0, 1)


def width_of(at: np.ndarray) -> np.ndarray:
    """How wide a small pixel is on the board."""
    return np.hypot(*np.gradient(at))


def within(at: np.ndarray, low: np.ndarray | float, high: np.ndarray | float) -> np.ndarray:
    """The part of small pixels at ``at`` that is between two edges."""
    width = width_of(at)
    return np.clip((at - low) / width + 0.5, 0, 1) * np.clip((high - at) / width + 0.5, 0, 1)


def circles(places: np.ndarray, radius: float, *, bright: bool = False) -> Pattern:
    """Circles about places (n, 2)."""

    def grey(x, y):
        width = np.sqrt(width_of(x) * width_of(y))
        dark = np.zeros_like(x)
        for u, v in places:
            dark += np.clip((radius - np.hypot(x - u, y - v)) / width + 0.5, 0, 1)
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
        dark = np.zeros_like(x)
        for number in range(columns * rows):
            row, column = divmod(number, columns)
            left, low = column * pitch, row * pitch
            square = within(x, left, left + 1) * within(y, low, low + 1)
            down = 1 - (y - low) if upward else y - low
            dark += square * looked_up(bits_of(dictionary, first + number, border), x - left, down)
        if joined:
            for row in range(rows + 1):
                for column in range(columns + 1):
                    left, low = column * pitch - gap, row * pitch - gap
                    dark += within(x, left, left + gap) * within(y, low, low + gap)
        return shaded(dark)

    return grey


def charuco(columns, rows, marker, dictionary) -> Pattern:
    """A chessboard of squares of side 1 from the origin, the first dark; markers in the white ones, row by row."""

    def grey(x, y):
        # The reference board is told by its inner corners, the first at (0, 0) and the square after it dark, as here.
        dark = photographs.chessboard(x - 1, y - 1, columns - 1, rows - 1)
        number = 0
        for row in range(rows):
            for column in range(columns):
                if (row + column) % 2 == 0:
                    continue
                left, low = column + (1 - marker) / 2, row + (1 - marker) / 2
                square = within(x, left, left + marker) * within(y, low, low + marker)
                inside = looked_up(bits_of(dictionary, number, 1), (x - left) / marker, (y - low) / marker)
                dark = dark * (1 - square) + square * inside
                number += 1
        return shaded(dark)

    return grey
