"""A camera looks at a chessboard seven times: photographs rendered pixel by pixel, with distortion and noise.

The image is made at six times the resolution, where each small pixel is dark as far as the board's edges leave it so;
there it is blurred as by a lens, and then each pixel takes the mean of its 6 × 6. (Blurring the pixels themselves, or
sampling the board at points, moves corners by as much as noise does.) Where a place lies on the board is found by
taking the distortion off (fixed-point iteration) and intersecting the line of sight with the board's plane.
"""

from __future__ import annotations

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from problems.reference.least_squares import PROBLEMS, Array, write_expected

COLUMNS, ROWS, SQUARE = 7, 5, 0.03
WIDTH, HEIGHT = 320, 240
FOCAL, CENTRE, K1 = (330.0, 328.0), (163.5, 117.0), -0.12
DARK, BRIGHT, NOISE, BLUR = 55.0, 185.0, 2.0, 0.6
SAMPLES = 6
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


def places(rotation: Array, place: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Where on the board, in squares, the lines of sight through places of the image end."""
    directions = sights(u, v) @ rotation  # in the frame of the board
    origin = -place @ rotation
    x, y = (origin[i] - origin[2] / directions[..., 2] * directions[..., i] for i in (0, 1))
    return x / SQUARE, y / SQUARE


def chessboard(x: Array, y: Array, columns: int, rows: int) -> Array:
    """How dark, from 0 to 1, small pixels at places of a board of so many inner corners are: by the part of each.

    ``x`` and ``y`` (height, width) are the places of the middles of neighbouring small pixels, in squares from the
    first inner corner; the square after it is dark.
    """
    on, sign = 1.0, 1.0
    for at, count in ((x, columns), (y, rows)):
        width = np.hypot(*np.gradient(at))
        edge = np.clip(np.rint(at), 0, count - 1)
        sign = sign * np.where(edge % 2 == 0, 1, -1) * np.clip(2 * (at - edge) / width, -1, 1)
        on = on * np.clip((at + 1) / width + 0.5, 0, 1) * np.clip((count - at) / width + 0.5, 0, 1)
    return on * (1 + sign) / 2


def small_pixels(width: int, height: int, samples: int) -> tuple[Array, Array]:
    """Places u, v (height·samples, width·samples) of the middles of small pixels."""
    v, u = np.mgrid[: height * samples, : width * samples].astype(float)
    return (u + 0.5) / samples - 0.5, (v + 0.5) / samples - 0.5


def exposed(image: Array, samples: int, blur: float) -> Array:
    """Pixels from small pixels: blurred by a normal distribution of ``blur`` px, and the mean over each pixel."""
    blurred = gaussian_filter(image, blur * samples, mode="nearest")
    height, width = image.shape[0] // samples, image.shape[1] // samples
    return blurred.reshape(height, samples, width, samples).mean(axis=(1, 3))


def main() -> None:
    """Write the photographs, and what they were made with."""
    random = np.random.default_rng(1)
    u, v = small_pixels(WIDTH, HEIGHT, SAMPLES)
    for number, (*angles, distance) in enumerate(POSES, 1):
        rotation = turned(*angles)
        middle = rotation @ np.array([(COLUMNS - 1) * SQUARE / 2, (ROWS - 1) * SQUARE / 2, 0])
        place = np.array([0, 0, distance]) - middle
        dark = chessboard(*places(rotation, place, u, v), COLUMNS, ROWS)
        image = exposed(BRIGHT + (DARK - BRIGHT) * dark, SAMPLES, BLUR)
        noisy = image + random.normal(0, NOISE, image.shape)
        whole = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        Image.fromarray(whole).save(PROBLEMS / "photographs" / f"board{number}.png", optimize=True)
    truth = dict(zip(("fx", "fy", "cx", "cy", "k1"), (*FOCAL, *CENTRE, K1), strict=True))
    estimates = {name: {"value": value, "deviations": 4} for name, value in truth.items()}
    dof = len(POSES) * (2 * COLUMNS * ROWS - 6) - len(truth)
    write_expected("photographs", {"photographs": {"solves": [{"dof": dof, "estimates": estimates}]}})


if __name__ == "__main__":
    main()
