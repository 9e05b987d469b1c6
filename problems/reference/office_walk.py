"""Five laps of an office by Bluetooth and visual-inertial odometry: seeded, and laid on by complex least squares."""

from __future__ import annotations

from typing import Any

import numpy as np

from problems.reference.least_squares import Array, table, write_expected, write_table
from problems.reference.walk import ROUNDING, laid

FOLDER = "office-walk"
LENGTH, STEP, LEAST = 120.0, 10.0, 10
SECONDS = 240
CORNERS = (2 + 2j, 11 + 2j, 11 + 8j, 6 + 8j, 6 + 17j, 2 + 17j, 2 + 2j)
"""An L-shaped way through 13 m × 19 m, walked at 1 m/s."""
ALONE, LASTING = 0.75, 3.2
"""Standard deviation of one position on each axis (m), and by how much more a mean errs as errors last."""
KEPT = (LASTING**2 - 1) / (LASTING**2 + 1)
"""What is left of an error after a second: the mean of many errs by √((1 + ρ)/(1 − ρ)) more than if they were new."""
TURNING = np.deg2rad(0.25)
"""Drift of the heading (rad/√s)."""


def place(times: Array) -> Array:
    """Where the walker is, as complex numbers."""
    legs = np.abs(np.diff(CORNERS))
    ends = np.concatenate([[0], np.cumsum(legs)])
    gone = np.mod(times, ends[-1])
    return np.interp(gone, ends, np.real(CORNERS)) + 1j * np.interp(gone, ends, np.imag(CORNERS))


def measure() -> None:
    """Write the data."""
    random = np.random.default_rng(1999)
    seconds = np.arange(SECONDS + 1.0)
    new = random.normal(0, ALONE, (len(seconds), 2)) * np.sqrt(1 - KEPT**2)
    errors = np.empty_like(new)
    errors[0] = new[0] / np.sqrt(1 - KEPT**2)
    for i in range(1, len(new)):
        errors[i] = KEPT * errors[i - 1] + new[i]
    true = place(seconds)
    _write("truth.csv", seconds, true)
    _write("ble.csv", seconds, true + errors[:, 0] + 1j * errors[:, 1])
    often = np.arange(0, SECONDS + 0.25, 0.5)
    turned = np.cumsum(random.normal(0, TURNING * np.sqrt(0.5), len(often)))
    moved = np.concatenate([[0], np.cumsum(np.diff(place(often)) * np.exp(1j * turned[1:]))])
    _write("vio.csv", often, 0.7 * np.exp(-0.9j) * moved + (4 - 3j))


def _write(name: str, times: Array, places: Array) -> None:
    rows = [(f"{t:.1f}", f"{z.real:.4f}", f"{z.imag:.4f}") for t, z in zip(times, places, strict=True)]
    write_table(FOLDER, name, ("t", "x", "y"), rows)


def _read(name: str) -> dict[float, complex]:
    return {float(r["t"]): complex(float(r["x"]), float(r["y"])) for r in table(FOLDER, name)}


def main() -> None:
    """Write data and expected answer."""
    measure()
    ble, vio, truth = (_read(name) for name in ("ble.csv", "vio.csv", "truth.csv"))
    pairs = [(t, z, vio[t]) for t, z in ble.items()]
    solves: list[dict[str, Any]] = []
    for count in range(int(SECONDS / STEP) + 1):
        end = count * STEP
        rows = [p for p in pairs if end - LENGTH + ROUNDING < p[0] <= end + ROUNDING]
        if len(rows) < LEAST:
            solves.append({"key": {"t": end}, "status": "skipped"})
            continue
        solve = laid(rows, end, ALONE * LASTING)
        here = complex(*solve["derived"]["here"]["value"])
        solve["derived"]["off"] = {"value": abs(here - truth[end])}
        solve["derived"]["without"] = {"value": abs(ble[end] - truth[end])}
        solves.append(solve)
    write_expected(FOLDER, {"office-walk": {"solves": solves}})


if __name__ == "__main__":
    main()
