"""Our rows in two versions of mbm by turns: is this checkout slower than another commit?

python -m benchmarks.pairs VERSION [--than VERSION] [--pairs 24] [--only ROW]…

A VERSION is a commit of this repository or the folder of a checkout; it is compared with this checkout, or with the
one of ``--than``. Each version runs in processes of its own, which prepare a row (`benchmarks.paired_rows` of this
checkout, so that both do the same work) and answer a line of input with the processor seconds of some warm calls. The
versions take turns, and who begins changes from pair to pair. Processes are started anew for each of `LIVES`, so that
the luck of where a process lies in memory is among the noise. The ratio is the median over the pairs; its interval is
that of the sign test, which holds with 95 % whatever the distribution of the noise. A row fails where the whole
interval lies above `ALLOWED`.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.machine import show
from benchmarks.peers import ROOT, one_thread

ALLOWED = 1.03
WIDE = 0.1
"""Width of an interval from which instructions are to be counted instead."""
CONFIDENCE = 0.95
LIVES = 3
LEAST_SECONDS = 0.1
"""Processor seconds of a measurement, by as many calls as that takes."""
MANY, ENOUGH = ("ranges", "lmeds"), 30
"""Rows of many solves, and their calls after which all that the solver and consensus make of themselves is made."""
WORKER = """
import sys
version, root, row = sys.argv[1:]
sys.path[:1] = [version]
import mbm
sys.path[:1] = [root]
from benchmarks.pairs import answer
answer(row)
"""
"""The program of a worker: `mbm` of one version, the rows of this checkout."""


def processor_seconds() -> float:
    """What this process and the processes that it waited for took of the processor."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def answer(row: str) -> None:
    """Answer each number of calls on the input with their processor seconds, until the input ends."""
    from benchmarks.paired_rows import ROWS

    call = ROWS[row]()
    call()
    print("ready", flush=True)
    for given in sys.stdin:
        began = processor_seconds()
        for _ in range(int(given)):
            call()
        print(processor_seconds() - began, flush=True)


class Worker:
    """A process that has one row of one version ready."""

    def __init__(self, version: Path, row: str) -> None:
        command = [sys.executable, "-c", WORKER, str(version), str(ROOT), row]
        store = f"{os.environ.get('MBM_CACHE', ROOT / 'build' / 'pairs')}-{version.name}"
        variables = {**one_thread(), "PYTHONHASHSEED": "0", "MBM_CACHE": store, "PYTHONPATH": ""}
        self.process = subprocess.Popen(
            command, env=variables, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._line()

    def seconds(self, calls: int) -> float:
        """Processor seconds of a call."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{calls}\n")
        self.process.stdin.flush()
        return float(self._line()) / calls

    def end(self) -> None:
        """Let the process end."""
        self.process.communicate()

    def _line(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            message = f"a worker ended with {self.process.wait()}"
            raise RuntimeError(message)
        return line


def measured(row: str, versions: tuple[Path, Path], pairs: int) -> tuple[list[float], list[float]]:
    """Processor seconds of a call in each of the pairs, by the one version and the other."""
    found: tuple[list[float], list[float]] = ([], [])
    for life in range(LIVES):
        workers = [Worker(version, row) for version in versions]
        calls = max(1, math.ceil(LEAST_SECONDS / max(1e-9, max(worker.seconds(1) for worker in workers))))
        for pair in range(pairs * life // LIVES, pairs * (life + 1) // LIVES):
            for i in (0, 1) if pair % 2 else (1, 0):
                found[i].append(workers[i].seconds(calls))
        for worker in workers:
            worker.end()
    return found


def warmed(versions: tuple[Path, Path]) -> None:
    """Let each version keep the solver's fast code, which is made after many solves only: it serves from the start."""
    for version in versions:
        for row in MANY:
            worker = Worker(version, row)
            worker.seconds(ENOUGH)
            worker.end()


def interval(values: Sequence[float]) -> tuple[float, float]:
    """Limits of the median by the sign test: order statistics, with at least `CONFIDENCE` for 6 values and more."""
    count, tail, rank = len(values), 0.0, 0
    ordered = sorted(values)
    while rank < count // 2:
        tail += math.comb(count, rank) / 2.0**count
        if 2 * tail > 1 - CONFIDENCE:
            break
        rank += 1
    return ordered[max(0, rank - 1)], ordered[count - max(1, rank)]


def checkout(version: str, folder: Path) -> Path:
    """The folder of a version; a commit is written into ``folder``."""
    if Path(version).is_dir():
        return Path(version).resolve()
    into = folder / version
    into.mkdir()
    archive = subprocess.run(["git", "archive", version, "mbm", "grammar"], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(into)], input=archive.stdout, check=True)
    return into


def main() -> int:
    """Print a line for each row; 1 if one is slower."""
    from benchmarks.paired_rows import ROWS

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="what this checkout is compared with: a commit or a folder")
    parser.add_argument("--than", default=str(ROOT), help="the other version, in place of this checkout")
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--only", action="append", choices=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    words = parser.parse_args()
    lines, slower = [], False
    with tempfile.TemporaryDirectory() as folder:
        versions = checkout(words.version, Path(folder)), checkout(words.than, Path(folder))
        warmed(versions)
        for row in words.only or ROWS:
            before, now = measured(row, versions, words.pairs)
            ratios = [b / a for a, b in zip(before, now, strict=True)]
            low, high = interval(ratios)
            slower |= low > ALLOWED
            note = "SLOWER" if low > ALLOWED else "wide: count instructions" if high - low > WIDE else ""
            cells = [f"{1e3 * median(before):.3f}", f"{1e3 * median(now):.3f}"]
            lines.append([row, *cells, f"{median(ratios):.3f}", f"{low:.3f} … {high:.3f}", note])
            print(" ".join(lines[-1]), file=sys.stderr)
    show(["row", "ms before", "ms now", "ratio", "95 %", ""], lines)
    return int(slower)


if __name__ == "__main__":
    sys.exit(main())
