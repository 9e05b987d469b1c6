"""A triangle with three angles and two sides measured: the exact adjustment in the three numbers that it has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

ANGLES = ((1, "48.127", "0.02"), (2, "61.884", "0.02"), (3, "70.021", "0.04"))
SIDES = ((1, "41.213"), (2, "48.790"))
TAPE = 0.02


def measure() -> None:
    """Write the data."""
    write_table("triangle", "angles.csv", ("corner", "angle", "sigma"), ANGLES)
    write_table("triangle", "sides.csv", ("number", "length"), SIDES)


def main() -> None:
    """Write data and expected answer."""
    measure()
    angles, sides = table("triangle", "angles.csv"), table("triangle", "sides.csv")
    degree = np.pi / 180
    measured = np.array([float(r["angle"]) for r in angles]) * degree
    spread = np.array([float(r["sigma"]) for r in angles]) * degree
    lengths = np.array([float(r["length"]) for r in sides])

    def corners(x: Array) -> Array:
        return np.array([x[0], x[1], np.pi - x[0] - x[1]])

    def edges(x: Array) -> Array:
        return x[2] * np.sin(corners(x))

    def residuals(x: Array) -> Array:
        return np.concatenate([(corners(x) - measured) / spread, (edges(x)[:2] - lengths) / TAPE])

    found = fit(residuals, [measured[0], measured[1], lengths[0] / np.sin(measured[0])])

    def both(function: Callable[[Array], Array]) -> tuple[Array, Array]:
        values = function(found.x)
        sigmas = [found.sigma_of(lambda x, i=i: function(x)[i]) for i in range(len(values))]
        return values, np.array(sigmas)

    corner, corner_sigma = both(corners)
    edge, edge_sigma = both(edges)

    def area(x: Array) -> Array:
        return np.array([0.5 * edges(x)[0] * edges(x)[1] * np.sin(corners(x)[2])])

    whole, whole_sigma = both(area)
    solve = {
        "dof": found.dof,
        "cost": found.cost,
        "estimates": {
            "angle-of": estimate(corner / degree, corner_sigma / degree),
            "side": estimate(edge, edge_sigma),
        },
        "derived": {"area": estimate(whole[0], whole_sigma[0])},
    }
    write_expected("triangle", {"triangle": {"solves": [solve]}})


if __name__ == "__main__":
    main()
