"""A total station somewhere in a yard: seeded measurements, and the position by SciPy with two variance components."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit_components, table, write_expected, write_table

TARGETS = np.array([(12.0, 61.5), (48.2, 70.3), (83.7, 44.1), (79.4, 8.6), (41.9, -6.2), (5.3, 3.8), (-9.6, 33.0)])
PLACE = np.array([37.25, 29.4])
TURN, OFFSET = 0.35, 0.031
RANGE_SIGMA, ANGLE_SIGMA = 0.004, 2e-4
ROUNDS = 2


def measure() -> None:
    """Write the data: every target in two rounds."""
    random = np.random.default_rng(1989)
    write_table("station", "targets.csv", ("id", "x", "y"), [(f"T{i}", *t) for i, t in enumerate(TARGETS.tolist(), 1)])
    rows = []
    for turn in range(1, ROUNDS + 1):
        for i, target in enumerate(TARGETS, 1):
            way = target - PLACE
            distance = np.hypot(*way) + OFFSET + random.normal(0, RANGE_SIGMA)
            direction = (np.arctan2(way[1], way[0]) - TURN + random.normal(0, ANGLE_SIGMA)) % (2 * np.pi)
            rows.append((turn, f"T{i}", f"{distance:.4f}", f"{np.rad2deg(direction):.5f}"))
    write_table("station", "sights.csv", ("round", "target", "range", "direction"), rows)


def main() -> None:
    """Write data and expected answer."""
    measure()
    places = {r["id"]: (float(r["x"]), float(r["y"])) for r in table("station", "targets.csv")}
    sights = table("station", "sights.csv")
    target = np.array([places[r["target"]] for r in sights])
    distance = np.array([float(r["range"]) for r in sights])
    direction = np.deg2rad([float(r["direction"]) for r in sights])

    def residuals(x: Array) -> Array:
        way = target - x[:2]
        ranges = np.sqrt(way[:, 0] ** 2 + way[:, 1] ** 2) + x[3] - distance
        # The small angle from the measured direction to the computed one, without a cut.
        cosine, sine = np.cos(direction + x[2]), np.sin(direction + x[2])
        angles = np.arctan((cosine * way[:, 1] - sine * way[:, 0]) / (cosine * way[:, 0] + sine * way[:, 1]))
        prior = np.atleast_1d((x[3] - 0.030) / 0.002)
        return np.concatenate([ranges / 0.001, angles / np.deg2rad(0.01), prior])

    count = len(sights)
    groups = [slice(0, count), slice(count, 2 * count)]
    found, factors = fit_components(residuals, [36.0, 30.0, 0.3, 0.03], groups)
    sigmas = found.sigmas()
    degree = np.pi / 180
    solve = {
        "dof": found.dof,
        "cost": found.cost,
        "noise": {"ranges": float(factors[0]), "directions": float(factors[1])},
        "estimates": {
            "place": estimate(found.x[:2], sigmas[:2]),
            "turn": estimate(found.x[2] / degree, sigmas[2] / degree),
            "offset": estimate(1000 * found.x[3], 1000 * sigmas[3]),
        },
    }
    write_expected("station", {"station": {"solves": [solve]}})


if __name__ == "__main__":
    main()
