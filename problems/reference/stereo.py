"""Two cameras on a bar look at a board eight times: seeded corners, and the calibration of both by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.cameras import Poses, pinhole
from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

BOARD = np.array([(0.04 * i, 0.04 * j, 0.0) for j in range(5) for i in range(7)])
CAMERAS = np.array([(805.0, 802.0, 322.0, 238.0, -0.12, 0.05), (811.0, 809.0, 315.0, 245.0, -0.15, 0.08)])
"""fx fy cx cy k1 k2 of the left camera and of the right one."""
BAR = np.array([[0.02, -0.12, 0.01, -0.20, 0.004, 0.015]])
"""Rotation vector and translation (m) from the left camera's frame to the right one's."""
PHOTOS = np.array(
    [
        (0.35, -0.20, 0.05, -0.05, -0.10, 0.75),
        (-0.40, 0.25, -0.10, -0.01, -0.06, 0.68),
        (0.10, 0.50, 0.20, -0.06, -0.04, 0.80),
        (0.15, -0.55, -0.15, 0.01, -0.09, 0.66),
        (-0.30, -0.30, 0.60, 0.02, -0.11, 0.72),
        (0.45, 0.30, -0.40, -0.07, -0.03, 0.85),
        (-0.20, 0.60, 0.10, -0.03, -0.12, 0.78),
        (0.55, 0.05, 0.25, -0.04, -0.05, 0.70),
    ]
)
"""Rotation vector and translation (m) of the board in the left camera's frame."""
NOISE = 0.2
SIDES = ("left", "right")
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2")


def seen(x: Array, bar: Poses, photos: Poses) -> list[Array]:
    """Corners in px, (photos · corners, 2), of the left camera and of the right one."""
    inner = len(NAMES)
    (turn, shift), boards = bar.moved(x[2 * inner : 2 * inner + 6])[0], photos.moved(x[2 * inner + 6 :])
    left = [BOARD @ r.T + t for r, t in boards]
    right = [points @ turn.T + shift for points in left]
    cameras = x[:inner], x[inner : 2 * inner]
    return [
        np.concatenate([pinhole(c, points) for points in side]) for c, side in zip(cameras, (left, right), strict=True)
    ]


def measure() -> None:
    """Write the corners with noise."""
    random = np.random.default_rng(1989)
    truth = np.concatenate([CAMERAS.ravel(), np.zeros(6 + PHOTOS.size)])
    for side, image in zip(SIDES, seen(truth, Poses(BAR), Poses(PHOTOS)), strict=True):
        noisy = image + random.normal(0, NOISE, image.shape)
        names = [f"pair{i}" for i in range(1, len(PHOTOS) + 1) for _ in BOARD]
        board = [(f"{x:.2f}", f"{y:.2f}") for x, y, _ in np.tile(BOARD, (len(PHOTOS), 1))]
        rows = [(n, *b, f"{u:.3f}", f"{v:.3f}") for n, b, (u, v) in zip(names, board, noisy, strict=True)]
        write_table("stereo", f"{side}.csv", ("photo", "x", "y", "u", "v"), rows)


def main() -> None:
    """Write data and expected answer."""
    measure()
    measured = [np.array([[float(r["u"]), float(r["v"])] for r in table("stereo", f"{s}.csv")]) for s in SIDES]
    bar, photos = Poses(BAR), Poses(PHOTOS)

    def residuals(x: Array) -> Array:
        images = seen(x, bar, photos)
        return np.concatenate([((i - m) / NOISE).ravel() for i, m in zip(images, measured, strict=True)])

    inner = 2 * len(NAMES)
    found = fit(residuals, [*CAMERAS.ravel(), *np.zeros(6 + PHOTOS.size)])
    bar.settle(found.x[inner : inner + 6])
    photos.settle(found.x[inner + 6 :])
    found = fit(residuals, [*found.x[:inner], *np.zeros(6 + PHOTOS.size)])
    sigmas = found.sigmas()
    names = [f"{side}-{name}" for side in SIDES for name in NAMES]
    estimates = {n: estimate(found.x[i], sigmas[i]) for i, n in enumerate(names)}
    estimates["B"] = {"value": bar.values()[0], "sigma": sigmas[inner : inner + 6].tolist()}
    estimates["T"] = {"value": photos.values(), "sigma": sigmas[inner + 6 :].reshape(-1, 6).tolist()}

    def baseline(x: Array) -> Array:
        shift = bar.moved(x[inner : inner + 6])[0][1]
        return np.sqrt(np.sum(shift * shift))

    derived = {"baseline": estimate(baseline(found.x), found.sigma_of(baseline))}
    solve = {"dof": found.dof, "cost": found.cost, "estimates": estimates, "derived": derived}
    write_expected("stereo", {"stereo": {"solves": [solve]}})


if __name__ == "__main__":
    main()
