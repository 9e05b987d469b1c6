"""Runs the comparisons and writes docs/explanations/speed.md: machine, versions, date, who measured what.

python -m benchmarks.table [--long] [NAME…]

Each runs in a process of its own, on one thread unless it says otherwise. What was measured is kept in
``build/benchmarks``, so that single comparisons can be made again; the page shows the latest of each.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from dataclasses import asdict
from datetime import UTC, datetime

from benchmarks.figures import HEADS, Figure
from benchmarks.machine import machine
from benchmarks.peers import ROOT, last_line, one_thread

KEPT = ROOT / "build" / "benchmarks"
PAGE = ROOT / "docs" / "explanations" / "speed.md"
SHORT = {
    "nist": "NIST StRD",
    "desk": "A desk pose",
    "alignment": "Trajectory alignment",
    "ellipse": "An implicit ellipse",
    "skeleton": "A figure of 25 angles from random starts",
    "reprojection": "A kernel: one row with its derivatives",
    "startup": "A small problem as a whole process",
}
LONG = {
    "epochs": "10,000 epochs of 48 ranges",
    "for_each": "Many solves in one call",
    "multilateration": "48 ranges with outliers",
    "pose": "Pose from points with gross errors",
    "bundle": "Bundle adjustment and pose graphs",
}
"""Comparisons that take minutes."""
HEAD = """# Speed

<!-- Made by `python -m benchmarks.table`; do not edit. -->

Ratios of one run each, on one machine, with the same data; the machine was shared, so read the ratios and not the
times. A ratio is the peer's time over ours: above 1 mbm is faster. Peers are installed by the benchmarks in an
environment of their own; a figure that is *quoted* was measured elsewhere. **no** in the column `reached` says that
what was asked is not reached. Each section is repeated by `python -m benchmarks.NAME`.

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
    PAGE.write_text(page())


def page() -> str:
    """The page from what was kept."""
    parts = [HEAD]
    for name, title in {**SHORT, **LONG}.items():
        path = KEPT / f"{name}.json"
        if not path.exists():
            continue
        kept = json.loads(path.read_text())
        rows = [Figure(**each).cells() for each in kept["figures"]]
        parts.append(f"## {title}\n\n`benchmarks.{name}`, {kept['when']}, {kept['machine']}\n\n{markdown(rows)}\n")
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def markdown(rows: list[list[str]]) -> str:
    """The lines of a section as a table; columns that are empty throughout are left out."""
    used = [i for i in range(len(HEADS)) if any(row[i] for row in rows)]
    lines = [[HEADS[i] for i in used], ["---"] * len(used), *([row[i] for i in used] for row in rows)]
    return "\n".join(f"| {' | '.join(cell.replace('|', '∣') for cell in line)} |" for line in lines)


if __name__ == "__main__":
    main()
