"""Poses and sizes from measured contours without correspondences and without a start.

Rotations, angles and ranges are drawn; positions follow from where the hull of the contour lies and how large it is;
all of it is refined to the support function of this hull (Marquardt), for many draws at once. The outline itself
decides between those that are left.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import Layout
from mbm.equations.types import Floats, Mask
from mbm.estimation.starts.random_starts import random_points
from mbm.estimation.starts.silhouettes.choice import chosen
from mbm.estimation.starts.silhouettes.hulls import hulls_of
from mbm.estimation.starts.silhouettes.pictures import Picture, pictures_of
from mbm.estimation.starts.silhouettes.placing import in_front, placed
from mbm.estimation.starts.silhouettes.refining import best, refined

DRAWN, THINNING, REFINED, FOLLOWED, TURNED = 1024, 64, 192, 64, 48
"""Draws; those by which points of the shape are sorted out; those that are refined, those to the end, and those that
may lead to what looks the same."""

FIRST_STEPS, LAST_STEPS = 6, 14


def silhouette_starts(equations: Assembled, base: Floats, missing: Mask, seed: int) -> Floats:
    """Points (S, N) with numbers for what measured contours tell of ``base`` (N,), the most promising first.

    ``missing`` (M,) are the coordinates without a start. Of several pictures each is looked at by itself, given what
    those before it told.
    """
    found = base[None]
    for picture in pictures_of(equations, base, missing, seed):
        open_ones = picture.touched & missing & _still_missing(equations.layout, found[0])
        if open_ones.any():
            points = _of_picture(equations, picture, found[0], open_ones, seed)
            if len(points):
                found = _joined(found, points, base)
    return found


def _joined(found: Floats, points: Floats, base: Floats) -> Floats:
    """What was found so far, and what a further picture tells; of the shorter list the best is repeated."""
    count = max(len(found), len(points))
    before, after = (np.concatenate([each, each[:1].repeat(count - len(each), axis=0)]) for each in (found, points))
    return np.where(np.isnan(before), after, before)


def _still_missing(layout: Layout, numbers: Floats) -> Mask:
    found = np.zeros(len(layout.number), dtype=bool)
    plain = layout.number >= 0
    found[plain] = np.isnan(numbers[layout.number[plain]])
    for curved in layout.curved:
        found[curved.coordinates[np.isnan(numbers[curved.numbers]).any(axis=1)]] = True
    return found


def _of_picture(equations: Assembled, picture: Picture, base: Floats, open_ones: Mask, seed: int) -> Floats:
    layout = equations.layout
    ranged = np.isfinite(layout.start_lower) & np.isfinite(layout.start_upper)
    ranged |= np.isfinite(layout.lower) & np.isfinite(layout.upper)
    plain = layout.number >= 0
    drawn = open_ones & (~plain | ranged | layout.angle | layout.positive)
    free = open_ones & ~drawn
    hulls = hulls_of(picture, layout, open_ones)
    points = random_points(equations, base, drawn, DRAWN if drawn.any() else 1, seed)
    points[:, layout.number[free]] = 0.0
    movable = free if free.any() else open_ones & plain & ~layout.angle
    with np.errstate(all="ignore"):
        hulls = hulls.thinned(in_front(hulls, points[: hulls.at_most(THINNING)], movable))
        points, misfits = placed(hulls, points[: hulls.at_most(DRAWN)], movable)
        points, costs = best(points, np.square(misfits).mean(axis=1), REFINED)
        if not len(points):
            return points
        begun = points[:: REFINED // TURNED]
        points, costs = refined(hulls, points, FIRST_STEPS)
        points, costs = best(points, costs, FOLLOWED)
        points, costs = refined(hulls, points, LAST_STEPS)
        return chosen(hulls, best(points, costs, FOLLOWED)[0], begun)
