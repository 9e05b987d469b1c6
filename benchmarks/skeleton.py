"""Random starts for the stick figure of 25 angles within its joint limits: how many reach the best posture, how fast.

python -m benchmarks.skeleton [STARTS]

``by parts`` is how a solve searches; ``all together`` moves all unknowns of a start at once, as peers do.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show
from mbm.solution.descent import descent
from mbm.solution.estimate import assemble
from mbm.solution.multistart import starting_points
from mbm.solution.settings import settings_of
from tests.evidence.material import shared_json
from tests.evidence.skeleton_limits import write_example

STARTS = 500
NEAR = 1e-6
"""Relative difference of a cost from the best one."""


def main() -> None:
    """The table."""
    starts = int(sys.argv[1]) if len(sys.argv) > 1 else STARTS
    best = shared_json("reference", "skeleton", "expected.json")["global_cost"]
    with tempfile.TemporaryDirectory() as folder:
        compiled = mbm.load(write_example(Path(folder), starts)).named("skeleton-limits").compile()
    found = compiled.elaborated
    settings = settings_of(found.problem.request)
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    points = np.array([start.point for start in starting_points(equations, settings, None)])
    by_parts = descent(equations, found.problem, lambda: False)
    rows = []
    for name, way in (("by parts", by_parts), ("all together", replace(by_parts, order=None))):
        began = perf_counter()
        ends = way.ends(points)
        seconds = perf_counter() - began
        reached = np.isclose(ends.cost, best, rtol=NEAR).mean()
        rows.append([f"mbm, {name}", f"{100 * reached:.1f} %", f"{1e3 * seconds / starts:.2f} ms"])
    began = perf_counter()
    solve = compiled.solve().first
    seconds = perf_counter() - began
    tally = solve.starts
    if tally is None:
        message = "there were no starts"
        raise ValueError(message)
    rows.append(["mbm, whole solve", f"{100 * tally.best_found / starts:.1f} %", f"{1e3 * seconds / starts:.2f} ms"])
    rows.append(["SciPy, finite differences (quoted)", "1 … 8 %", "250 … 450 ms"])
    rows.append(["CasADi Jacobian, loop in Python (quoted)", "1 … 8 %", "16 … 18 ms"])
    rows.append(["gtsam (quoted)", "1 … 8 %", "9.3 ms"])
    print(machine())
    show(["", f"best of {starts} starts", "per start"], rows)
    equal = sum(a.cost < best * (1 + NEAR) for a in solve.alternatives) + 1
    print(f"{equal} postures of the best cost, {len(solve.alternatives) + 1} minima")


if __name__ == "__main__":
    main()
