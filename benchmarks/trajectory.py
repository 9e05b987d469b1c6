"""``mbm trajectory`` beside evo, as whole processes on the same files: the least of several runs each, and their ratio.

Run as ``python benchmarks/trajectory.py [FOLDER]``; FOLDER holds trajectories of the TUM benchmark (by default that of
MBM_SHARED). evo is started as its users start it, by ``evo_ape`` with the alignment asked for.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 5
CASES = (
    ("SE(3)", "(pose 3)", ["-a"], "freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-rgbdslam.txt"),
    ("Sim(3)", "(similarity 3)", ["-as"], "freiburg1_xyz-groundtruth.txt", "freiburg1_xyz-ORB_kf_mono.txt"),
)
PROBLEM = """(problem p
  (data ref (tum "{ref}"))
  (data est (tum "{est}"))
  (pair both (ref est) :by t :tolerance 10ms)
  (unknowns (S {kind}))
  (observe both (= [ref.x ref.y ref.z] (transform S [est.x est.y est.z]))))
"""


def least(command: list[str]) -> float:
    """The least time of several runs, in seconds; the first, which may fill caches, does not count."""
    times = []
    for _ in range(RUNS + 1):
        begin = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        times.append(time.perf_counter() - begin)
    return min(times[1:])


def main() -> None:
    """Print one line for each alignment."""
    shared = Path(os.environ.get("MBM_SHARED", "../shared"))
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else shared / "data" / "trajectory"
    evo = shutil.which("evo_ape", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if evo is None or not folder.exists():
        print("evo is not installed, or there are no trajectories")
        return
    with tempfile.TemporaryDirectory() as place:
        for name, kind, options, ref, est in CASES:
            file = Path(place) / "p.mbm"
            paths = [(folder / each).resolve().as_posix() for each in (ref, est)]
            file.write_text(PROBLEM.format(ref=paths[0], est=paths[1], kind=kind))
            own = least([sys.executable, "-m", "mbm", "trajectory", str(file)])
            other = least([evo, "tum", *paths, *options])
            print(f"{name}: mbm {own:.3f} s, evo {other:.3f} s, ratio {own / other:.2f}")


if __name__ == "__main__":
    main()
