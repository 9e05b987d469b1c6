"""Where consensus begins if no start is known: where the equations tell the unknowns apart.

A closed form for all rows follows those that are grossly wrong. Far off, all equations say the same in the working
precision: no subset of them determines the unknowns there, though any subset of good ones does.
"""

from __future__ import annotations

import numpy as np

from mbm.solution.assembly import Assembled
from mbm.solution.closed_forms.minimal import minimal_solver
from mbm.solution.closed_forms.types import ClosedForm
from mbm.solution.robust.binding import without_losses
from mbm.solution.robust.subsets import independent_columns
from mbm.solution.robust.units import Units
from mbm.solution.starting import Beginning, with_idle_ones
from mbm.solution.types import Floats
from mbm.target.solver.consensus_begin import ATTEMPTS


def told_apart(
    equations: Assembled, units: Units, starts: tuple[Beginning, ...], closed_forms: tuple[ClosedForm, ...]
) -> tuple[Beginning, ...]:
    """The starts, or, where the ``units`` leave unknowns open at the first of them, what a few units give instead.

    Those are the first ones behind one another whose closed form lies where all units determine all unknowns; where
    there is no such, the starts stay. There may be none to begin with.
    """
    plain = without_losses(equations)
    if starts and _told(plain, units, starts[0].point):
        return starts
    solver = minimal_solver(plain, with_idle_ones(plain, plain.numbers), closed_forms)
    if solver is None:
        return starts
    size = solver.plan.minimal
    behind = units.number[np.arange(max(units.count - size + 1, 0))[:, None] + np.arange(size)]
    with np.errstate(all="ignore"):
        points, which = solver.points(behind)
        different = np.flatnonzero(np.diff(which, prepend=-1))
        for first in different[:ATTEMPTS].tolist():
            if _told(plain, units, points[first]):
                mine = points[which == which[first]]
                return tuple(Beginning(point=point, origin=solver.plan.description) for point in mine)
    return starts


def _told(plain: Assembled, units: Units, point: Floats) -> bool:
    """Whether the units determine all unknowns, as far as the derivatives at a point say."""
    with np.errstate(all="ignore"):
        jacobian = plain.plain_jacobian(point)
    return independent_columns(jacobian[units.of_row >= 0]) >= plain.dimension
