"""Many small problems in one call: 10,000 places from 48 ranges each, stage by stage, beside SciPy; and by kinds.

python -m benchmarks.for_each [KIND…]
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from time import perf_counter

import numpy as np

import mbm
from benchmarks.figures import Figure, duration
from benchmarks.kinds import KINDS
from benchmarks.machine import machine, show
from benchmarks.scenes import EPOCHS, ceiling, epoch_tables

EPOCH_COUNT = 10_000
KIND_COUNT = 5_000
FEW = 200
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


def kind_seconds(name: str) -> tuple[float, float, float]:
    """Seconds a solve of one kind on one processor, on all of them, and one by one."""
    from mbm.estimation.batches import together

    kind, count = KINDS[name], KIND_COUNT
    compiled = mbm.loads(kind.text).compile(data=kind.data(count))
    compiled.solve()
    alone = timed(lambda: compiled.solve(workers=1)) / count
    every = timed(compiled.solve) / count
    compiled = mbm.loads(kind.text).compile(data=kind.data(FEW))
    usual, together.FEW_SOLVES = together.FEW_SOLVES, FEW
    try:
        compiled.solve()
        one_by_one = timed(compiled.solve) / FEW
    finally:
        together.FEW_SOLVES = usual
    return alone, every, one_by_one


def figures() -> list[Figure]:
    """Seconds a solve of each kind, and what the processors bring."""
    lines = []
    for name in KINDS:
        alone, every, one_by_one = kind_seconds(name)
        lines.append(
            Figure(
                work=f"{name}, one processor, a solve",
                ours=duration(alone),
                peer="mbm, one by one",
                theirs=duration(one_by_one),
                ratio=one_by_one / alone,
                compared=f"{os.cpu_count()} processors: {duration(every)}",
            )
        )
    return lines


def main() -> None:
    """Print the tables, or the kinds that are named."""
    names = sys.argv[1:]
    if not names:
        stages()
    lines = []
    for name in names or KINDS:
        alone, every, one_by_one = kind_seconds(name)
        cells = [f"{1e6 * s:.0f}" for s in (alone, every, one_by_one)]
        lines.append([name, *cells, f"{one_by_one / alone:.0f}", f"{alone / every:.2f}"])
    print()
    heads = [
        "µs a solve, 24 ranges",
        "one processor",
        f"{os.cpu_count()} processors",
        "one by one",
        "×",
        "× processors",
    ]
    show(heads, lines)


def stages() -> None:
    """Print the stages of 10,000 solves."""
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
