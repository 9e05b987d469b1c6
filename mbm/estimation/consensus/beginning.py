"""Where consensus begins if no start is known: the minimal-sample solution with the least median of squared residuals.

A closed form for all rows follows those that are grossly wrong. Far off, all equations say the same in the working
precision, or nearly so: no subset of them determines the unknowns there, and no few steps lead from there to what a
subset of good ones says.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats
from mbm.estimation.consensus.binding import without_losses
from mbm.estimation.consensus.subsets import independent_columns
from mbm.estimation.consensus.units import Units
from mbm.estimation.search.starting import Beginning, with_idle_ones
from mbm.estimation.starts.closed_forms.minimal import minimal_solver
from mbm.estimation.starts.closed_forms.types import ClosedForm
from mbm.solver.decisions import ATTEMPTS, FAR


def told_apart(
    equations: Assembled, units: Units, starts: tuple[Beginning, ...], closed_forms: tuple[ClosedForm, ...]
) -> tuple[Beginning, ...]:
    """The starts, or what a few units give in closed form, if the first start is far off.

    It is where the ``units`` leave unknowns open there, or where the median of their misfits is `FAR` times that of a
    closed form of units behind one another, at which all units determine all unknowns. The one with the least median
    is taken, in all its solutions; where there is no such, the starts stay. There may be none to begin with.
    """
    plain = without_losses(equations)
    solver = minimal_solver(plain, with_idle_ones(plain, plain.numbers), closed_forms)
    if solver is None:
        return starts
    size = solver.plan.minimal
    behind = units.number[np.arange(min(max(units.count - size + 1, 0), ATTEMPTS))[:, None] + np.arange(size)]
    with np.errstate(all="ignore"):
        points, which = solver.points(behind)
        medians = _medians(plain, units, points)
        far = not starts or not _told(plain, units, starts[0].point)
        limit = np.inf if far else float(_medians(plain, units, starts[0].point[None])[0]) / FAR**2
        for one in np.argsort(medians, kind="stable").tolist():
            if not medians[one] < limit:
                break
            if _told(plain, units, points[one]):
                mine = points[which == which[one]]
                return tuple(Beginning(point=point, origin=solver.plan.description) for point in mine)
    return starts


def _medians(plain: Assembled, units: Units, points: Floats) -> Floats:
    """The median of the units' squared misfits at each point (P,); infinite where most have no value."""
    if not len(points):
        return np.empty(0)
    return np.asarray(np.median(units.squares(plain.residuals_at(points)), axis=1))


def _told(plain: Assembled, units: Units, point: Floats) -> bool:
    """Whether the units determine all unknowns, as far as the derivatives at a point say."""
    with np.errstate(all="ignore"):
        jacobian = plain.plain_jacobian(point)
    return independent_columns(jacobian[units.of_row >= 0]) >= plain.dimension
