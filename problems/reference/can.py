"""A can photographed on a bright ground: rendered by the hull of its two rims, and what it was made with."""

from __future__ import annotations

import numpy as np
from PIL import Image
from scipy.spatial import ConvexHull

from problems.reference.least_squares import PROBLEMS, Array, write_expected
from problems.reference.photographs import exposed, small_pixels, turned

WIDTH, HEIGHT, SAMPLES, BLUR, NOISE = 400, 300, 6, 0.8, 2.0
FOCAL, CENTRE = 560.0, (200.0, 150.0)
RADIUS, TALL = 0.0331, 0.115
LEAN, SIDE, PLACE = 1.21, 0.17, (0.012, 0.045, 0.42)
"""Turns about x and y (rad), in this order, and the middle of the foot in the camera's frame (m)."""
BRIGHT, DARK = 200.0, 60.0


def rims() -> Array:
    """Image points (n, 2) of both rims in px."""
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)  # 0.001 px within the circle
    circle = RADIUS * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    points = np.concatenate([circle, circle + np.array([0, 0, TALL])])
    turn = turned(0.0, SIDE, 0.0) @ turned(LEAN, 0.0, 0.0)
    x, y, z = (points @ turn.T + PLACE).T
    return np.column_stack([CENTRE[0] + FOCAL * x / z, CENTRE[1] + FOCAL * y / z])


def covered(u: Array, v: Array) -> Array:
    """How much of each small pixel, from 0 to 1, the can covers: by the distance from the nearest side of the hull."""
    hull = ConvexHull(rims())
    inside = np.full(u.shape, -np.inf)
    for normal_u, normal_v, offset in np.unique(hull.equations, axis=0):
        inside = np.maximum(inside, normal_u * u + normal_v * v + offset)
    return np.clip(0.5 - inside * SAMPLES, 0, 1)


def main() -> None:
    """Write the image, and what it was made with."""
    u, v = small_pixels(WIDTH, HEIGHT, SAMPLES)
    near = np.ptp(rims(), axis=0).max()
    middle = rims().mean(axis=0)
    part = np.zeros(u.shape)
    box = (np.abs(u - middle[0]) < near) & (np.abs(v - middle[1]) < near)
    part[box] = covered(u[box], v[box])
    light = 0.85 + 0.15 * v / HEIGHT
    image = exposed(light * (BRIGHT - (BRIGHT - DARK) * part), SAMPLES, BLUR)
    noisy = image + np.random.default_rng(8).normal(0, NOISE, image.shape)
    Image.fromarray(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)).save(PROBLEMS / "can" / "can.png", optimize=True)
    truth = {"lean": LEAN, "side": SIDE, "p": PLACE, "r": 1000 * RADIUS}
    estimates = {name: {"value": value, "deviations": 4} for name, value in truth.items()}
    write_expected("can", {"can": {"solves": [{"estimates": estimates}]}})


if __name__ == "__main__":
    main()
