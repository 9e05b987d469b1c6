"""Points as a PLY file in text, in metres."""

from __future__ import annotations

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.problem.types import Problem, UnknownKind
from mbm.report.scenes import faults
from mbm.report.scenes.types import Files, numbers, words
from mbm.text.types import MbmError

FORM = "ply"


def written(problem: Problem, solution: Solution) -> Files:
    """A file for each family of points.

    Raises:
        MbmError: format-needs: there is none.

    """
    found: Files = {}
    families = [
        entry
        for entry in solution.layout.entries
        if entry.keys is not None and entry.unknown.kind is UnknownKind.VECTOR and entry.unknown.shape == (3,)
    ]
    if not families:
        raise MbmError(
            faults.format_needs(FORM, "a family of points: `(NAME (vector 3) :per TABLE)` among the unknowns")
        )
    for entry, name in zip(families, words([entry.unknown.name for entry in families]), strict=True):
        points = solution.numbers[entry.range].reshape(-1, 3)
        kept = points[np.isfinite(points).all(axis=1)]
        lines = [
            "ply",
            "format ascii 1.0",
            f"element vertex {len(kept)}",
            *(f"property double {axis}" for axis in "xyz"),
            "end_header",
            *map(numbers, kept),
        ]
        found[f"{name}.ply"] = ("\n".join(lines) + "\n").encode()
    return found
