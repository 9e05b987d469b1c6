"""Boscovich's degrees of the meridian: a straight line in the squared sine of the latitude, by linear algebra."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected


def main() -> None:
    """Write the expected answer."""
    rows = table("meridian", "arcs.csv")
    latitude = np.deg2rad([float(r["degrees"]) + float(r["minutes"]) / 60 for r in rows])
    length = np.array([float(r["length"]) for r in rows])

    def residuals(x: Array) -> Array:
        return x[0] + x[1] * np.sin(latitude) ** 2 - length

    found = fit(residuals, [57000.0, 0.0])
    factor = np.sqrt(found.cost / found.dof)
    sigmas = found.sigmas(factor)

    def pole(x: Array) -> object:
        return x[0] + x[1]

    def flattening(x: Array) -> object:
        return x[1] / (3 * x[0])

    solve = {
        "cost": found.cost,
        "dof": found.dof,
        "noise": {"arcs": factor},
        "estimates": {"equator": estimate(found.x[0], sigmas[0]), "growth": estimate(found.x[1], sigmas[1])},
        "derived": {
            "pole": estimate(pole(found.x), found.sigma_of(pole, factor)),
            "flattening": estimate(flattening(found.x), found.sigma_of(flattening, factor)),
        },
    }
    write_expected("meridian", {"meridian": {"solves": [solve]}})


if __name__ == "__main__":
    main()
