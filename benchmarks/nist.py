"""NIST StRD as problem files with default settings: correct digits from both starts, iterations, seconds."""

from __future__ import annotations

import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show
from tests.evidence.nist_problems import problem_file
from tests.solution.nist import ReferenceSet, digits, read_set, shared_folder
from tests.solution.nist_typed import TYPED


def sets() -> list[ReferenceSet]:
    """The sets that were distributed with the measured data, where they are, and those typed in."""
    folder = shared_folder() / "data" / "nist_strd"
    return [*(read_set(path) for path in sorted(folder.glob("*.dat"))), *TYPED]


def row(reference: ReferenceSet, start: int) -> tuple[list[str], float]:
    """One line of the table, and the digits of the estimates."""
    with tempfile.TemporaryDirectory() as folder:
        problem = mbm.load(problem_file(reference, start, Path(folder)))
        began = perf_counter()
        compiled = problem.compile()
        compiling = perf_counter() - began
        solved = compiled.solve()
    names = [f"b{i}" for i in range(1, len(reference.certified) + 1)]
    found, sigma = np.array([[float(solved[n].value), float(solved[n].sigma)] for n in names]).T
    correct = digits(found, reference.certified)
    solve = solved.first
    cells = [reference.name, str(start + 1), f"{correct:.1f}", f"{digits(sigma, reference.deviations):.1f}"]
    times = [f"{1e3 * compiling:.0f}", f"{1e3 * (solve.seconds or 0.0):.1f}"]
    return [*cells, str(solve.iterations), str(solve.evaluations), *times, solve.status.label], correct


def main() -> None:
    print(machine())
    lines, correct = [], []
    for reference in sets():
        for start in (0, 1):
            line, found = row(reference, start)
            lines.append(line)
            correct.append(found)
    show(
        ["set", "start", "digits", "digits of sigma", "iterations", "evaluations", "compile ms", "solve ms", "status"],
        lines,
    )
    least = [sum(c >= n for c in correct) for n in (6, 8)]
    print(f"\n{len(correct)} fits: at least 6 digits {least[0]}, at least 8 digits {least[1]}")


if __name__ == "__main__":
    main()
