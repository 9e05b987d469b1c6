"""Constraints and bounds that hold the estimates, put into the equations that consensus looks at.

Each constraint tells one unknown, which follows from the others (`mbm.solver.consensus_constraints`), a bound the one
that it holds.
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

    They tell as many coordinates as there are ``columns``, among all; ``bounded`` are those that bounds hold.
    """

    equations: Assembled
    which: Mask
    columns: Indices
    bounded: Indices

    def told(self, equations: Assembled) -> int:
        """How many coordinates they tell of those that some of the equations have free."""
        return equations.dimension - len(self._free(equations)) + int(np.isin(self.columns, equations.free).sum())

    def _free(self, equations: Assembled) -> Indices:
        """The coordinates that bounds leave of those that some of the equations have free; all if that is none."""
        found = equations.free[~np.isin(equations.free, self.bounded)]
        return found if len(found) else equations.free

    def upon(self, equations: Assembled) -> Assembled:
        """Some of the equations over some coordinates, with what holds these as their constraints."""
        left = self._free(equations)
        free = np.zeros(len(equations.layout.number), dtype=bool)
        free[left] = True
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
        others = equations if len(left) == equations.dimension else equations.freed(left, equations.numbers)
        return replace(others, constraints=tuple(groups), equality=told)


def held_by(equations: Assembled, point: Floats, which: Mask, at_bound: Mask | None = None) -> Held | None:
    """The constraints ``which`` (k,) as equations that are put in, and the coordinates ``at_bound`` (n,) of the point.

    None: there is nothing, or it tells nothing there.
    """
    bounded = np.zeros(equations.dimension, dtype=bool) if at_bound is None else at_bound
    if not (which.any() or bounded.any()):
        return None
    slopes = equations.constraint_jacobian(point)[which]
    slopes[:, bounded] = 0.0
    lengths = np.sqrt(np.square(slopes).sum(axis=1, keepdims=True))
    left = slopes / np.where(lengths > 0.0, lengths, 1.0)
    if not np.isfinite(left).all():
        return None
    columns: list[int] = []
    while left.size and float(np.abs(left).max()) > INDEPENDENT:
        row, column = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        columns.append(int(column))
        left = left - np.outer(left[:, column], left[row]) / left[row, column]
    if not (columns or bounded.any()):
        return None
    told = equations.free[columns] if columns else equations.free[:0]
    return Held(equations=equations, which=which, columns=told, bounded=equations.free[bounded])


def with_held(held: Held | None, equations: Assembled) -> Assembled:
    """The equations with what is held as their constraints, and no others."""
    if held is not None:
        return held.upon(equations)
    return replace(equations, constraints=(), equality=equations.equality[:0]) if equations.constraints else equations
