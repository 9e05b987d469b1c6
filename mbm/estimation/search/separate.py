"""Unknowns without a start that no equation ties to one another: each of them may be drawn by itself."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.excerpt import excerpt
from mbm.equations.scatter import tied_parts
from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass

MOST_ROWS = 20_000
"""Rows above which nobody looks: random starts are for small problems."""

MOST_PARTS = 200
"""Parts above which drawing each by itself takes longer than a search."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Separate:
    """Some of the missing coordinates (M,), and the equations that mention them, over these alone."""

    missing: Mask
    equations: Assembled


def separated(equations: Assembled, missing: Mask) -> tuple[Separate, ...]:
    """The parts into which equations fall for the ``missing`` coordinates (M,), the others being known; one: none."""
    groups = [group for group in equations.groups if group.rows]
    tied = any(group.gathered is not None or group.sampled for group in groups)
    if tied or equations.constraints or equations.rows is not None or sum(g.rows for g in groups) > MOST_ROWS:
        return ()
    rows, columns, first = [], [], 0
    for group in groups:
        line, tangent = np.nonzero(missing[group.columns])
        rows.append(first + line)
        columns.append(group.columns[line, tangent])
        first += group.rows
    part, part_of_row = tied_parts(np.concatenate(columns), np.concatenate(rows), len(missing), first)
    parts = np.unique(part[missing])
    if not 1 < len(parts) <= MOST_PARTS:
        return ()
    return tuple(_part(equations, missing & (part == each), part_of_row == each) for each in parts)


def _part(equations: Assembled, missing: Mask, mine: Mask) -> Separate:
    """The part of some coordinates (M,) and of rows (all groups',)."""
    units: list[Indices] = []
    first = 0
    for group in equations.groups:
        lines = np.flatnonzero(mine[first : first + group.rows])
        each = len(group.whiteners)
        units.append((group.first_unit + lines[:, None] * each + np.arange(each)).ravel())
        first += group.rows
    return Separate(missing=missing, equations=excerpt(equations, np.flatnonzero(missing), np.concatenate(units)))


def together(base: Floats, parts: tuple[Floats, ...]) -> Floats:
    """Points (some, N) of the best of each part together, then the second best, as long as any has more.

    ``parts`` have points (k, N) each, NaN where ``base`` (N,) is and other parts tell.
    """
    points = np.tile(base, (max(map(len, parts)), 1))
    for found in parts:
        own = np.isnan(base) & ~np.isnan(found[0])
        points[:, own] = found[np.minimum(np.arange(len(points)), len(found) - 1)][:, own]
    return points
