"""The points that a search begins at: those that ``:starts`` asks for, else the ones that the problem itself has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import given_numbers
from mbm.equations.types import Floats
from mbm.estimation.search.carrying import carried_beginnings
from mbm.estimation.search.solution import Solution
from mbm.estimation.search.starting import Beginning, beginnings
from mbm.estimation.settings import Settings
from mbm.estimation.starts.random_starts import random_points
from mbm.problem.requests import GivenStarts, RandomStarts

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
    free = np.zeros(len(layout.number), dtype=bool)
    free[equations.free] = True
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
