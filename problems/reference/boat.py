"""A boat in a bay: seeded bearings of two lights, and its way by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

LIGHTS = {"mole": (0.0, 0.0), "cape": (1200.0, 150.0)}
SIGMA, WAVES, TURNING = np.deg2rad(0.3), 0.4, 0.02
"""Standard deviations: of a bearing, and per square root of a second, of the place (m) and of the speed (m/s)."""


def write_bearings() -> None:
    """The sights, with those of the two lights in turn."""
    random = np.random.default_rng(412)
    times = np.cumsum(random.integers(20, 60, 24)).astype(float)
    times -= times[0]
    place, speed, before = np.array([250.0, -520.0]), np.array([1.6, 0.5]), 0.0
    rows = []
    for k, t in enumerate(times):
        place = place + (t - before) * speed + WAVES * np.sqrt(t - before) * random.normal(size=2)
        speed = speed + TURNING * np.sqrt(t - before) * random.normal(size=2)
        before = t
        light = list(LIGHTS)[k % 2]
        way = np.array(LIGHTS[light]) - place
        angle = np.arctan2(way[1], way[0]) + SIGMA * random.normal()
        rows.append((f"{t:.0f}", light, f"{np.rad2deg(angle):.2f}"))
    write_table("boat", "bearings.csv", ("t", "light", "angle"), rows)


def main() -> None:
    """Write data and expected answer."""
    write_bearings()
    rows = table("boat", "bearings.csv")
    times = np.array([float(row["t"]) for row in rows])
    angles = np.deg2rad([float(row["angle"]) for row in rows])
    lights = np.array([LIGHTS[row["light"]] for row in rows])
    n, dt = len(times), np.diff(times)[:, None]

    def residuals(x: Array) -> Array:
        at, v = x[: 2 * n].reshape(n, 2), x[2 * n :].reshape(n, 2)
        way, c, s = lights - at, np.cos(angles), np.sin(angles)
        off = np.arctan((c * way[:, 1] - s * way[:, 0]) / (c * way[:, 0] + s * way[:, 1]))
        drift = (at[:-1] + dt * v[:-1] - at[1:]) / (WAVES * np.sqrt(dt))
        turn = (v[:-1] - v[1:]) / (TURNING * np.sqrt(dt))
        first = np.concatenate([(at[0] - [500, -500]) / 300, v[0] / 3])
        return np.concatenate([off / SIGMA, drift.ravel(), turn.ravel(), first])

    start = np.column_stack([250 + 1.6 * times, -520 + 0.5 * times])
    found = fit(residuals, [*start.ravel(), *np.tile([1.6, 0.5], n)])
    sigmas = found.sigmas()
    at, v = found.x[: 2 * n].reshape(n, 2), found.x[2 * n :].reshape(n, 2)

    def speed(k: int) -> tuple[float, float]:
        own = slice(2 * n + 2 * k, 2 * n + 2 * k + 2)
        return float(np.linalg.norm(v[k])), found.sigma_of(lambda x: np.sqrt(x[own] @ x[own]))

    speeds = np.array([speed(k) for k in range(n)])
    solve = {
        "cost": found.cost,
        "dof": found.dof,
        "estimates": {
            "at": estimate(at, sigmas[: 2 * n].reshape(n, 2)),
            "v": estimate(v, sigmas[2 * n :].reshape(n, 2)),
        },
        "derived": {"speed": estimate(speeds[:, 0], speeds[:, 1])},
    }
    write_expected("boat", {"boat": {"solves": [solve]}})


if __name__ == "__main__":
    main()
