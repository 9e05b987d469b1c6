"""Constraints that hold the estimates, put into the equations that consensus looks at.

Each tells one unknown, which follows from the others: subsets are as many units smaller, fits keep to the constraints,
and noise has the degrees of freedom that they leave.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass

INDEPENDENT = 1e-9
"""What is left of a constraint's derivative beside those of others, as a share of its own, if it says something new."""

PUT_ROUNDS = 30
"""Newton steps to the constraints; one does where they are linear."""

PUT = 1e-9
"""The last step, as a share of the numbers that it changes, of those that led to the constraints."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Held:
    """Constraints ``rows`` (k,) of some ``equations`` that hold as equations do, none following from the others.

    Constraint i tells the plain number of the coordinate ``columns[i]``, among all.
    """

    equations: Assembled
    rows: Indices
    columns: Indices

    def within(self, equations: Assembled) -> Held | None:
        """Those that tell coordinates which some of the equations have free; None: there are none."""
        mine = np.isin(self.columns, equations.free)
        if not mine.any():
            return None
        return Held(equations=self.equations, rows=self.rows[mine], columns=self.columns[mine])

    @np.errstate(all="ignore")
    def put(self, point: Floats) -> Floats:
        """The point (N,) with the numbers that the constraints tell; NaN for these where they tell none nearby."""
        told = self.equations.layout.number[self.columns]
        found, last = point.copy(), np.inf
        for _ in range(PUT_ROUNDS):
            values, slopes = self.equations.constraint_values(found)[self.rows], self._slopes(found, self.columns)
            if not (np.isfinite(values).all() and np.isfinite(slopes).all()):
                break
            step = np.linalg.lstsq(slopes, -values, rcond=None)[0]
            found[told] += step
            size = float((np.abs(step) / np.maximum(np.abs(found[told]), PUT)).max())
            if size >= 0.5 * last or size == 0.0:
                last = min(size, last)
                break
            last = size
        if not last <= PUT:
            found[told] = np.nan
        return found

    def slopes(self, point: Floats, free: Indices) -> Floats:
        """How the coordinates that are told (k, f) change with those that are ``free`` (f,), at a point that is put."""
        own = self._slopes(point, self.columns)
        if not np.isfinite(own).all():
            return np.full((len(self.columns), len(free)), np.nan)
        return np.asarray(-np.linalg.lstsq(own, self._slopes(point, free), rcond=None)[0])

    def _slopes(self, point: Floats, columns: Indices) -> Floats:
        place = np.searchsorted(self.equations.free, columns)
        return self.equations.constraint_jacobian(point)[np.ix_(self.rows, place)]


@dataclass(frozen=True, slots=True, eq=False)
class Substituted:
    """Equations over all their coordinates, ``whole``, with what is ``held`` put in; ``equations`` have the others.

    As `Equations`, as far as `picked_rows` asks for it.
    """

    whole: Assembled
    held: Held
    equations: Assembled

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals (m,) where the constraints are met."""
        return self.whole.residuals(self.held.put(x))

    def jacobian(self, x: Floats) -> Floats:
        """Their derivative (m, f) by the coordinates that are left."""
        point = self.held.put(x)
        slopes = self.whole.jacobian(point)
        told = np.isin(self.whole.free, self.held.columns)
        order = np.argsort(np.searchsorted(self.whole.free, self.held.columns))
        follow = self.held.slopes(point, self.equations.free)
        return np.asarray(slopes[:, ~told] + slopes[:, told] @ follow[order])


def held_by(equations: Assembled, point: Floats, which: Mask) -> Held | None:
    """The constraints ``which`` (k,) as equations that are put in; None: none are, or they tell no plain numbers."""
    if not which.any():
        return None
    slopes = equations.constraint_jacobian(point)[which]
    lengths = np.sqrt(np.square(slopes).sum(axis=1, keepdims=True))
    left = slopes / np.where(lengths > 0.0, lengths, 1.0)
    if not np.isfinite(left).all():
        return None
    plain = equations.layout.number[equations.free] >= 0
    rows: list[int] = []
    columns: list[int] = []
    while left.size and float(np.abs(left).max()) > INDEPENDENT:
        row, column = np.unravel_index(int(np.argmax(np.abs(left) * plain)), left.shape)
        if abs(left[row, column]) <= INDEPENDENT:
            return None
        rows.append(int(row))
        columns.append(int(column))
        left = left - np.outer(left[:, column], left[row]) / left[row, column]
    if not rows:
        return None
    return Held(equations=equations, rows=np.flatnonzero(which)[rows], columns=equations.free[columns])


def substituted(held: Held | None, plain: Assembled) -> Substituted | None:
    """Equations ``plain`` with what is held put in; None: nothing of it is theirs."""
    mine = None if held is None else held.within(plain)
    if mine is None:
        return None
    left = plain.free[~np.isin(plain.free, mine.columns)]
    return Substituted(plain, mine, plain.freed(left, plain.numbers))
