"""The best place that ranges give for one data set, by the solver."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats
from mbm.estimation.minimise.native.range_maps import hand
from mbm.estimation.minimise.native.system import system_of
from mbm.estimation.settings import Settings
from mbm.machine.records import inside, put
from mbm.solver import description as of
from mbm.solver.range_form import RangeForm
from mbm.solver.range_maps import RangeMaps
from mbm.solver.workspace import Answer, Work


def place_of_ranges(
    equations: Assembled, ranges: RangeMaps, start: Floats, settings: Settings
) -> tuple[Floats, float] | None:
    """The point (N,) there, numbers that are not estimated as in the start, and its cost, inf where there is no place.

    None: the equations are not for the solver.
    """
    system = system_of(equations, settings, strict=False)
    if system is None:
        return None
    ends, begun = system.blank(1), np.ascontiguousarray(start, dtype=np.float64)
    work, *_scratch = system.scratch()
    form = system.code.blank(RangeForm)
    _held = hand(ranges, form, len(begun), sum(group.rows for group in equations.groups))
    put(inside(work, Work, "answer"), Answer, **ends.arrays())
    system.code.expect(system.expected)
    begin = system.code.routine("start_solve", object, object, int, object, object)
    begin(system.system, system.rows.data[0], 0, begun, work)
    system.code.routine("place_of_ranges", object, object, object, object)(system.system, begun, form, work)
    system.failed()
    return ends.numbers[0], float(ends.results[0, of.COST])
