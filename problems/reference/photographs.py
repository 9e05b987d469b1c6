"""A camera looks at a chessboard seven times: photographs rendered pixel by pixel, with distortion and noise.

Each pixel is the mean over 5 × 5 places in it. Where a place lies on the board is found by taking the distortion off
(fixed-point iteration) and intersecting the line of sight with the board's plane.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from problems.reference.least_squares import PROBLEMS, Array, write_expected

COLUMNS, ROWS, SQUARE = 7, 5, 0.03
WIDTH, HEIGHT = 320, 240
FOCAL, CENTRE, K1 = (330.0, 328.0), (163.5, 117.0), -0.12
DARK, BRIGHT, NOISE, BLUR = 55.0, 185.0, 5.0, 0.6
POSES = (
    (0.45, -0.10, 0.10, 0.40),
    (-0.50, 0.15, -0.20, 0.38),
    (0.10, 0.55, 0.30, 0.41),
    (-0.05, -0.55, -0.10, 0.39),
    (0.40, 0.40, 1.20, 0.42),
    (-0.35, -0.35, -0.60, 0.40),
    (0.05, 0.02, 2.60, 0.36),
)
"""Turns about x, y and z (rad), in this order, and the distance of the middle of the board (m)."""


def turned(x: float, y: float, z: float) -> Array:
    """The rotation matrix Rx(x) Ry(y) Rz(z)."""
    cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_x @ about_y @ about_z


def sights(u: Array, v: Array) -> Array:
    """Directions (…, 3) of the lines of sight through places of the image."""
    seen = np.stack([(u - CENTRE[0]) / FOCAL[0], (v - CENTRE[1]) / FOCAL[1]], axis=-1)
    plain = seen
    for _ in range(20):
        plain = seen / (1 + K1 * np.sum(plain**2, axis=-1, keepdims=True))
    return np.concatenate([plain, np.ones((*u.shape, 1))], axis=-1)


def grey(rotation: Array, place: Array, u: Array, v: Array) -> Array:
    """What is seen at places of the image."""
    directions = sights(u, v) @ rotation  # in the frame of the board
    origin = -place @ rotation
    x, y = (origin[i] - origin[2] / directions[..., 2] * directions[..., i] for i in (0, 1))
    x, y = x / SQUARE, y / SQUARE
    dark = (np.floor(x) + np.floor(y)) % 2 == 0
    return np.where(dark & (x >= -1) & (x < COLUMNS) & (y >= -1) & (y < ROWS), DARK, BRIGHT)


def blurred(image: Array) -> Array:
    """A normal distribution of `BLUR` px in both directions."""
    steps = np.arange(-4, 5)
    weights = np.exp(-0.5 * (steps / BLUR) ** 2)
    weights /= weights.sum()
    for axis in (0, 1):
        padded = np.pad(image, [(4, 4) if i == axis else (0, 0) for i in (0, 1)], mode="edge")
        image = sum(w * np.take(padded, range(k, k + image.shape[axis]), axis) for k, w in enumerate(weights))
    return image


def main() -> None:
    """Write the photographs, and what they were made with."""
    random = np.random.default_rng(1)
    offsets = (np.arange(5) + 0.5) / 5 - 0.5
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    for number, (*angles, distance) in enumerate(POSES, 1):
        rotation = turned(*angles)
        middle = rotation @ np.array([(COLUMNS - 1) * SQUARE / 2, (ROWS - 1) * SQUARE / 2, 0])
        place = np.array([0, 0, distance]) - middle
        image = np.mean([grey(rotation, place, u + a, v + b) for a in offsets for b in offsets], axis=0)
        noisy = blurred(image) + random.normal(0, NOISE, image.shape)
        whole = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        Image.fromarray(whole).save(PROBLEMS / "photographs" / f"board{number}.png", optimize=True)
    truth = dict(zip(("fx", "fy", "cx", "cy", "k1"), (*FOCAL, *CENTRE, K1), strict=True))
    estimates = {name: {"value": value, "deviations": 4} for name, value in truth.items()}
    dof = len(POSES) * (2 * COLUMNS * ROWS - 6) - len(truth)
    write_expected("photographs", {"photographs": {"solves": [{"dof": dof, "estimates": estimates}]}})


if __name__ == "__main__":
    main()
