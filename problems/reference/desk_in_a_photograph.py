"""A desk on a bright floor: rendered as the hulls of board and legs, its edges measured in the image, and the truth.

An edge is measured by profiles across it. Where a profile crosses the middle between its ends is a point; a line is
fitted to the points by least squares, with a covariance from how far they are from it.
"""

from __future__ import annotations

import numpy as np
from PIL import Image
from scipy.ndimage import map_coordinates
from scipy.spatial import ConvexHull

from problems.reference.least_squares import PROBLEMS, Array, write_expected, write_table
from problems.reference.photographs import exposed, small_pixels, turned

FOLDER = "desk-in-a-photograph"
WIDTH, HEIGHT, SAMPLES, BLUR, NOISE = 480, 360, 4, 0.8, 2.0
FOCAL, CENTRE = 600.0, (240.0, 180.0)
HALF_LENGTH, HALF_WIDTH, RADIUS, TALL, INSET = 0.6, 0.35, 0.025, 0.7, 0.03
PITCH, YAW, PLACE = 2.05, 0.5, (0.05, 0.55, 2.6)
"""Turns about x and, before it, about the desk's upright axis (rad), and its foot's middle in the camera's frame."""
FLOOR, BOARD, LEG, MARKED = 205.0, 90.0, 60.0, 1.0
CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
REACH, NEAR, FEWEST = 6, 1.5, 20
"""Pixels of a profile to either side of the edge, how near to it the crossing is where no leg stands, and points."""


def turn() -> Array:
    """From the desk's frame, z up, to the camera's."""
    return turned(PITCH, 0.0, 0.0) @ turned(0.0, 0.0, YAW)


def seen(points: Array) -> Array:
    """Image points (n, 2) of points (n, 3) of the desk."""
    x, y, z = (points @ turn().T + PLACE).T
    return np.column_stack([CENTRE[0] + FOCAL * x / z, CENTRE[1] + FOCAL * y / z])


def board() -> Array:
    """The corners (4, 3) of the board, as they are numbered."""
    return np.column_stack([CORNERS * [HALF_LENGTH, HALF_WIDTH], np.full(4, TALL)])


def leg(corner: Array) -> Array:
    """The rims (n, 3) of a leg."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rim = np.column_stack([np.cos(angle), np.sin(angle)]) * RADIUS + corner * [HALF_LENGTH - INSET, HALF_WIDTH - INSET]
    return np.concatenate([np.column_stack([rim, np.full(60, height)]) for height in (0.0, TALL)])


def part_covered(points: Array, u: Array, v: Array) -> Array:
    """How much of each small pixel, from 0 to 1, the hull of image points covers."""
    inside = np.full(u.shape, -np.inf)
    for normal_u, normal_v, offset in np.unique(ConvexHull(points).equations, axis=0):
        inside = np.maximum(inside, normal_u * u + normal_v * v + offset)
    return np.clip(0.5 - inside * SAMPLES, 0, 1)


def rendered() -> Array:
    """The image, in whole grey values."""
    u, v = small_pixels(WIDTH, HEIGHT, SAMPLES)
    image = FLOOR * (0.9 + 0.1 * v / HEIGHT)
    for shade, points in (*((LEG, leg(corner)) for corner in CORNERS), (BOARD, board())):
        part = part_covered(seen(points), u, v)
        image = image * (1 - part) + shade * part
    noisy = exposed(image, SAMPLES, BLUR) + np.random.default_rng(12).normal(0, NOISE, (HEIGHT, WIDTH))
    return np.clip(np.rint(noisy), 0, 255)


def edge(image: Array, first: Array, last: Array) -> tuple[float, float, Array]:
    """Direction α in [−π/2, π/2), ρ = −u sin α + v cos α, and their covariance (2, 2), of an edge between two ends."""
    along = (last - first) / np.linalg.norm(last - first)
    across = np.array([-along[1], along[0]])
    steps = np.arange(-REACH, REACH + 0.25, 0.5)
    points = []
    for share in np.linspace(0.1, 0.9, int(np.linalg.norm(last - first) / 2)):
        places = first + share * (last - first) + steps[:, None] * across
        grey = map_coordinates(image, places.T[::-1], order=1, mode="nearest")
        low, high = grey[:4].mean(), grey[-4:].mean()
        middle = (low + high) / 2
        crossings = np.flatnonzero((grey[:-1] - middle) * (grey[1:] - middle) < 0)
        if abs(high - low) > 0.7 * (FLOOR - BOARD) and len(crossings) == 1 and abs(steps[crossings[0]]) < NEAR:
            k = crossings[0]
            points.append(places[k] + (middle - grey[k]) / (grey[k + 1] - grey[k]) * (places[k + 1] - places[k]))
    found = np.array(points)
    if len(found) < FEWEST:
        raise ValueError(len(found))
    centre = found.mean(axis=0)
    _, spread, axes = np.linalg.svd(found - centre)
    alpha = np.arctan2(axes[0, 1], axes[0, 0])
    alpha = (alpha + np.pi / 2) % np.pi - np.pi / 2
    c, s = np.cos(alpha), np.sin(alpha)
    variance = spread[1] ** 2 / (len(found) - 2)
    lever = -centre[0] * c - centre[1] * s  # of the middle of the points: there α and ρ are independent
    of_alpha = variance / spread[0] ** 2
    covariance = np.array(
        [[of_alpha, lever * of_alpha], [lever * of_alpha, variance / len(found) + lever**2 * of_alpha]]
    )
    return float(alpha), float(-centre[0] * s + centre[1] * c), covariance


def main() -> None:
    """Write the image, what is measured in it, and what it was made with."""
    image = rendered()
    Image.fromarray(image.astype(np.uint8)).save(PROBLEMS / FOLDER / "desk.png", optimize=True)
    ends, rows = seen(board()), []
    for number in range(4):
        alpha, rho, covariance = edge(image, ends[number], ends[(number + 1) % 4])
        numbers = (alpha, rho, covariance[0, 0], covariance[0, 1], covariance[1, 1])
        rows.append((f"board/line/{number + 1}", *(f"{value:.9g}" for value in numbers)))
    write_table(FOLDER, "edges.csv", ("path", "alpha", "rho", "aa", "ar", "rr"), rows)
    feet = np.column_stack([CORNERS * [HALF_LENGTH - INSET, HALF_WIDTH - INSET], np.zeros(4)])
    places = [
        *((f"board/vertex/{i + 1}", p) for i, p in enumerate(ends)),
        *(("leg1/origin", p) for p in seen(feet)[:1]),
    ]
    random = np.random.default_rng(13)
    marked = [(path, *(f"{value + random.normal(0, MARKED):.2f}" for value in place)) for path, place in places]
    write_table(FOLDER, "corners.csv", ("path", "u", "v"), marked)
    truth = {"pitch": PITCH, "yaw": YAW, "p": PLACE}
    estimates = {name: {"value": value, "deviations": 4} for name, value in truth.items()}
    dof = 2 * len(rows) + 2 * len(marked) - 5
    write_expected(FOLDER, {FOLDER: {"solves": [{"dof": dof, "estimates": estimates}]}})


if __name__ == "__main__":
    main()
