"""Points on an ellipse with errors in both coordinates: seeded, and fitted with the place of each as an unknown."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

CENTRE, AXES, TURN = (3.1, -2.4), (41.0, 28.5), 0.6
SIGMA = 0.2
COUNT = 36


def measure() -> None:
    """Write the data: the probe reaches two thirds of the rim."""
    random = np.random.default_rng(1989)
    around = np.linspace(0.2, 4.4, COUNT)
    x, y = _rim(np.array([*CENTRE, *AXES, TURN]), around)
    x, y = x + random.normal(0, SIGMA, COUNT), y + random.normal(0, SIGMA, COUNT)
    write_table("rim", "rim.csv", ("x", "y"), [(f"{u:.4f}", f"{v:.4f}") for u, v in zip(x, y, strict=True)])


def _rim(x: Array, around: Array) -> tuple[Array, Array]:
    u, v = x[2] * np.cos(around), x[3] * np.sin(around)
    c, s = np.cos(x[4]), np.sin(x[4])
    return x[0] + c * u - s * v, x[1] + s * u + c * v


def main() -> None:
    """Write data and expected answer."""
    measure()
    points = table("rim", "rim.csv")
    x, y = (np.array([float(r[name]) for r in points]) for name in ("x", "y"))

    def residuals(p: Array) -> Array:
        u, v = _rim(p[:5], p[5:])
        return np.concatenate([(u - x) / SIGMA, (v - y) / SIGMA])

    found = fit(residuals, [*CENTRE, *AXES, TURN, *np.linspace(0.2, 4.4, COUNT)])
    sigmas = found.sigmas()
    degree = np.pi / 180
    solve = {
        "dof": found.dof,
        "cost": found.cost,
        "estimates": {
            "c": estimate(found.x[:2], sigmas[:2]),
            "a": estimate(found.x[2], sigmas[2]),
            "b": estimate(found.x[3], sigmas[3]),
            "phi": estimate(found.x[4] / degree, sigmas[4] / degree),
        },
    }
    write_expected("rim", {"rim": {"solves": [solve]}})


if __name__ == "__main__":
    main()
