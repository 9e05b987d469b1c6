"""The estimates of the last window as a start of the next, where that is better than its own start."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import Layout
from mbm.equations.metric import cost_at
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.search.starting import Beginning, beginnings, with_idle_ones
from mbm.estimation.settings import Settings
from mbm.text.types import MbmError

ORIGIN = "the last window"

DEVIATIONS = 3.0
"""Standard deviations of χ² that a cost may lie above its degrees of freedom and count as noise."""


def carried_beginnings(equations: Assembled, settings: Settings, last: Solution | None) -> tuple[Beginning, ...]:
    """The points to start from; the last window's estimates come first if the equations fit them better.

    They take the place of the one start, and stand before several. Where they were the only ones there, and fit the
    rows as well as the stated noise lets expect, no other start is looked for.

    Raises:
        MbmError: no start is known, none can be found, and there is no last window that has one.

    """
    if last is None:
        return beginnings(equations, settings)
    point = with_idle_ones(equations, carried(equations.layout, last))
    usable = bool(np.isfinite(point).all())
    start = Beginning(point=point, origin=ORIGIN)
    if usable and _is_expected(equations, settings, last, point):
        return (start,)
    try:
        own = beginnings(equations, settings)
    except MbmError:
        if not usable:
            raise
        return (start,)
    if not usable or not cost_at(equations, point) < cost_at(equations, own[0].point):
        return own
    return (start, *own) if len(own) > 1 else (start,)


def carried(layout: Layout, last: Solution) -> Floats:
    """The numbers (N,) of the last window by name and member; what is new here, or given, has its own start."""
    point = layout.start.copy()
    for entry in layout.entries:
        other = last.layout.entry(entry.unknown.name)
        size = entry.unknown.size
        if entry.keys == other.keys:
            found = last.numbers[other.range].copy()
        else:
            found = point[entry.range].copy()
            for member, key in enumerate(entry.keys or ()):
                place = other.index.get(key)
                if place is not None:
                    first = other.offset + place * size
                    found[member * size : (member + 1) * size] = last.numbers[first : first + size]
        point[entry.range] = found
    fixed = layout.number[layout.fixed & (layout.number >= 0)]
    point[fixed] = layout.start[fixed]
    for curved in layout.curved:
        held = layout.fixed[curved.coordinates].all(axis=1)
        point[curved.numbers[held]] = layout.start[curved.numbers[held]]
    return point


def _is_expected(equations: Assembled, settings: Settings, last: Solution, point: Floats) -> bool:
    """Whether nothing speaks for another start: one minimum in the last window, and a cost that noise explains here."""
    several = last.tally is not None and bool(last.alternatives())
    trusted = last.minimum.reason.converged and last.observability.observable and not several
    freedom = equations.count - equations.dimension
    if not trusted or last.noise or settings.robust is not None or freedom <= 0:
        return False
    return cost_at(equations, point) <= freedom + DEVIATIONS * float(np.sqrt(2 * freedom))
