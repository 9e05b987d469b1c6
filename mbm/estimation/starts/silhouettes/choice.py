"""Which of many places of a shape are worth a start: they differ, and their outlines are near what was measured."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.quasirandom import directions, sobol
from mbm.estimation.starts.silhouettes.hulls import Hulls
from mbm.kernels.outlines.arcs import NEAREST_DEPTH

MOST = 6
"""Starts with the shape in different places."""

MOST_SEEN = 16
"""Solids in different places whose outlines are looked at."""

ALIKE = 4
"""Starts with what is in the best place, but for turns of the shape about its own axes of symmetry."""

SAME = 0.02
"""Of the size in the image: what differs by less is the same."""

WORSE = 3.0
"""Times the distance of the best outline, beside `SLACK`: outlines farther from the measured points are given up."""

SLACK = 0.01
"""Of the size in the image."""

SIDES = 48


def chosen(hulls: Hulls, points: Floats, costs: Floats) -> Floats:
    """Some of the points (S, N), which are sorted by their mean square misfits (S,): the most promising first."""
    if not len(points):
        return points
    groups = _groups(hulls, points)
    misfits = np.array([hulls.picture.misfit(points[group[0]]) for group in groups])
    limit = (WORSE * np.sqrt(misfits.min()) + SLACK * hulls.size) ** 2
    order = [k for k in np.argsort(misfits, kind="stable") if misfits[k] <= limit and np.isfinite(misfits[k])]
    return points[[*groups[order[0]], *(groups[k][0] for k in order[1:MOST])]] if order else points[:0]


def _groups(hulls: Hulls, points: Floats) -> list[list[int]]:
    """Numbers of points that differ; together those with the same solid in the same place."""
    places = hulls.places(points)
    extent = max(float(np.ptp(places[..., 2], axis=1).max()), NEAREST_DEPTH * 1e-3)
    places[..., 2] *= 2 * hulls.size / extent
    ways = directions(sobol(SIDES, 2, 0))
    outermost = (places @ ways.T).max(axis=1)
    least = SAME * hulls.size
    groups: list[list[int]] = []
    for number in range(len(points)):
        group = next((g for g in groups if np.abs(outermost[g[0]] - outermost[number]).max() < least), None)
        if group is None:
            if len(groups) < MOST_SEEN:
                groups.append([number])
        elif len(group) < ALIKE and all(np.abs(places[k] - places[number]).max() >= least for k in group):
            group.append(number)
    return groups
