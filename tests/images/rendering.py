"""Photographs of plane patterns by a simulator that shares nothing with mbm: every pixel is a mean over its square.

A board is a function of the places of small pixels on it, in squares; a camera looks at it from a pose. What is seen at
a place of the image is found by the inverse of the homography. Pixel centres are at whole numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from problems.reference import photographs

DARK, BRIGHT = 60.0, 190.0
CAMERA = np.array([[400.0, 0, 161.3], [0, 404.0, 118.6], [0, 0, 1]])
SHAPE = (240, 320)
SQUARE = 0.025

Pattern = Callable[[np.ndarray, np.ndarray], np.ndarray]


def chessboard(columns: int, rows: int) -> Pattern:
    """The grey of a board of so many inner corners, of which the first is at (0, 0); the square after it is dark."""

    def grey(x, y):
        return BRIGHT + (DARK - BRIGHT) * photographs.chessboard(x, y, columns, rows)

    return grey


def corners(columns: int, rows: int) -> np.ndarray:
    """The inner corners (n, 3) in m, row by row."""
    return np.array([(i * SQUARE, j * SQUARE, 0.0) for j in range(rows) for i in range(columns)])


def projected(points: np.ndarray, turn: Rotation, place: np.ndarray, camera: np.ndarray = CAMERA) -> np.ndarray:
    """Points (n, 3) of the board in the image, (n, 2)."""
    seen = (turn.apply(points) + place) @ camera.T
    return seen[:, :2] / seen[:, 2:]


def rendered(
    pattern: Pattern,
    turn: Rotation,
    place: np.ndarray,
    *,
    camera: np.ndarray = CAMERA,
    shape: tuple[int, int] = SHAPE,
    samples: int = 4,
    blur: float = 0.7,
) -> np.ndarray:
    """The image without noise: blurred by ``blur`` px, means over samples × samples small pixels in each pixel."""
    axes = turn.as_matrix()
    inverse = np.linalg.inv(camera @ np.column_stack([axes[:, 0], axes[:, 1], place]))
    u, v = photographs.small_pixels(shape[1], shape[0], samples)
    x, y, w = np.tensordot(inverse, np.stack([u, v, np.ones_like(u)]), axes=1)
    return photographs.exposed(pattern(x / w / SQUARE, y / w / SQUARE), samples, blur)


def noisy(image: np.ndarray, random: np.random.Generator, noise: float) -> np.ndarray:
    """The image as a camera gives it: with noise, in whole grey values."""
    return np.clip(np.rint(image + random.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def middle_of(points: np.ndarray, turn: Rotation, distance: float) -> np.ndarray:
    """Where a board turned so has its first corner if its middle is straight ahead."""
    return np.array([0, 0, distance]) - turn.apply(points.mean(axis=0))


def save(path: Path, image: np.ndarray) -> None:
    """An image file of the kind that the ending says."""
    good, content = cv2.imencode(path.suffix, image)
    assert good
    path.write_bytes(content.tobytes())
