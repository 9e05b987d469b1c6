"""What all benchmarks share: the machine in one line, the best of several runs, a plain table."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time


def machine() -> str:
    """Processor, Python, and the versions of the libraries that do the arithmetic or compile it."""
    import casadi
    import numpy
    import sympy

    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    versions = f"NumPy {numpy.__version__}, CasADi {casadi.__version__}, SymPy {sympy.__version__}"
    try:
        import llvmlite

        versions += f", llvmlite {llvmlite.__version__}"
    except ImportError:
        pass
    return f"{model}, {os.cpu_count()} processors, Python {platform.python_version()}, {versions}"


def best(call: Callable[[], object], runs: int = 5, clock: Callable[[], float] = process_time) -> float:
    """Processor seconds of the fastest of several calls; by another ``clock``, what that says."""
    seconds = []
    for _ in range(runs):
        start = clock()
        call()
        seconds.append(clock() - start)
    return min(seconds)


def show(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table, first column left, the others right."""
    widths = [max(len(r[i]) for r in (heads, *rows)) for i in range(len(heads))]
    for row in (heads, *rows):
        cells = [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
        print("  ".join(cells).rstrip())
