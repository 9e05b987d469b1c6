"""10,000 small problems together: a place from 48 ranges each, stage by stage, plain and by consensus, beside SciPy."""

from __future__ import annotations

import io
from collections.abc import Callable
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show
from benchmarks.scenes import EPOCHS, ceiling, epoch_tables

EPOCH_COUNT = 10_000
PEER_COUNT = 500
REPEATS = 3


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


def timed(work: Callable[[], object]) -> float:
    """Seconds of the fastest of a few runs."""
    seconds = []
    for _ in range(REPEATS):
        began = perf_counter()
        work()
        seconds.append(perf_counter() - began)
    return min(seconds)


def main() -> None:
    """Print the table."""
    from mbm.report.exports import write_solves

    print(machine())
    tables = epoch_tables(EPOCH_COUNT)
    began = perf_counter()
    compiled = mbm.loads(EPOCHS).compile(data=tables)
    compiling = perf_counter() - began
    robust = mbm.loads(EPOCHS.replace("(for-each epoch)", "(for-each epoch) (solve :robust lmeds)")).compile(
        data=tables
    )
    solved = compiled.solve()
    agreed = robust.solve()
    seconds = {
        "read, check, derive": compiling,
        "solve, one thread": timed(lambda: compiled.solve(workers=1)),
        "solve, all cores": timed(compiled.solve),
        "LMedS and refit, all cores": timed(robust.solve),
        "table of all": timed(solved.table),
        "table of all as CSV": timed(lambda: write_solves(solved.result, io.StringIO())),
        "document as JSON": timed(solved.to_json),
    }
    peer, places = scipy_seconds(tables["ranges"]["range"].reshape(-1, 48)[:PEER_COUNT])
    ours = np.array([s.estimates[0].value for s in solved.solves[:PEER_COUNT]])
    print(f"\n{EPOCH_COUNT:,} epochs of 48 ranges; largest difference from SciPy {np.abs(ours - places).max():.1e} m")
    print(f"statuses: plain {solved.status}, consensus {agreed.status}\n")
    each = 1e6 / EPOCH_COUNT
    lines = [[name, f"{s:.2f}", f"{s * each:.0f}", f"{s * each / (peer * 1e6):.3f}"] for name, s in seconds.items()]
    lines.append([f"SciPy lm, {PEER_COUNT} epochs", f"{peer * PEER_COUNT:.2f}", f"{peer * 1e6:.0f}", "1.000"])
    show(["stage", "seconds", "µs an epoch", "× SciPy"], lines)


if __name__ == "__main__":
    main()
