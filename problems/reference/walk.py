"""A walk round an office seen by a drifting camera: seeded, and laid onto the map by complex least squares."""

from __future__ import annotations

from typing import Any

import numpy as np

from problems.reference.least_squares import Array, estimate, table, write_expected, write_table

LENGTH, STEP, LEAST = 30.0, 15.0, 10
SECONDS = 121
ROUNDING = 1e-9
"""Of decimal times in binary numbers: a row exactly one length before the end is not in the window."""


def measure() -> None:
    """Write the data: positions once a second, and the track ten times in four seconds."""
    random = np.random.default_rng(2002)
    times = np.arange(0, SECONDS - 1 + 0.2, 0.4)

    def place(t: Array) -> Array:
        return 6 * np.cos(0.07 * t) + 4j * np.sin(0.11 * t) + 0.05 * t

    map_times = np.arange(SECONDS) + 0.013
    noisy = place(map_times) + random.normal(0, 1, SECONDS) + 1j * random.normal(0, 1, SECONDS)
    rows = [(f"{t:.3f}", f"{z.real:.4f}", f"{z.imag:.4f}") for t, z in zip(map_times, noisy, strict=True)]
    write_table("walk", "ble.csv", ("t", "x", "y"), rows)
    drift = np.cumsum(random.normal(0, 0.004, len(times)))
    moved = np.concatenate([[0], np.cumsum(np.diff(place(times)) * np.exp(1j * drift[1:]))])
    track = 0.6 * np.exp(-1.1j) * moved + (3 - 2j)
    rows = [(f"{t:.3f}", f"{z.real:.6f}", f"{z.imag:.6f}") for t, z in zip(times, track, strict=True)]
    write_table("walk", "track.csv", ("t", "x", "y"), rows)


def main() -> None:
    """Write data and expected answer."""
    measure()
    ble, track = table("walk", "ble.csv"), table("walk", "track.csv")
    times = np.array([float(r["t"]) for r in track])
    pairs = []
    for row in ble:
        t = float(row["t"])
        near = int(np.argmin(np.abs(times - t)))
        if abs(times[near] - t) <= 0.05:
            pairs.append((t, complex(float(row["x"]), float(row["y"])), _place(track[near])))
    solves = []
    first, last = pairs[0][0], pairs[-1][0]
    for count in range(int((last - first) / STEP + ROUNDING) + 1):
        end = first + count * STEP
        rows = [p for p in pairs if end - LENGTH + ROUNDING < p[0] <= end + ROUNDING]
        if len(rows) >= LEAST:
            solves.append(laid(rows, end))
        else:
            solves.append({"key": {"t": end}, "status": "skipped"})
    write_expected("walk", {"walk": {"solves": solves}})


def _place(row: dict[str, str]) -> complex:
    return complex(float(row["x"]), float(row["y"]))


def laid(rows: list[tuple[float, complex, complex]], end: float, sigma: float = 1.0) -> dict[str, Any]:
    """``w = a z + b``, each coordinate of ``w`` good to ``sigma``; the spread is of (angle, b, log |a|)."""
    w = np.array([r[1] for r in rows])
    z = np.array([r[2] for r in rows])
    design = np.column_stack([z, np.ones(len(z))])
    a, b = np.linalg.lstsq(design, w, rcond=None)[0]
    left = w - a * z - b
    columns = (1j * a * z, np.ones(len(z)), np.full(len(z), 1j), a * z)
    jacobian = np.column_stack([np.concatenate([np.real(c), np.imag(c)]) for c in columns])
    covariance = sigma**2 * np.linalg.inv(jacobian.T @ jacobian)
    last = [1j * a * z[-1], 1, 1j, a * z[-1]]
    slopes = np.array([np.real(last), np.imag(last)], dtype=float)
    here = a * z[-1] + b
    angle = float(np.angle(a))
    rotation = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    value = {"angle": angle, "matrix": rotation, "translation": [b.real, b.imag], "scale": float(abs(a))}
    return {
        "key": {"t": end},
        "dof": 2 * len(w) - 4,
        "cost": float(np.sum(np.abs(left) ** 2)) / sigma**2,
        "estimates": {"S": {"value": value, "sigma": np.sqrt(np.diag(covariance)).tolist()}},
        "derived": {"here": estimate([here.real, here.imag], np.sqrt(np.diag(slopes @ covariance @ slopes.T)))},
    }


if __name__ == "__main__":
    main()
