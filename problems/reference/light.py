"""Michelson's five series: one speed with NIST's certified figures, and the weighted mean with estimated weights."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit_components, table, write_expected

CERTIFIED_MEAN, CERTIFIED_DEVIATION = 299852.400000000, 79.0105478190518
"""NIST StRD, univariate set Michelso, times 1000: km/s."""

CLAUSES = ("d", "series-2", "series-3", "series-4", "series-5")
"""The observations of the problem, one for each series."""


def main() -> None:
    """Write the expected answers."""
    excess = np.array([float(r["excess"]) for r in table("light", "michelson.csv")])

    def residuals(x: Array) -> Array:
        return x[0] - (299000 + excess)

    groups = [slice(20 * k, 20 * k + 20) for k in range(5)]
    found, factors = fit_components(residuals, [300000.0], groups)
    pooled = {
        "dof": 99,
        "cost": 99 * CERTIFIED_DEVIATION**2,
        "noise": {"d": CERTIFIED_DEVIATION},
        "estimates": {"speed": estimate(CERTIFIED_MEAN, CERTIFIED_DEVIATION / 10)},
    }
    by_series = {
        "dof": found.dof,
        "cost": found.cost,
        "noise": {name: float(f) for name, f in zip(CLAUSES, factors, strict=True)},
        "estimates": {"speed": estimate(found.x[0], found.sigmas()[0])},
    }
    write_expected("light", {"pooled": {"solves": [pooled]}, "by-series": {"solves": [by_series]}})


if __name__ == "__main__":
    main()
