"""The thermometer of JCGM 100, H.3: a straight line by linear algebra, and its value at 30 degrees."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected


def main() -> None:
    """Write the expected answer."""
    rows = table("thermometer", "readings.csv")
    reading, correction = (np.array([float(row[name]) for row in rows]) for name in ("reading", "correction"))

    def residuals(x: Array) -> Array:
        return x[0] + x[1] * (reading - 20) - correction

    found = fit(residuals, [0.0, 0.0])
    factor = np.sqrt(found.cost / found.dof)
    sigmas = found.sigmas(factor)

    def at_30(x: Array) -> object:
        return x[0] + 10 * x[1]

    solve = {
        "cost": found.cost,
        "dof": found.dof,
        "noise": {"d": factor},
        "estimates": {"intercept": estimate(found.x[0], sigmas[0]), "slope": estimate(found.x[1], sigmas[1])},
        "derived": {"at-30": estimate(at_30(found.x), found.sigma_of(at_30, factor))},
    }
    write_expected("thermometer", {"thermometer": {"solves": [solve]}})


if __name__ == "__main__":
    main()
