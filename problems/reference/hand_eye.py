"""A camera on a robot's hand looks at a board: seeded corners, and where the camera sits by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.cameras import Poses, exponential, pinhole, rotation_of
from problems.reference.least_squares import Array, fit, table, write_expected, write_table

FOLDER = "hand-eye"
BOARD = np.array([(0.05 * i, 0.05 * j, 0.0) for j in range(4) for i in range(5)])
CAMERA = np.array([700.0, 700.0, 320.0, 240.0])
MOUNT = np.array([[0.05, -0.04, 1.55, 0.03, -0.06, 0.02]])
"""Rotation vector and translation (m) from the hand's frame to the camera's."""
TARGET = np.array([[3.05, 0.10, 0.05, 0.55, 0.05, 0.02]])
"""The same from the board to the robot's base."""
SPOTS = np.array(
    [
        (0.48, -0.02, 0.55, 0.10, -0.15, 0.20),
        (0.62, 0.10, 0.60, -0.25, 0.10, -0.50),
        (0.40, -0.15, 0.52, 0.30, 0.20, 0.90),
        (0.55, 0.20, 0.58, -0.35, -0.25, 0.40),
        (0.70, -0.10, 0.50, 0.20, 0.35, -1.00),
        (0.45, 0.12, 0.65, -0.10, -0.30, 1.40),
        (0.60, 0.00, 0.48, 0.40, 0.05, -0.20),
        (0.50, -0.20, 0.62, 0.15, -0.35, 0.60),
    ]
)
"""Where the hand was: position in the base's frame (m), and how it was turned from hanging straight down."""
DOWN = np.array([np.pi, 0.0, 0.0])
NOISE = 0.3


def hands() -> list[tuple[Array, Array]]:
    """Poses of the hand in the base's frame, as the robot says them: to 1e-9."""
    return [(np.round(exponential(s[3:]) @ exponential(DOWN), 9), s[:3]) for s in SPOTS]


def seen(x: Array, mount: Poses, target: Poses, robot: list[tuple[Array, Array]]) -> Array:
    """Corners in px (spots · corners, 2)."""
    (turn, shift), (board, place) = mount.moved(x[:6])[0], target.moved(x[6:])[0]
    base = BOARD @ board.T + place
    return np.concatenate([pinhole(CAMERA, ((base - t) @ r) @ turn.T + shift) for r, t in robot])


def measure() -> None:
    """Write the poses of the hand and the corners with noise."""
    random = np.random.default_rng(1990)
    poses = []
    for number, (matrix, place) in enumerate(hands(), 1):
        w = np.sqrt(max(0.0, 1 + np.trace(matrix))) / 2
        x = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / (4 * w)
        poses.append((number, *(f"{value:.12f}" for value in (w, *x)), *place))
    write_table(FOLDER, "hand.csv", ("spot", "qw", "qx", "qy", "qz", "x", "y", "z"), poses)
    image = seen(np.zeros(12), Poses(MOUNT), Poses(TARGET), hands())
    image = image + random.normal(0, NOISE, image.shape)
    names = [spot for spot in range(1, len(SPOTS) + 1) for _ in BOARD]
    board = np.tile(BOARD[:, :2], (len(SPOTS), 1))
    rows = [
        (n, f"{x:.2f}", f"{y:.2f}", f"{u:.3f}", f"{v:.3f}")
        for n, (x, y), (u, v) in zip(names, board, image, strict=True)
    ]
    write_table(FOLDER, "corners.csv", ("spot", "x", "y", "u", "v"), rows)


def stated() -> list[tuple[Array, Array]]:
    """The poses of the hand from their quaternions in the file."""
    found = []
    for r in table(FOLDER, "hand.csv"):
        turn = rotation_of([float(r[c]) for c in ("qw", "qx", "qy", "qz")])
        found.append((turn, np.array([float(r[c]) for c in "xyz"])))
    return found


def main() -> None:
    """Write data and expected answer."""
    measure()
    measured = np.array([[float(r["u"]), float(r["v"])] for r in table(FOLDER, "corners.csv")])
    mount, target, robot = Poses(MOUNT), Poses(TARGET), stated()

    def residuals(x: Array) -> Array:
        return ((seen(x, mount, target, robot) - measured) / NOISE).ravel()

    found = fit(residuals, np.zeros(12).tolist())
    mount.settle(found.x[:6])
    target.settle(found.x[6:])
    found = fit(residuals, np.zeros(12).tolist())
    sigmas = found.sigmas()
    estimates = {
        "X": {"value": mount.values()[0], "sigma": sigmas[:6].tolist()},
        "W": {"value": target.values()[0], "sigma": sigmas[6:].tolist()},
    }
    solve = {"dof": found.dof, "cost": found.cost, "estimates": estimates}
    write_expected(FOLDER, {"hand-eye": {"solves": [solve]}})


if __name__ == "__main__":
    main()
