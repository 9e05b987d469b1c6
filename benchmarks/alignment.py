"""2,174 pairs of positions laid on one another by a similarity: the estimator, the command, and evo's two.

The data are those of the shared material (``MBM_SHARED``, or beside the checkout).
"""

from __future__ import annotations

import gzip
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.bundle import SHARED
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.machine import best
from benchmarks.peers import UnavailableError, asked, one_thread

TRUTH, TRACK = "fr2_desk_groundtruth.txt.gz", "fr2_desk_ORB.txt"
TOLERANCE = 0.01
"""Seconds between the times of a pair."""
ASKED_SECONDS = 0.3e-3
RUNS = 5
TEXT = f"""
(problem align
  (data truth (tum "truth.txt"))
  (data track (tum "track.txt"))
  (pair both (track truth) :by t :tolerance {TOLERANCE}s)
  (unknowns (S (similarity 3)))
  (observe both (= [truth.x truth.y truth.z] (transform S [track.x track.y track.z])) :sigma 1cm))
"""
STREAM = """
(problem align
  (data both external)
  (unknowns (S (similarity 3)))
  (observe both (= [u v w] (transform S [x y z])) :sigma 1cm))
"""
"""The same for pairs that come as columns. It starts at the estimates for what it was compiled with."""
NAMES = tuple("uvwxyz")
INPUTS = tuple(f"both.{name}.{axis}" for name in ("truth", "track") for axis in "xyz")


def figures() -> list[Figure]:
    """Seconds of an alignment with covariance, and of the whole command."""
    source = SHARED / "data" / "trajectory"
    if not (source / TRUTH).exists():
        return [Figure(work="trajectory alignment", ours="", compared="the shared material is not here")]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "truth.txt").write_bytes(gzip.decompress((source / TRUTH).read_bytes()))
        (folder / "track.txt").write_bytes((source / TRACK).read_bytes())
        (folder / "align.mbm").write_text(TEXT)
        return _compared(folder)


def _displaced(columns: list[np.ndarray]) -> list[np.ndarray]:
    """The same pairs with the track turned by 5°, 2 % larger and 0.1 m off, so that the start is no answer."""
    c, s = np.cos(np.radians(5)), np.sin(np.radians(5))
    x, y, z = columns[3:]
    return [*columns[:3], 1.02 * (c * x - s * y) + 0.1, 1.02 * (s * x + c * y), 1.02 * z]


def _compared(folder: Path) -> list[Figure]:
    compiled = mbm.load(folder / "align.mbm").compile()
    both = compiled.elaborated.tables["both"]
    columns = [np.array(both.columns[n.removeprefix("both.")].numbers) for n in INPUTS]
    estimator = (
        mbm.loads(STREAM).compile(data={"both": dict(zip(NAMES, _displaced(columns), strict=True))}).estimator(*NAMES)
    )
    one = estimator(*columns)
    alone = best(lambda: estimator(*columns), 200)
    command = [sys.executable, "-m", "mbm", "solve", str(folder / "align.mbm"), "-q"]
    # As an installed program: with its modules compiled, and the problem met before.
    variables = {k: v for k, v in one_thread().items() if k != "PYTHONDONTWRITEBYTECODE"}
    variables |= {"PYTHONPYCACHEPREFIX": str(folder / "modules"), "MBM_CACHE": str(folder / "cache")}
    process = best(lambda: subprocess.run(command, check=True, env=variables, capture_output=True), RUNS, perf_counter)
    pairs = len(both)
    work = f"similarity of {pairs:,} pairs, with covariance"
    files = [str(folder / f"{n}.txt") for n in ("truth", "track")]
    try:
        answer = asked("alignment", ("evo",), {}, *files, str(TOLERANCE))
    except UnavailableError as error:
        return [Figure(work=work, ours=duration(alone), asked="≤ 0.3 ms", compared=str(error))]
    other = answer.found
    quaternion, shift, scale = one.values[:4], one.values[4:7], one.values[7]
    w, x, y, z = quaternion
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    apart = max(abs(scale - other["scale"]), np.abs(turn - other["turn"]).max(), np.abs(shift - other["shift"]).max())
    same = f"differ by {apart:.0e}; {pairs:,} and {other['pairs']:,} pairs"
    return [
        Figure(
            work=work,
            ours=duration(alone),
            peer=f"{answer.versions}, `umeyama_alignment` (no covariance)",
            theirs=duration(other["closed form"]),
            ratio=other["closed form"] / alone,
            asked="≤ 0.3 ms",
            reached=alone <= ASKED_SECONDS,
            compared=same,
        ),
        Figure(
            work=work,
            ours=duration(alone),
            peer=f"{answer.versions}, `align`",
            theirs=duration(other["align"]),
            ratio=other["align"] / alone,
        ),
        Figure(
            work="… the command, files and pairing included",
            ours=duration(process),
            peer=f"{answer.versions}, `evo_ape`",
            theirs=duration(other["command"]),
            ratio=other["command"] / process,
            asked="no slower",
            reached=process <= other["command"],
        ),
    ]


def main() -> None:
    show_figures(figures())


if __name__ == "__main__":
    main()
