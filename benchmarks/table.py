"""Runs the comparisons and writes benchmarks/results.md, and what matters of it to docs/explanations/speed.md.

python -m benchmarks.table [--long] [NAME…]

Each runs in a process of its own, on one thread unless it says otherwise. What was measured is kept in
``build/benchmarks``, so that single comparisons can be made again; the pages show the latest of each.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime

from benchmarks.figures import HEADS, Figure, shown
from benchmarks.machine import machine
from benchmarks.peers import ROOT, last_line, one_thread

KEPT = ROOT / "build" / "benchmarks"
RESULTS = ROOT / "benchmarks" / "results.md"
PAGE = ROOT / "docs" / "explanations" / "speed.md"
SHORT = {
    "nist": "NIST StRD",
    "desk": "A desk pose",
    "alignment": "Trajectory alignment",
    "ellipse": "An implicit ellipse",
    "skeleton": "A figure of 25 angles from random starts",
    "reprojection": "A kernel: one row with its derivatives",
    "startup": "A small problem as a whole process",
    "stereo": "A stereo pair as a whole process",
}
LONG = {
    "epochs": "10,000 epochs of 48 ranges",
    "for_each": "Many solves in one call",
    "multilateration": "48 ranges with outliers",
    "pose": "Pose from points with gross errors",
    "bundle": "Bundle adjustment and pose graphs",
}
"""Comparisons that take minutes."""
CHOSEN = (
    ("nist", "all fits", "lmfit", "54 certified fits (NIST): with 6 / 8 correct digits, time"),
    ("desk", "one a call", "over NumPy by hand, exact", "a pose from six corners in an image, one data set a call"),
    ("alignment", "similarity", "umeyama", "a similarity from 2,174 pairs"),
    (
        "skeleton",
        "500 starts",
        "SciPy",
        "25 joint angles from 500 random starts: ending at the best posture, time a start",
    ),
    ("startup", "warm", "SciPy", "a small problem as a whole process"),
    ("epochs", "an epoch", "SciPy lm", "a place from 48 ranges, one of 10,000"),
    (
        "multilateration",
        "10 %",
        "NumPy",
        "the same with 10 % outliers by least median of squares: mean error, gross failures",
    ),
    ("pose", "20 points, 40 %", "PoseLib", "a pose from 20 points, 40 % outliers, no start"),
    ("bundle", "best of 5", "Ceres", "bundle adjustment, 66,462 unknowns (Ladybug), one processor"),
)
"""What the page in docs/ shows: the comparison, parts of the work and of the peer's name, how it is called there."""
FASTER = (
    ("ellipse", "150 points", "default tolerances", "an ellipse through 150 points, errors in both coordinates"),
    ("startup", "cold", "SciPy", "a small problem as a whole process, the first time"),
    ("epochs", "an epoch", "linear", "a place from 48 ranges, without outliers"),
    ("pose", "6 points, 0 %", "OpenCV", "a pose from 6 points, no start: error, failures"),
    ("pose", "6 points, 40 %", "PoseLib", "the same with 40 % outliers"),
)
"""The same, of work for which mbm takes longer."""
BRIEF = """# Speed

<!-- Made by `python -m benchmarks.table`; do not edit. -->

The ratio is the peer's time divided by ours: above 1, mbm is faster. Each is from one run with the same data on one
shared machine, on the day that is given: mbm has changed since. Times are those of the processor, but for bundle
adjustment. [All figures](../../benchmarks/results.md), with versions, accuracies and targets, stand beside the
benchmarks; `python -m benchmarks.NAME` repeats one.

"""
SLOWER = """
## Where a peer is faster

Examples; the others are among [all figures](../../benchmarks/results.md). A linear method without iteration is no
least-squares fit of the distances, rejects no outlier and gives no covariance. OpenCV and PoseLib give no covariance. A
process that meets a problem for the first time derives and compiles it. Of the ellipse mbm reaches the optimum in some
4 ms; the rest is the look for other minima, which is made when diagnostics are read.

"""
HEAD = """# Results of the benchmarks

<!-- Made by `python -m benchmarks.table`; do not edit. -->

Ratios of one run each, on one machine, with the same data; the machine was shared, so read the ratios and not the
times. Those of what runs on one processor are the processor's since 2026-11-27. A ratio is the peer's time over ours:
above 1 mbm is faster. Peers are installed by the benchmarks in an environment of their own; a figure that is *quoted*
was measured elsewhere. **no** in the column `reached` says that what was asked is not reached. Each section is repeated
by `python -m benchmarks.NAME`.

"""


