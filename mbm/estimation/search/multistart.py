"""The points that a search begins at: asked for by ``:starts``, carried from the last window, or stated."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import Layout, given_numbers
from mbm.equations.metric import cost_at
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.search.starting import Beginning, beginnings, with_idle_ones
from mbm.estimation.settings import Settings
from mbm.estimation.starts.random_starts import random_points
from mbm.problem.requests import GivenStarts, RandomStarts
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


RANDOM = "a random start"
GIVEN = "a given start"


def starting_points(equations: Assembled, settings: Settings, last: Solution | None) -> tuple[Beginning, ...]:
    """The points to start from, at least one; ``last`` as for `carried_beginnings`.

    The first of random starts are those that would be used without them: more starts are never worse than none.

    Raises:
        MbmError: no start is known and none can be found, or a given one does not fit its unknown.

    """
    if isinstance(settings.starts, RandomStarts):
        first = beginnings(equations, settings)[: settings.starts.count]
        seed = settings.seed if settings.starts.seed is None else settings.starts.seed
        points = _random(equations, first[0].point, settings.starts.count - len(first), seed)
        return (*first, *(Beginning(point=point, origin=RANDOM) for point in points))
    if isinstance(settings.starts, GivenStarts):
        own = beginnings(equations, settings)[0]
        return tuple(_given(equations, own.point, start) for start in settings.starts.starts)
    return carried_beginnings(equations, settings, last)


def _random(equations: Assembled, own: Floats, count: int, seed: int) -> Floats:
    """Points (count, N) that differ in all that is estimated; numbers without a range lie about their own start."""
    layout = equations.layout
    free = equations.is_free
    points = random_points(equations, own, free, count, seed)
    ranged = np.isfinite(layout.start_lower) & np.isfinite(layout.start_upper)
    ranged |= np.isfinite(layout.lower) | np.isfinite(layout.upper) | layout.angle | layout.positive
    loose = layout.number[free & ~ranged & (layout.number >= 0)]
    points[:, loose] += own[loose]
    return points


def _given(equations: Assembled, own: Floats, start: Mapping[str, tuple[float, ...]]) -> Beginning:
    point = own.copy()
    for name, values in start.items():
        entry = equations.layout.entry(name)
        point[entry.range] = given_numbers(entry, np.array(values))
    return Beginning(point=point, origin=GIVEN)
