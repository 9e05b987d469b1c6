"""The board of the desk in one image: yaw and position from four corners."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected

BOARD = np.array([(0.6, 0.35), (-0.6, 0.35), (-0.6, -0.35), (0.6, -0.35)])
HEIGHT = 0.7 - 1.5
"""The board above the eye, m."""


def main() -> None:
    """Write the expected answer."""
    seen = np.array([[float(r["X"]), float(r["Y"])] for r in table("desk", "corners.csv")[:4]])

    def residuals(x: Array) -> Array:
        cosine, sine = np.cos(x[0]), np.sin(x[0])
        forward = x[1] + cosine * BOARD[:, 0] - sine * BOARD[:, 1]
        left = x[2] + sine * BOARD[:, 0] + cosine * BOARD[:, 1]
        image = 800 * np.column_stack([left / forward, HEIGHT / forward])
        return ((image - seen) / 2).ravel()

    found = fit(residuals, [0.2, 2.5, 0.0])
    sigmas = found.sigmas()
    degree = np.pi / 180
    estimates = {
        "p": estimate(found.x[0] / degree, sigmas[0] / degree),
        "xg": estimate(found.x[1], sigmas[1]),
        "yg": estimate(found.x[2], sigmas[2]),
    }
    solve = {"cost": found.cost, "dof": found.dof, "estimates": estimates}
    write_expected("desk-as-printed", {"desk-as-printed": {"solves": [solve]}})


if __name__ == "__main__":
    main()
