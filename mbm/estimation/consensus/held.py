"""Constraints that hold the estimates, put into the equations that consensus looks at.

Each tells one unknown, which follows from the others (`mbm.solver.consensus_constraints`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.excerpt import with_rows
from mbm.equations.types import Floats, Indices, Mask
from mbm.solver.consensus_constraints import INDEPENDENT
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """Constraints of some ``equations``, those ``which`` (k,), that hold as equations do.

    They tell as many coordinates as there are ``columns``, among all.
    """

    equations: Assembled
    which: Mask
    columns: Indices

    def told(self, equations: Assembled) -> int:
        """How many coordinates they tell of those that some of the equations have free."""
        return int(np.isin(self.columns, equations.free).sum())

    def upon(self, equations: Assembled) -> Assembled:
        """Some of the equations over some coordinates, with what holds these as their constraints."""
        free = np.zeros(len(equations.layout.number), dtype=bool)
        free[equations.free] = True
        groups: list[Group] = []
        equality: list[Mask] = []
        for group in self.equations.constraints:
            lines = self.which[group.first : group.first + group.count].reshape(group.rows, -1)
            mine = free[group.touched].any(axis=1) & lines.any(axis=1)
            for pattern in np.unique(lines[mine], axis=0):
                rows = np.flatnonzero(mine & (lines == pattern).all(axis=1))
                first = sum(len(each) for each in equality)
                groups.append(replace(with_rows(group, rows), first=first))
                equality.append(np.tile(pattern, len(rows)))
        told = np.concatenate(equality) if equality else np.zeros(0, dtype=bool)
        return replace(equations, constraints=tuple(groups), equality=told)


def held_by(equations: Assembled, point: Floats, which: Mask) -> Held | None:
    """The constraints ``which`` (k,) as equations that are put in; None: none are, or they tell nothing there."""
    if not which.any():
        return None
    slopes = equations.constraint_jacobian(point)[which]
    lengths = np.sqrt(np.square(slopes).sum(axis=1, keepdims=True))
    left = slopes / np.where(lengths > 0.0, lengths, 1.0)
    if not np.isfinite(left).all():
        return None
    columns: list[int] = []
    while left.size and float(np.abs(left).max()) > INDEPENDENT:
        row, column = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        columns.append(int(column))
        left = left - np.outer(left[:, column], left[row]) / left[row, column]
    if not columns:
        return None
    return Held(equations=equations, which=which, columns=equations.free[columns])


def with_held(held: Held | None, equations: Assembled) -> Assembled:
    """The equations with what is held as their constraints, and no others."""
    if held is not None:
        return held.upon(equations)
    return replace(equations, constraints=(), equality=equations.equality[:0]) if equations.constraints else equations
