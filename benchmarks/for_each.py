"""10,000 small problems, one after the other: a place from 48 ranges each, beside SciPy doing the same one by one."""

from __future__ import annotations

from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show
from benchmarks.scenes import EPOCHS, ceiling, epoch_tables

EPOCH_COUNT = 10_000
PEER_COUNT = 500


def scipy_seconds(ranges: np.ndarray) -> tuple[float, np.ndarray]:
    """Seconds an epoch of `scipy.optimize.least_squares` (MINPACK, our analytic Jacobian), and its places."""
    from scipy.optimize import least_squares

    at = ceiling()
    found = np.empty((len(ranges), 3))
    began = perf_counter()
    for i, measured in enumerate(ranges):

        def residuals(p: np.ndarray, measured: np.ndarray = measured) -> np.ndarray:
            return (np.linalg.norm(p - at, axis=1) - measured) / 0.01

        def jacobian(p: np.ndarray) -> np.ndarray:
            away = p - at
            return away / np.linalg.norm(away, axis=1)[:, None] / 0.01

        found[i] = least_squares(residuals, [1.75, 1.75, 1.0], jac=jacobian, method="lm", xtol=1e-12).x
    return (perf_counter() - began) / len(ranges), found


def main() -> None:
    print(machine())
    tables = epoch_tables(EPOCH_COUNT)
    problem = mbm.loads(EPOCHS)
    began = perf_counter()
    compiled = problem.compile(data=tables)
    compiling = perf_counter() - began
    began = perf_counter()
    solved = compiled.solve()
    solving = perf_counter() - began
    inside = sum(s.seconds for s in solved.solves)
    began = perf_counter()
    solved.to_json()
    writing = perf_counter() - began
    peer, places = scipy_seconds(tables["ranges"]["range"].reshape(-1, 48)[:PEER_COUNT])
    ours = np.array([s.estimates[0].value for s in solved.solves[:PEER_COUNT]])
    print(f"\n{EPOCH_COUNT:,} epochs of 48 ranges; largest difference from SciPy {np.abs(ours - places).max():.1e} m")
    each = 1e6 / EPOCH_COUNT
    lines = [
        ["read, check, derive", f"{compiling:.2f}", f"{compiling * each:.0f}", ""],
        ["solve", f"{solving:.2f}", f"{solving * each:.0f}", f"{solving * each / (peer * 1e6):.2f}"],
        ["  of it in the solves", f"{inside:.2f}", f"{inside * each:.0f}", ""],
        ["write the document", f"{writing:.2f}", f"{writing * each:.0f}", ""],
        [f"SciPy lm, {PEER_COUNT} epochs", f"{peer * PEER_COUNT:.2f}", f"{peer * 1e6:.0f}", "1.00"],
    ]
    show(["stage", "seconds", "µs an epoch", "× SciPy"], lines)


if __name__ == "__main__":
    main()
