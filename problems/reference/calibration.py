"""A camera looks at a board five times: seeded corners, and the calibration by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.cameras import exponential, pinhole
from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

BOARD = np.array([(0.03 * i, 0.03 * j) for j in range(5) for i in range(7)])
CAMERA = np.array([612.0, 609.0, 331.0, 236.0, -0.21, 0.09, 0.0012, -0.0008, 0.02])
"""fx fy cx cy k1 k2 p1 p2 k3 (OpenCV's order)."""
POSES = np.array(
    [
        (0.35, -0.20, 0.05, -0.11, -0.07, 0.42),
        (-0.40, 0.25, -0.10, -0.05, -0.06, 0.38),
        (0.10, 0.50, 0.20, -0.12, -0.02, 0.45),
        (0.15, -0.55, -0.15, -0.02, -0.08, 0.36),
        (-0.30, -0.30, 0.60, -0.06, -0.10, 0.40),
    ]
)
"""Rotation vector and translation (m) of the board for each photograph."""
NOISE = 0.15
START = (600.0, 600.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


def image(camera: Array, pose: Array) -> Array:
    """The corners in px, (n, 2)."""
    points = np.column_stack([BOARD, np.zeros(len(BOARD))]) @ exponential(pose[:3]).T + pose[3:]
    return pinhole(camera, points)


def measure() -> None:
    """Write the corners with noise, and rough poses to start from."""
    random = np.random.default_rng(2024)
    rows: list[tuple[object, ...]] = []
    starts: list[tuple[object, ...]] = []
    for i, pose in enumerate(POSES, 1):
        seen = image(CAMERA, pose) + random.normal(0, NOISE, (len(BOARD), 2))
        for (x, y), (u, v) in zip(BOARD, seen, strict=True):
            rows.append((f"photo{i}", f"{x:.2f}", f"{y:.2f}", f"{u:.3f}", f"{v:.3f}"))
        rough = np.round(pose * 10) / 10
        starts.append((f"photo{i}", *(f"{value:.1f}" for value in np.where(rough == 0, 0.05, rough))))
    write_table("calibration", "corners.csv", ("photo", "x", "y", "u", "v"), rows)
    write_table("calibration", "photos.csv", ("photo", "rx", "ry", "rz", "tx", "ty", "tz"), starts)


def main() -> None:
    """Write data and expected answer."""
    measure()
    rows = table("calibration", "corners.csv")
    seen = np.array([[float(r["u"]), float(r["v"])] for r in rows]).reshape(len(POSES), len(BOARD), 2)

    def residuals(x: Array) -> Array:
        poses = x[9:].reshape(-1, 6)
        return np.concatenate([(image(x[:9], p) - s).ravel() for p, s in zip(poses, seen, strict=True)])

    found = fit(residuals, [*START, *POSES.ravel()])
    factor = float(np.sqrt(found.cost / found.dof))
    sigmas = found.sigmas(factor)
    values, deviations = found.x[9:].reshape(-1, 6), sigmas[9:].reshape(-1, 6)
    estimates = {n: estimate(found.x[i], sigmas[i]) for i, n in enumerate(NAMES)}
    estimates["r"] = estimate(values[:, :3], deviations[:, :3])
    estimates["t"] = estimate(values[:, 3:], deviations[:, 3:])
    solve = {"dof": found.dof, "cost": found.cost, "noise": {"corners": factor}, "estimates": estimates}
    write_expected("calibration", {"calibration": {"solves": [solve]}})


if __name__ == "__main__":
    main()
