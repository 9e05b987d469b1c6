"""Random starts for the stick figure of 25 angles within its joint limits: how many reach the best posture, how fast.

python -m benchmarks.skeleton [STARTS]

``by parts`` is how a solve searches; ``all together`` moves all unknowns of a start at once, as peers do.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.peers import UnavailableError, asked
from mbm.equations.layout import Entry
from mbm.estimation.search.multistart import starting_points
from mbm.estimation.search.seeker import descent
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from tests.evidence.skeleton import COSTS, POSE, TRUTH, seen, write_example

STARTS = 500
ASKED_SHARE, ASKED_SECONDS = 0.2, 2e-3
MARGIN = 1e-3
"""Added to the box that the starts fill, so that none lies on its edge."""
LIMBS = tuple(side + joint for part in (("sh", "el", "wr"), ("hip", "kn", "an")) for side in "lr" for joint in part)
JOINTS = ("pelvis", "neck", "head", *LIMBS)
NEAR = 1e-6
"""Relative difference of a cost from the best one."""


def figures(starts: int = STARTS) -> list[Figure]:
    """Share of the starts that reach the best posture, and seconds a start: by parts, all together, whole solves."""
    best = COSTS[0]
    with tempfile.TemporaryDirectory() as folder:
        compiled = mbm.load(write_example(Path(folder), starts)).named("skeleton-limits").compile()
    found = compiled.elaborated
    settings = settings_of(found.problem.request)
    equations, _ = assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)
    points = np.array([start.point for start in starting_points(equations, settings, None)])
    by_parts = descent(equations, found.problem, settings)
    mine: dict[str, tuple[float, float]] = {}
    for name, way in (("by parts", by_parts), ("all unknowns together", replace(by_parts, order=None))):
        began = process_time()
        ends = way.ends(points)
        seconds = process_time() - began
        mine[name] = (float(np.isclose(ends.cost, best, rtol=NEAR).mean()), seconds / starts)
    began = process_time()
    solve = compiled.solve().first
    seconds = process_time() - began
    tally = solve.starts
    if tally is None:
        message = "there were no starts"
        raise ValueError(message)
    mine["whole solve"] = (tally.best_found / starts, seconds / starts)
    equal = sum(a.cost < best * (1 + NEAR) for a in solve.alternatives) + 1
    lines = []
    for name, (share, taken) in mine.items():
        asked_for = name != "all unknowns together"
        lines.append(
            Figure(
                work=f"25 angles, {starts} starts, {name}: best posture, time a start",
                ours=f"{100 * share:.1f} %, {duration(taken)}",
                asked="≥ 20 %, ≤ 2 ms" if asked_for else "",
                reached=share >= ASKED_SHARE and taken <= ASKED_SECONDS if asked_for else None,
                compared=f"{equal} postures of the best cost" if name == "whole solve" else "",
            )
        )
    return [*lines, *_peers(mine["by parts"], points, best, equations.layout.by_name)]


def _peers(mine: tuple[float, float], points: np.ndarray, best: float, places: Mapping[str, Entry]) -> list[Figure]:
    """The same starts with other programs; their unknowns stand in another order."""
    angles = places["q"]
    order = [places[n].offset if n in POSE else angles.offset + angles.index[n] for n in TRUTH]
    joints = seen()
    image = np.array([joints[joint] for joint in JOINTS]).ravel()
    starts = points[:, order]
    box = np.stack([starts.min(axis=0) - MARGIN, starts.max(axis=0) + MARGIN])
    quoted = Figure(
        work="…", ours=f"{100 * mine[0]:.0f} %, {duration(mine[1])}", peer="gtsam", theirs="1 … 8 %, 9.3 ms",
        ratio=9.3e-3 / mine[1], quoted=True,
    )  # fmt: skip
    try:
        answer = asked("skeleton", ("numpy", "scipy", "casadi"), {"image": image, "starts": starts, "box": box})
    except UnavailableError as error:
        return [quoted, Figure(work="… other programs", ours="", compared=str(error))]
    lines = []
    for name, other in answer.found.items():
        share = float(np.isclose(other["costs"], best, rtol=NEAR).mean())
        lines.append(
            replace(
                quoted,
                peer=name,
                theirs=f"{100 * share:.0f} %, {duration(other['seconds'])}",
                ratio=other["seconds"] / mine[1],
                quoted=False,
                compared="without limits a posture may be another of the same cost" if "loop" in name else "",
            )
        )
    return [*lines, quoted]


def main() -> None:
    """The table."""
    show_figures(figures(int(sys.argv[1]) if len(sys.argv) > 1 else STARTS))


if __name__ == "__main__":
    main()
