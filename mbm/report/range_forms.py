"""What a generated solver compares its start with, and begins at where none is stated: the closed form of ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.estimation.batches.forms import recognised
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.thinning import ENOUGH
from mbm.problem.elaborated import Elaborated
from mbm.problem.types import Method
from mbm.solver.range_maps import RangeMaps


def ranges_of(found: Elaborated, equations: Assembled, settings: Settings) -> RangeMaps | None:
    """The form of a problem with such ``equations``, where these are ranges that give all that is estimated, or None.

    For plain least squares, as single solves compare (`mbm.estimation.search.challenge`).
    """
    problem = found.problem
    families = any(unknown.family is not None for unknown in problem.unknowns)
    asked = settings.robust is not None or settings.method in (Method.CLOSED_FORM, Method.DIRECT_SEARCH)
    if asked or families or any(block.errors for block in problem.blocks):
        return None
    shared = equations.structure is not None
    if equations.linear or equations.lossy or shared or equations.constraints or equations.count > ENOUGH:
        return None
    form = recognised(equations, settings)
    maps = None if form is None else form.ranges(stated=not problem.estimates_noise)
    if maps is None:
        return None
    layout = equations.layout
    missing = (np.isnan(layout.start) | layout.guessed) & equations.moving()
    startless = frozenset(i for i, entry in enumerate(layout.entries) if bool(missing[entry.range].any()))
    return replace(maps, startless=startless)
