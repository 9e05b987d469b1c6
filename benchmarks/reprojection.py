"""A reprojection row with its derivatives (2 × 12): machine code, its stores alone, SymForce's C++, Ceres' derivatives.

The peers' loops take the unknowns anew for each row, as factors of a graph do; arrays of 1,024 rows stay in the cache.
"""

from __future__ import annotations

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.kernels import kernels, of_blocks
from benchmarks.peers import UnavailableError, asked
from benchmarks.scenes import REPROJECTION, reprojection_rows

ROWS, MANY = 1024, 65_536
ASKED_PEER, ASKED_STORES = 3.0, 2.0
START = np.array([790.0, 790, 310, 250, 0, 0, 0, 0, 0, 0, 0, 0])
"""The initial values of the problem, in the order of its unknowns."""


def figures() -> list[Figure]:
    """Nanoseconds a row, and the sums of squares of values and derivatives as a check."""
    kernel = kernels()["reprojection"]
    both = of_blocks(kernel, ROWS)[0] / ROWS
    streamed, stores, *_ = (seconds / MANY for seconds in of_blocks(kernel, MANY))
    lines = [
        Figure(
            work=f"… {MANY:,} rows, written to memory",
            ours=duration(streamed),
            peer="its stores alone",
            theirs=duration(stores),
            ratio=stores / streamed,
            asked="within 2 ×",
            reached=streamed <= ASKED_STORES * stores,
        )
    ]
    rows = reprojection_rows(ROWS)
    compiled = mbm.loads(REPROJECTION).compile(data={"marks": rows})
    sums = [float(np.square(f(np.zeros(12))).sum()) for f in (compiled.residuals, compiled.jacobian)]
    try:
        table = np.column_stack([rows[name] for name in "xyzuv"])
        answer = asked("kernel", ("symforce",), {"unknowns": START, "rows": table})
    except UnavailableError as error:
        return [*lines, Figure(work="… SymForce: 344–389 ns by its figures", ours=duration(both), compared=str(error))]
    for name, by_flags in answer.found.items():
        for flags, found in by_flags.items():
            ratio = 1e-9 * found["nanoseconds"] / both
            wanted = name == "SymForce" and flags == "-O3"
            apart = max(abs(found["values"] / sums[0] - 1), abs(found["slopes"] / sums[1] - 1))
            lines.append(
                Figure(
                    work="reprojection row, values and Jacobian",
                    ours=duration(both),
                    peer=f"{answer.versions if name == 'SymForce' else name}, g++ {flags}",
                    theirs=f"{found['nanoseconds']:.0f} ns",
                    ratio=ratio,
                    asked=f"≥ {ASKED_PEER:.0f} ×" if wanted else "",
                    reached=ratio >= ASKED_PEER if wanted else None,
                    compared=f"sums of squares differ by {apart:.0e}",
                )
            )
    return lines


def main() -> None:
    show_figures(figures())


if __name__ == "__main__":
    main()
