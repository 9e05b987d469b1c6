"""A few unknowns that are drawn at random, of which each value lets closed forms tell all the others.

The way of a camera whose steps are known, say: with its direction the places of all points are where rays meet.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Mask
from mbm.estimation.search.startless import completed, sufficient
from mbm.estimation.settings import Settings
from mbm.estimation.starts.random_starts import costs, random_points

MOST_LED = 3
"""Coordinates that may be drawn: of a direction, a rotation, three numbers."""

TRIED = 16
"""Values that are tried for each coordinate: directions are some 30° apart, rotations some 60°."""

BEST_LED = 6
"""How many of them, those that fit best, are started from."""


def led_points(equations: Assembled, base: Floats, missing: Mask, settings: Settings) -> Floats:
    """Points (some, N), the best first; none where no few of the ``missing`` coordinates (M,) decide all others."""
    layout, none = equations.layout, np.empty((0, len(base)))
    absent = [entry for entry in layout.entries if bool(missing[entry.coordinates].any())]
    if not settings.closed_forms or all(entry.members == 1 for entry in absent):
        return none
    leading = sufficient(equations, base, settings)
    drawn = np.zeros_like(missing)
    for entry in leading:
        drawn[entry.coordinates] = missing[entry.coordinates]
    if len(leading) == len(absent) or int(drawn.sum()) > MOST_LED:
        return none
    found: list[Floats] = []
    for point in random_points(equations, base, drawn, TRIED * int(drawn.sum()), settings.seed):
        found += completed(equations, point, settings)
        if settings.stopped():
            break
    points = np.array(found).reshape(-1, len(base))
    fits = costs(equations, points) if len(points) else np.empty(0)
    order = np.argsort(fits, kind="stable")[:BEST_LED]
    return points[order[np.isfinite(fits[order])]]
