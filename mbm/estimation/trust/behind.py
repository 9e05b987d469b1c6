"""Whether most rows of a clause see their points behind the camera: a mirror image, which no photograph shows.

Angles and rotations that are known no better than if nothing were known of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.at_rows import AtRows, pinholes, rows_at
from mbm.equations.layout import Layout
from mbm.equations.solves import Lines, Solves, alone
from mbm.equations.types import Floats, Indices
from mbm.estimation.trust import faults
from mbm.estimation.trust.fits import Said, only
from mbm.problem.manifold import Piece
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

ANY_TURN = np.pi / np.sqrt(3.0)
"""The standard deviation of an angle of which nothing is known, rad: that of the uniform distribution on a turn."""


def turned_anyhow(layout: Layout, free: Indices, sigma: Floats) -> Said:
    """The warnings about K solves whose free coordinates have the standard deviations ``sigma`` (K, n)."""
    turning = layout.angle.copy()
    for curved in layout.curved:
        turning[curved.coordinates] |= curved.piece in (Piece.QUATERNION, Piece.SPHERE)
    wide = turning[free] & np.isfinite(sigma) & (sigma > ANY_TURN)
    for place in np.flatnonzero(wide.any(axis=1)).tolist():
        for entry in layout.entries:
            mine = wide[place] & (free >= entry.coordinates.start) & (free < entry.coordinates.stop)
            if mine.any():
                names = [layout.name(each) for each in free[mine].tolist()]
                widest = float(sigma[place][mine].max())
                yield place, partial(faults.any_turn, entry.unknown.span, names, widest)


def behind_at(
    problem: Problem, equations: Assembled, tables: Mapping[str, Table], numbers: Floats
) -> tuple[Diagnostic, ...]:
    """The warnings about one solve whose equations have these ``numbers`` (N,) at its end."""
    if not any(map(pinholes, equations.groups)):
        return ()

    def seeing(lines: Lines) -> AtRows:
        return rows_at(problem, lines.group, equations.layout, tables, numbers)

    return only(mostly_behind(problem, alone(equations), 1, seeing))


@np.errstate(all="ignore")
def mostly_behind(problem: Problem, solves: Solves, count: int, seeing: Callable[[Lines], AtRows]) -> Said:
    """Warnings about K = ``count`` solves; ``seeing`` gives rows at their ends."""
    found: dict[int, Indices] = {}
    for each in solves.lines:
        owner = each.group.kernel.owner
        if problem.blocks[owner].role is not BlockRole.OBSERVATION or not pinholes(each.group) or not len(each.solve):
            continue
        behind = seeing(each).behind()
        if behind is not None:
            own = found.setdefault(owner, np.zeros((2, count), dtype=np.int64))
            own += [np.bincount(each.solve[behind], minlength=count), np.bincount(each.solve, minlength=count)]
    for owner, (behind, rows) in found.items():
        block = problem.blocks[owner]
        for place in np.flatnonzero(2 * behind > rows).tolist():
            yield place, partial(faults.behind_camera, block.span, block.name, int(behind[place]), int(rows[place]))