def main() -> None:
    words = sys.argv[1:]
    if words[:1] == ["--one"]:
        module = importlib.import_module(f"benchmarks.{words[1]}")
        print(json.dumps([asdict(figure) for figure in module.figures()]))
        return
    everything = {**SHORT, **LONG} if "--long" in words else SHORT
    names = [w for w in words if not w.startswith("--")] or list(everything)
    KEPT.mkdir(parents=True, exist_ok=True)
    for name in names:
        print(f"{name} …", file=sys.stderr)
        command = [sys.executable, "-m", "benchmarks.table", "--one", name]
        run = subprocess.run(command, cwd=ROOT, env=one_thread(), capture_output=True, text=True, check=False)
        if run.returncode:
            print(f"{name}: {last_line(run.stderr)}", file=sys.stderr)
            continue
        figures = json.loads(run.stdout.splitlines()[-1])
        load = f"{machine()}, load average {os.getloadavg()[1]:.1f}"
        kept = {"when": datetime.now(UTC).strftime("%Y-%m-%d"), "machine": load, "figures": figures}
        (KEPT / f"{name}.json").write_text(json.dumps(kept, ensure_ascii=False, indent=1))
    RESULTS.write_text(results())
    PAGE.write_text(page())


def kept_figures(name: str) -> tuple[str, list[Figure]]:
    """When and where a comparison was made last, and its lines; none if it never was."""
    path = KEPT / f"{name}.json"
    if not path.exists():
        return "", []
    kept = json.loads(path.read_text())
    return f"{kept['when']}, {kept['machine']}", [Figure(**each) for each in kept["figures"]]


def results() -> str:
    """All lines of what was kept."""
    parts = [HEAD]
    for name, title in {**SHORT, **LONG}.items():
        where, figures = kept_figures(name)
        if figures:
            table = markdown(HEADS, [figure.cells() for figure in figures])
            parts.append(f"## {title}\n\n`benchmarks.{name}`, {where}\n\n{table}\n")
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def page() -> str:
    """The lines that are `CHOSEN`, then those of `FASTER`."""
    heads = ["task", "mbm", "peer", "its figure", "ratio", "measured"]
    slower = [line for line in brief(FASTER) if float(line[4]) < 1.0]
    return f"{BRIEF}{markdown(heads, brief(CHOSEN))}\n{SLOWER}{markdown(heads, slower)}\n"


def brief(chosen: Sequence[tuple[str, str, str, str]]) -> list[list[str]]:
    """The chosen lines; those that were never measured are left out. Lines that begin with … go with the one before."""
    lines = []
    for name, work, peer, called in chosen:
        whole = ""
        where, figures = kept_figures(name)
        for figure in figures:
            whole = f"{whole} {figure.work}" if figure.work.startswith("…") else figure.work
            if work in whole and peer in figure.peer and figure.ratio is not None:
                lines.append(
                    [called, figure.ours, figure.peer, figure.theirs, shown(figure.ratio), where.split(",")[0]]
                )
                break
    return lines


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lines under their heads as a table; columns that are empty throughout are left out."""
    used = [i for i in range(len(heads)) if any(row[i] for row in rows)]
    lines = [[heads[i] for i in used], ["---"] * len(used), *([row[i] for i in used] for row in rows)]
    return "\n".join(f"| {' | '.join(cell.replace('|', '∣') for cell in line)} |" for line in lines)


if __name__ == "__main__":
    main()
