"""Subsets of the equations, as consensus draws them → points in closed form, all subsets at once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.completion import plans
from mbm.estimation.starts.closed_forms.types import ClosedForm, Plan, Situation
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MinimalSolver:
    """A closed form that gives all estimated numbers from a few units; the other numbers are those of ``base`` (N,).

    ``foremost``: no closed form for some of the numbers comes before it.
    """

    plan: Plan
    foremost: bool
    base: Floats = field(repr=False)
    row_of: Indices = field(repr=False)

    def points(self, subsets: Indices) -> tuple[Floats, Indices]:
        """Points (P, N) for subsets (T, k) of unit numbers, -1 for none, and the subset (P,) that each belongs to.

        Subsets with fewer units than the closed form needs, or with units that it does not know, have no point.
        """
        padded = np.append(self.row_of, -1)
        rows = padded[np.where((subsets >= 0) & (subsets < len(self.row_of)), subsets, len(self.row_of))]
        usable = np.flatnonzero((rows >= 0).all(axis=1))
        if not usable.size or subsets.shape[1] < self.plan.minimal:
            return np.empty((0, len(self.base))), np.empty(0, dtype=np.int64)
        found = self.plan.solved(rows[usable])
        which, solution = np.nonzero(np.isfinite(found).all(axis=2))
        points = np.tile(self.base, (len(which), 1))
        points[:, self.plan.candidate.places[0]] = found[which, solution]
        return points, usable[which]


def minimal_solver(equations: Assembled, base: Floats, forms: Iterable[ClosedForm]) -> MinimalSolver | None:
    """The closed form that gives every estimated number of these equations, if there is one.

    ``base`` (N,) holds the numbers that are not estimated.
    """
    numbers = np.where(equations.sought(), np.nan, base)
    situation = Situation(layout=equations.layout, groups=equations.groups, numbers=numbers)
    wanted = int(np.isnan(numbers).sum())
    for rank, plan in enumerate(plans(situation, forms)):
        if plan.candidate.places.size == wanted and plan.candidate.members == 1 and not plan.form.joint:
            row_of = np.full(int(plan.rows.unit.max()) + 1, -1, dtype=np.int64)
            row_of[plan.rows.unit] = np.arange(len(plan.rows))
            return MinimalSolver(plan=plan, foremost=rank == 0, base=base, row_of=row_of)
    return None
