"""Distances to a tag, some of them echoes: seeded, and the place by SciPy from the distances that are none."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, fit, table, write_expected, write_table

PLACE = np.array([2.1, 1.3, 0.9])
ECHOES = {3: 0.62, 7: 0.31, 8: 1.4, 14: 0.48, 19: 0.9}
"""Rows (from 1) that came by way of a wall, and by how much they are too long."""
SIGMA = 0.005
MOST = 1.7
"""The noise stays below so many standard deviations: which rows are echoes is then beyond doubt."""


def measure() -> None:
    """Write the data: 20 receivers on three walls and the ceiling."""
    random = np.random.default_rng(2003)
    walls = [(0.0, y, z) for y in (0.5, 1.5, 2.5) for z in (1.2, 2.3)]
    walls += [(4.0, y, z) for y in (0.4, 2.0) for z in (1.0, 2.2)]
    walls += [(x, 3.0, z) for x in (1.0, 3.0) for z in (0.8, 2.4)]
    walls += [(x, y, 2.7) for x in (0.8, 2.0, 3.2) for y in (0.7, 2.2)]
    rows = [(f"R{i}", *place) for i, place in enumerate(walls, 1)]
    write_table("echoes", "receivers.csv", ("id", "x", "y", "z"), rows)
    noise = np.clip(random.normal(0, 1, len(walls)), -MOST, MOST) * SIGMA
    ranges = []
    for i, place in enumerate(walls, 1):
        way = np.linalg.norm(PLACE - np.array(place)) + noise[i - 1] + ECHOES.get(i, 0.0)
        ranges.append((f"R{i}", f"{way:.4f}"))
    write_table("echoes", "ranges.csv", ("receiver", "range"), ranges)


def main() -> None:
    """Write data and expected answer."""
    measure()
    receivers = np.array([[float(r[c]) for c in "xyz"] for r in table("echoes", "receivers.csv")])
    ranges = np.array([float(r["range"]) for r in table("echoes", "ranges.csv")])
    good = np.array([i + 1 not in ECHOES for i in range(len(ranges))])

    def residuals(x: Array) -> Array:
        way = x - receivers[good]
        return (np.sqrt((way * way).sum(axis=1)) - ranges[good]) / SIGMA

    found = fit(residuals, PLACE.tolist())
    solve = {
        "dof": found.dof,
        "cost": found.cost,
        "outliers": {"ranges": sorted(ECHOES)},
        # No sigmas: those of a consensus allow for good rows that the rule might have left out.
        "estimates": {"p": {"value": found.x.tolist()}},
    }
    write_expected("echoes", {"echoes": {"solves": [solve]}})


if __name__ == "__main__":
    main()
