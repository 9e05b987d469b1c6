"""Which of many places of a shape are worth a start: they differ, and their outlines are near what was measured."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.silhouettes.hulls import IN_SPACE, Hulls, support
from mbm.estimation.starts.silhouettes.refining import best, refined

MOST = 6
"""Starts with the shape in different places."""

MOST_SEEN = 16
"""Solids in different places whose outlines are looked at."""

ALIKE = 5
"""Starts with what is in the best place, but for turns of the shape about its own axes of symmetry."""

SAME = 0.02
"""Of the size in the image: what differs by less is the same."""

WORSE = 3.0
"""Times the distance of the best outline, beside `SLACK`: outlines farther from the measured points are given up."""

SLACK = 0.01
"""Of the size in the image."""

TURN_STEPS = 16


def chosen(hulls: Hulls, points: Floats, begun: Floats) -> Floats:
    """Some of the points (S, N), which come the best fitting first, and what looks the same as the best of them.

    This is looked for from the points ``begun`` (T, N).
    """
    different = _different(hulls, points)
    if not different:
        return points[:0]
    misfits = np.array([hulls.picture.misfit(points[k]) for k in different])
    limit = (WORSE * np.sqrt(misfits.min()) + SLACK * hulls.size) ** 2
    order = [different[k] for k in np.argsort(misfits, kind="stable") if misfits[k] <= limit and misfits[k] < np.inf]
    if not order:
        return points[:0]
    return np.concatenate([points[order[:1]], _alike(hulls, points[order[0]], begun), points[order[1:MOST]]])


def _different(hulls: Hulls, points: Floats) -> list[int]:
    """Numbers of points at which the shape takes different places, as a solid."""
    places = hulls.places(points)
    outermost = support(places, IN_SPACE * np.array([1.0, 1.0, hulls.stretch(places)])[:, None])
    found: list[int] = []
    for number in range(len(points)):
        apart = np.abs(outermost[found] - outermost[number]).max(axis=1) >= SAME * hulls.size
        if apart.all() and len(found) < MOST_SEEN:
            found.append(number)
    return found


def _alike(hulls: Hulls, point: Floats, begun: Floats) -> Floats:
    """Points at which the solid is where it is at ``point`` (N,), but turned about its axes of symmetry."""
    points, costs = best(*refined(hulls.solid(point), begun, TURN_STEPS), len(begun))
    points = np.concatenate([point[None], points[np.sqrt(costs) < SAME * hulls.size]])
    places = hulls.places(points)
    places[..., 2] *= hulls.stretch(places[:1])
    # a round body is turned anyhow about its axis: the farthest ones come first, which are also upside down
    found, nearest = [0], np.full(len(points), np.inf)
    while len(found) < ALIKE:
        apart = np.abs(places - places[found[-1]]).max(axis=(1, 2))
        nearest = np.minimum(nearest, apart)
        farthest = int(np.argmax(nearest))
        if nearest[farthest] < SAME * hulls.size:
            break
        found.append(farthest)
    return points[found[1:]]
