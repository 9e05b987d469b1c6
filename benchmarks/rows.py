"""Many rows of one observation table: the equations are compiled once, and evaluated for all rows in one call."""

from __future__ import annotations

import mbm
from benchmarks.machine import best, machine, show
from benchmarks.scenes import RANGE, REPROJECTION, range_rows, reprojection_rows
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import settings_of

FEW, MANY = 2_000, 200_000
PROBLEMS = {"range": (RANGE, "ranges", range_rows), "reprojection": (REPROJECTION, "marks", reprojection_rows)}


def measured(name: str, rows: int, backend: str) -> dict[str, float]:
    """Seconds for one problem with so many rows."""
    from mbm import compiler

    text, table, make = PROBLEMS[name]
    data = {table: make(rows)}
    problem = mbm.loads(text)
    compiled = problem.compile(data=data, backend=backend)
    equations, start = compiled._assembled()
    equations.residuals(start)
    equations.jacobian(start)
    settings = settings_of(compiled.elaborated.problem.request)
    return {
        "derive": best(lambda: compiler.derived(compiled.elaborated)),
        "assemble": best(compiled._assembled),
        "residuals": best(lambda: equations.residuals(start)),
        "Jacobian": best(lambda: equations.jacobian(start)),
        "minimum": best(lambda: minimise(equations, start, settings), 3),
        "solve": best(lambda: compiled.solve().diagnostics, 2),
    }


def main() -> None:
    print(machine())
    print(f"\nmilliseconds for {FEW:,} and {MANY:,} rows, and their ratio; best of five")
    heads = ["row", "backend", "stage", f"{FEW:,}", f"{MANY:,}", "ratio"]
    lines = []
    for name in PROBLEMS:
        for backend in ("casadi", "numpy", "auto"):
            few, many = (measured(name, rows, backend) for rows in (FEW, MANY))
            for stage in few:
                ratio = many[stage] / few[stage]
                lines.append(
                    [name, backend, stage, f"{1e3 * few[stage]:.2f}", f"{1e3 * many[stage]:.2f}", f"{ratio:.1f}"]
                )
    show(heads, lines)


if __name__ == "__main__":
    main()
