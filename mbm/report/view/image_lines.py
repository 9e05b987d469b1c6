"""Lines in images: those that were measured, as (α, ρ), and the edges that the answer predicts, from end to end.

Both ends of a predicted edge stand beside their feet on the measured line: what they are apart is what α and ρ say.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.binding import Group
from mbm.estimation.search.solution import Solution
from mbm.problem.types import Problem
from mbm.report.types import Mask
from mbm.report.view.images import with_groups
from mbm.report.view.model_panels import Line
from mbm.report.view.near_curves import pictured
from mbm.report.view.photographs import Photograph
from mbm.report.view.seeings import LineSeeing, Seen
from mbm.report.view.values import answer_lookup, values_of

PROLONGED = 0.2
"""Of an edge's length: how far its measured line is drawn beyond either end, to be told from the edge."""


def line_photographs(problem: Problem, solution: Solution, seen: Seen) -> Iterator[Photograph]:
    """The images in which lines are measured, told apart by the column ``photo``."""
    for line, group in with_groups(solution, seen.lines):
        yield from _photographs(problem, solution, line, group)


def _photographs(problem: Problem, solution: Solution, seeing: LineSeeing, group: Group) -> Iterator[Photograph]:
    table = problem.blocks[seeing.block].table
    rows = solution.tables[table] if table is not None else None
    known = answer_lookup(solution, rows, group.positions)
    alpha, rho = values_of(seeing.measured, known, group.rows).T
    ends = values_of((*seeing.ends[0], *seeing.ends[1]), known, group.rows).reshape(-1, 2, 2)
    normals = np.stack([-np.sin(alpha), np.cos(alpha)], axis=1)
    away = np.einsum("nki,ni->nk", ends, normals) - rho[:, None]
    feet = ends - away[..., None] * normals[:, None]
    beyond = PROLONGED * (feet[:, 1] - feet[:, 0])
    drawn = np.stack([feet[:, 0] - beyond, feet[:, 1] + beyond], axis=1)
    own = np.eye(group.rows, dtype=bool)
    edges: list[tuple[Mask, Line]] = [
        (mask, Line(points=each, hidden=False)) for mask, each in zip(own, ends, strict=True)
    ]
    yield from pictured(solution, rows, group, seeing, feet, ends, edges, drawn)
