"""Large problems from files: bundle adjustment and pose graphs, each in a process of its own.

The data are those of the shared material (``MBM_SHARED``, or beside the checkout); what is absent is left out.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter, process_time

from benchmarks.machine import machine, show

SHARED = Path(os.environ.get("MBM_SHARED", Path(__file__).parents[1].parent / "shared"))
CASES = {
    "Ladybug 16-22106": ("bundle.mbm", "ladybug.txt", "data/bundle/problem-16-22106-pre.txt.bz2"),
    "CSAIL": ("pose-graph.mbm", "intel.g2o", "data/posegraph/CSAIL.g2o"),
    "intel": ("pose-graph.mbm", "intel.g2o", "data/posegraph/intel.g2o"),
    "manhattan": ("pose-graph.mbm", "intel.g2o", "data/posegraph/manhattan.g2o.gz"),
    "kitti_00": ("pose-graph.mbm", "intel.g2o", "data/posegraph/kitti_00.g2o.gz"),
}


def run_one(name: str) -> dict[str, object]:
    """One case in this process: seconds to load and solve, the sum of squares, the largest memory."""
    import mbm

    example, placeholder, data = CASES[name]
    text = (SHARED / "examples" / example).read_text().replace(placeholder, str(SHARED / data))
    began = perf_counter()
    found = mbm.loads(text).solve()
    seconds = perf_counter() - began
    solve = found.first
    return {
        "unknowns": found.observability.dimension,
        "cost": solve.cost,
        "iterations": solve.iterations,
        "status": solve.status.name.lower(),
        "solve": solve.seconds,
        "whole": seconds,
        "processor": process_time(),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def main() -> None:
    if len(sys.argv) > 1:
        print(json.dumps(run_one(sys.argv[1])))
        return
    print(machine())
    lines = []
    for name, (example, _, data) in CASES.items():
        if not (SHARED / data).exists() or not (SHARED / "examples" / example).exists():
            continue
        environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ}
        command = [sys.executable, "-m", "benchmarks.bundle", name]
        answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        one = json.loads(answer.stdout)
        lines.append(
            [
                name,
                f"{one['unknowns']:,}",
                f"{one['cost']:.4f}",
                str(one["iterations"]),
                one["status"],
                f"{one['solve']:.2f}",
                f"{one['whole']:.2f}",
                f"{one['processor']:.2f}",
                f"{one['memory']:.0f}",
            ]
        )
    heads = ["problem", "unknowns", "Σr²", "iterations", "status", "solve, s", "with reading, s", "processor, s"]
    show([*heads, "memory, MB"], lines)


if __name__ == "__main__":
    main()
