"""What a generated solver in Python takes beside the one in C: a camera from 13 photographs of a board, 87 unknowns.

Whole processes, by turns, processor time of the best of several runs; numerical libraries on one thread.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.figures import duration
from benchmarks.machine import machine
from benchmarks.peers import one_thread
from benchmarks.scenes import BOARDS, board_photographs

RUNS = 7
MOST = 20.0
"""Times that Python may take what C takes."""


def processor_seconds(command: list[str], folder: Path) -> float:
    """User time of a process that must end well."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    subprocess.run(command, cwd=folder, env=one_thread(), check=True, capture_output=True)
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def measured() -> dict[str, float]:
    """Seconds of the program in each language."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "boards.mbm").write_text(BOARDS, encoding="utf-8")
        tables = board_photographs()
        for table, text in tables.items():
            (folder / f"{table}.csv").write_text(text, encoding="utf-8")
        for target in ("c", "python"):
            command = [sys.executable, "-m", "mbm", "compile", "boards.mbm", "--target", target, "-o", target, "-q"]
            subprocess.run(command, cwd=folder, check=True)
        subprocess.run(["make", "boards"], cwd=folder / "c", check=True, capture_output=True)
        data = [str(folder / f"{table}.csv") for table in tables]
        commands = {"c": ["./boards", *data], "python": [sys.executable, "boards.py", *data]}
        best = dict.fromkeys(commands, float("inf"))
        for _ in range(RUNS):
            for target, command in commands.items():
                best[target] = min(best[target], processor_seconds(command, folder / target))
    return best


def main() -> None:
    best = measured()
    print(machine())
    ratio = best["python"] / best["c"]
    print(f"C {duration(best['c'])}, Python {duration(best['python'])}: {ratio:.1f} times (asked: {MOST:.0f})")


if __name__ == "__main__":
    main()
