"""The shared example with joint limits, its data written beside it from the reference."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from tests.evidence.material import shared, shared_json
from tests.evidence.skeleton import PATHS, POSE


def write_example(folder: Path, starts: int) -> Path:
    """The problem file in ``folder``, with so many random starts in place of its 500."""
    text = shared("examples", "skeleton.mbm").read_text("utf-8")
    if "(random 500 :seed 7)" not in text:
        message = "the shared example says something else"
        raise ValueError(message)
    path = folder / "skeleton.mbm"
    path.write_text(text.replace("(random 500", f"(random {starts}"), "utf-8")
    with shared("reference", "skeleton", "joints.csv").open() as stream:
        joints = [[row["joint"], PATHS[row["joint"]], row["X"], row["Y"]] for row in csv.DictReader(stream)]
    given = shared_json("reference", "skeleton", "inputs.json")
    truth = shared_json("reference", "skeleton", "truth.json")
    limits = given["joint_limits_deg"]
    dofs = [[n, *limits[n], math.degrees(truth[n])] for n in given["unknowns"] if n not in POSE]
    heads = {"joints": ["joint", "path", "X", "Y"], "dofs": ["dof", "lo", "hi", "near"]}
    for (name, head), rows in zip(heads.items(), (joints, dofs), strict=True):
        with (folder / f"skeleton_{name}.csv").open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows([head, *rows])
    return path
