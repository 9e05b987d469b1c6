"""A closed form that gives all numbers of a problem, as it is recognised in the equations of one solve."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.estimation.consensus.forms import KnownForm, form_of
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.minimal import minimal_solver
from mbm.estimation.starts.closed_forms.multilateration import Spheres
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.solver.range_maps import RangeMaps
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recognised:
    """A closed form that was recognised in the equations of one solve, ``first``, and gives all numbers of such."""

    first: Assembled
    form: KnownForm
    plan: Plan

    def ranges(self, *, stated: bool) -> RangeMaps | None:
        """What the solver compares starts with, where the form is that of ranges; ``stated``: the noise is."""
        data = self.plan.data
        if not isinstance(data, Spheres):
            return None
        places, maps = self.form.tables(self.first, (True,) * len(self.first.groups), open_ones=True)
        return RangeMaps(
            dimension=len(data.point),
            offset=data.offset is not None,
            even=data.even,
            rooted=self.form.rooted,
            places=self.form.form.about[3:],
            map_places=places,
            maps=maps,
            fixed=tuple(self.form.fixed.tolist()),
            values=tuple(self.first.numbers[self.form.fixed].tolist()),
            held=self.form.held,
            stated=stated,
        )


@np.errstate(all="ignore")
def recognised(first: Assembled, settings: Settings) -> Recognised | None:
    """The closed form that gives all numbers of the equations of one solve; None if it is not known from the rows."""
    forms = settings.closed_forms
    solver = minimal_solver(first, first.numbers, forms)
    if solver is None or not solver.foremost:
        return None  # others come first, and leave numbers to it
    known = form_of(first, solver, forms)
    if known is None or known.maps is None:
        return None
    candidate = solver.plan.candidate
    if candidate.flat and bool((candidate.angles & np.isfinite(first.layout.lower[candidate.coordinates[0]])).any()):
        return None  # which turn of an angle lies within its bounds is found out one by one
    return Recognised(first=first, form=known, plan=solver.plan)
