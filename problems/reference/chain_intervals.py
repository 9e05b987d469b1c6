"""A chain of three links seen in one coordinate to a bounded error: the exact bounds, by SLSQP from many starts."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize

from problems.reference.least_squares import Array, table, write_expected, write_table

JOINTS = ((1, "1.61"), (2, "3.37"), (3, "3.94"))
BOUND = 0.02
LENGTHS = ((2.4, 2.6), (1.7, 1.9), (0.9, 1.1))
ANGLES = ((20.0, 75.0), (-100.0, -10.0), (-60.0, 40.0))
STARTS = 40


def measure() -> None:
    """Write the data."""
    write_table("chain-intervals", "joints.csv", ("joint", "x"), JOINTS)


def main() -> None:
    """Write data and expected answer."""
    measure()
    seen = np.array([float(row["x"]) for row in table("chain-intervals", "joints.csv")])
    box = [*LENGTHS, *(tuple(np.radians(ends)) for ends in ANGLES)]
    low, high = np.array(box).T

    def reach(p: Array) -> Array:
        return np.cumsum(p[:3] * np.cos(np.cumsum(p[3:])))

    def height(p: Array) -> Array:
        return np.cumsum(p[:3] * np.sin(np.cumsum(p[3:])))

    def room(p: Array) -> Array:
        away = reach(p) - seen
        return np.concatenate([BOUND - away, BOUND + away])

    random = np.random.default_rng(1)
    starts = low + random.uniform(0, 1, (STARTS, 6)) * (high - low)

    def extreme(quantity: Any, side: float) -> float:
        found = [
            minimize(
                lambda p: side * quantity(p),
                start,
                method="SLSQP",
                bounds=box,
                constraints={"type": "ineq", "fun": room},
                options={"maxiter": 500, "ftol": 1e-14},
            )
            for start in starts
        ]
        inside = [side * each.fun for each in found if each.success and room(each.x).min() > -1e-9]
        return min(inside) if side > 0 else max(inside)

    def ends(quantity: Any, unit: float = 1.0) -> list[float]:
        return [extreme(quantity, 1.0) / unit, extreme(quantity, -1.0) / unit]

    degree = np.pi / 180
    solve = {
        "estimates": {
            "l": {"bounds": [ends(lambda p, i=i: p[i]) for i in range(3)], "within": 0.1},
            "theta": {"bounds": [ends(lambda p, i=i: p[3 + i], degree) for i in range(3)], "within": 0.1},
        },
        "derived": {
            "height": {"bounds": [ends(lambda p, i=i: height(p)[i]) for i in range(3)], "within": 0.1},
            "bucket": {"bounds": ends(lambda p: p[3:].sum(), degree), "within": 0.1},
        },
    }
    write_expected("chain-intervals", {"chain-intervals": {"solves": [solve]}})


if __name__ == "__main__":
    main()
