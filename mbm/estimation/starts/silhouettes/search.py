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
from mbm.estimation.starts.silhouettes.hulls import Hulls, hulls_of
from mbm.estimation.starts.silhouettes.pictures import Picture, pictures_of
from mbm.estimation.starts.silhouettes.placing import in_front, placed

DRAWN, THINNING, REFINED, FOLLOWED = 1024, 64, 192, 64
"""Draws; those by which points of the shape are sorted out; those that are refined, and those to the end."""

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
    points = random_points(equations, base, drawn, DRAWN if drawn.any() else 1, seed)
    points[:, layout.number[free]] = 0.0
    movable = free if free.any() else open_ones & plain & ~layout.angle
    with np.errstate(all="ignore"):
        hulls = hulls_of(picture, layout, open_ones)
        hulls = hulls.thinned(in_front(hulls, points[:THINNING], movable))
        points, misfits = placed(hulls, points, movable)
        points, costs = _best(points, np.square(misfits).mean(axis=1), REFINED)
        points, costs = _refined(hulls, points, FIRST_STEPS)
        points, costs = _best(points, costs, FOLLOWED)
        points, costs = _refined(hulls, points, LAST_STEPS)
        return chosen(hulls, *_best(points, costs, FOLLOWED))


def _best(points: Floats, costs: Floats, count: int) -> tuple[Floats, Floats]:
    order = np.argsort(costs, kind="stable")[:count]
    order = order[np.isfinite(costs[order])]
    return points[order], costs[order]


def _refined(hulls: Hulls, points: Floats, steps: int) -> tuple[Floats, Floats]:
    """The points after steps of Marquardt's method, and their mean square misfits."""
    damping = np.full(len(points), 1e-2)
    misfits, slopes = hulls.linearised(points)
    costs = np.square(misfits).mean(axis=1)
    for _ in range(steps):
        normal = np.einsum("sdi,sdj->sij", slopes, slopes)
        right = np.einsum("sdi,sd->si", slopes, misfits)
        usable = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
        scale = np.einsum("sii->si", normal)
        scale = scale + 1e-9 * scale.max(axis=1, keepdims=True) + 1e-30
        normal += (damping[:, None] * scale)[:, None] * np.eye(scale.shape[1])
        step = np.zeros(right.shape)
        step[usable] = -np.linalg.solve(normal[usable], right[usable][..., None])[..., 0]
        moved = _moved(hulls, points, step)
        new_misfits, new_slopes = hulls.linearised(moved)
        new_costs = np.square(new_misfits).mean(axis=1)
        better = new_costs < costs
        points = np.where(better[:, None], moved, points)
        costs = np.where(better, new_costs, costs)
        misfits = np.where(better[:, None], new_misfits, misfits)
        slopes = np.where(better[:, None, None], new_slopes, slopes)
        damping = np.where(better, damping / 5, damping * 5)
    return points, costs


def _moved(hulls: Hulls, points: Floats, step: Floats) -> Floats:
    """The points after steps of the open coordinates, within the ranges where starts lie, and hard bounds."""
    layout = hulls.layout
    every = np.zeros((len(points), len(layout.number)))
    every[:, hulls.open_ones] = step
    moved = layout.retract(points, every)
    plain = hulls.open_ones[layout.number[hulls.open_ones] >= 0]
    numbers = layout.number[plain]
    low = np.fmax(layout.start_lower[plain], layout.lower[plain])
    high = np.fmin(layout.start_upper[plain], layout.upper[plain])
    moved[:, numbers] = np.fmin(np.fmax(moved[:, numbers], low), high)
    return moved
