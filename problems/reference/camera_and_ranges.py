"""A desk in one image, and how far its top is by ultrasound: seeded data, and pose and size by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.cameras import Poses, pinhole
from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

FOLDER = "camera-and-ranges"
CAMERA = np.array([820.0, 820.0, 320.0, 240.0])
POSE = np.array([[1.75, 0.45, -0.30, 0.15, 0.55, 2.90]])
"""Rotation vector and translation (m) from the desk to the camera's frame (z forward, y down)."""
SIZE = np.array([0.61, 0.36, 0.71])
"""Half sides of the board, and its height (m)."""
GUESS, PRIOR = np.array([0.60, 0.35]), 0.05
RATIO, RATIO_SIGMA = 1.6, 0.1
INSET = 0.03
STATIONS = np.array([(-0.8, -0.6, 0.1), (0.9, -0.5, 0.0), (0.7, 0.6, 0.2), (-0.7, 0.5, -0.1)])
ECHOES_EACH = 3
PIXEL, RANGE = 1.0, 0.004
PATHS = tuple(f"board/vertex/{n}" for n in range(1, 5)) + tuple(f"leg{n}/origin" for n in range(1, 5))
CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def desk(size: Array) -> Array:
    """Corners of the board and feet of the legs (8, 3) in the desk's frame."""
    x, y, h = size
    board = [np.array([a * x, b * y, h]) for a, b in CORNERS]
    feet = [np.array([a * (x - INSET), b * (y - INSET), 0 * h]) for a, b in CORNERS]
    return np.array(board + feet)


def seen(x: Array, pose: Poses) -> tuple[Array, Array]:
    """Image points (8, 2) in px, and ranges (stations · echoes,) in m, of pose and size."""
    turn, shift = pose.moved(x[:6])[0]
    away = STATIONS - (turn @ np.array([0, 0, x[8]]) + shift)
    ranges = np.sqrt(np.sum(away * away, axis=1))
    return pinhole(CAMERA, desk(x[6:]) @ turn.T + shift), np.repeat(ranges, ECHOES_EACH)


def measure() -> None:
    """Write the data."""
    random = np.random.default_rng(1991)
    corners, ranges = seen(np.concatenate([np.zeros(6), SIZE]), Poses(POSE))
    corners = corners + random.normal(0, PIXEL, corners.shape)
    ranges = ranges + random.normal(0, RANGE, ranges.shape)
    write_table(
        FOLDER,
        "corners.csv",
        ("path", "u", "v"),
        [(p, f"{u:.2f}", f"{v:.2f}") for p, (u, v) in zip(PATHS, corners, strict=True)],
    )
    names = [f"S{i}" for i in range(1, len(STATIONS) + 1)]
    write_table(FOLDER, "stations.csv", ("id", "x", "y", "z"), [(n, *s) for n, s in zip(names, STATIONS, strict=True)])
    rows = [(n, f"{r:.4f}") for n, r in zip(np.repeat(names, ECHOES_EACH), ranges, strict=True)]
    write_table(FOLDER, "echoes.csv", ("station", "range"), rows)


def main() -> None:
    """Write data and expected answer."""
    measure()
    corners = np.array([[float(r["u"]), float(r["v"])] for r in table(FOLDER, "corners.csv")])
    ranges = np.array([float(r["range"]) for r in table(FOLDER, "echoes.csv")])
    pose = Poses(POSE)

    def by_image(x: Array) -> Array:
        prior = [(x[6:8] - GUESS) / PRIOR, [(x[6] / x[7] - RATIO) / RATIO_SIGMA]]
        return np.concatenate([((seen(x, pose)[0] - corners) / PIXEL).ravel(), *prior])

    def by_both(x: Array) -> Array:
        return np.concatenate([by_image(x), (seen(x, pose)[1] - ranges) / RANGE])

    expected = {}
    for name, residuals in (("image-alone", by_image), ("image-and-ranges", by_both)):
        pose = Poses(POSE)
        found = fit(residuals, [*np.zeros(6), *SIZE])
        pose.settle(found.x[:6])
        found = fit(residuals, [*np.zeros(6), *found.x[6:]])
        sigmas = found.sigmas()
        estimates = {n: estimate(found.x[6 + i], sigmas[6 + i]) for i, n in enumerate("xyh")}
        estimates["T"] = {"value": pose.values()[0], "sigma": sigmas[:6].tolist()}
        expected[name] = {"solves": [{"dof": found.dof, "cost": found.cost, "estimates": estimates}]}
    write_expected(FOLDER, expected)


if __name__ == "__main__":
    main()
