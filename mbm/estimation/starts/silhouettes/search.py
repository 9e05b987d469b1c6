"""Poses and sizes from measured contours without correspondences and without a start.

Rotations, angles and ranges are drawn; positions follow from where the hull of the contour lies and how large it is;
all of it is refined to the support function of this hull (Marquardt), for many draws at once. The outline itself
decides between those that are left.

Which of many places of a shape are worth a start: they differ, and their outlines are near what was measured.

Where a shape must stand to be seen as large as it was measured, and where it was measured.

Marquardt's method on the support function, for many points at once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Mask
from mbm.estimation.starts.random_starts import random_points
from mbm.estimation.starts.silhouettes.hulls import DIRECTIONS, IN_SPACE, Hulls, Picture, hulls_of, pictures_of, support
from mbm.kernels.outlines.arcs import NEAREST_DEPTH

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
        open_ones = picture.touched & missing & replace(equations.layout, start=found[0]).missing()
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
        if len(points) > 1:  # the points that one view shows are too few for others
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


STEPS = 4

FAR = 4.0
"""Depth of the first place, in extents of the shape along the line of sight."""

NEARER = 0.7
"""Part of the way to the camera that a step goes at most."""


def placed(hulls: Hulls, points: Floats, free: Mask) -> tuple[Floats, Floats]:
    """The points (S, N) with other values of the coordinates ``free`` (M,), which are numbers; and their misfits.

    Along the gradient of the depth the shape is moved before the camera, then by Newton's method on the Steiner point
    and the inverse of the mean width, which grows with the distance as depth does.
    """
    places = np.flatnonzero(free)
    if not len(places):
        return points, hulls.misfits(points)
    points = in_front(hulls, points, free)
    numbers = hulls.layout.number[places]
    for _ in range(STEPS):
        moved, length = hulls.steps(points, places)
        aims, depths = _aims(hulls, np.concatenate([points, moved]))
        here, there = aims[: len(points)], aims[len(points) :].reshape(*length.shape, 3)
        slopes = np.swapaxes((there - here[:, None]) / length[..., None], 1, 2)
        usable = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(here).all(axis=1)
        step = np.zeros(length.shape)
        step[usable] = -np.einsum("sij,sj->si", np.linalg.pinv(slopes[usable], rcond=1e-6), here[usable])
        depth, gradient = depths[: len(points)], depths[len(points) :].reshape(length.shape)
        gradient = (gradient - depth[:, None]) / length
        nearer = -np.einsum("si,si->s", gradient, step)
        with np.errstate(all="ignore"):
            share = np.where(nearer > NEARER * depth, NEARER * depth / nearer, 1.0)
        points = points.copy()
        points[:, numbers] += share[:, None] * step
    return points, hulls.misfits(points)


def in_front(hulls: Hulls, points: Floats, free: Mask) -> Floats:
    """The points with the shape some extents before the camera, where the coordinates ``free`` (M,) change depths."""
    places = np.flatnonzero(free)
    if not len(places):
        return points
    moved, length = hulls.steps(points, places)
    every = hulls.places(np.concatenate([points, moved]))[..., 2]
    depth = every.mean(axis=1)
    gradient = (depth[len(points) :].reshape(length.shape) - depth[: len(points), None]) / length
    squared = np.sum(gradient**2, axis=1)
    moving = squared > 1e-6
    if not moving.any():
        return points
    wanted = NEAREST_DEPTH + FAR * np.ptp(every[: len(points)], axis=1).max()
    points = points.copy()
    ahead = gradient[moving] * ((wanted - depth[: len(points)][moving]) / squared[moving])[:, None]
    points[np.ix_(moving, hulls.layout.number[places])] += ahead
    return points


def _aims(hulls: Hulls, points: Floats) -> tuple[Floats, Floats]:
    """What is to vanish (S, 3), and the mean depths (S,)."""
    places = hulls.places(points)
    found = support(places, hulls.ways)
    size, wanted = found.mean(axis=1), hulls.size
    with np.errstate(all="ignore"):
        center = (found - hulls.wanted) @ hulls.ways[:2].T * (2 / DIRECTIONS / wanted)
        aims = np.concatenate([center, (wanted / size - 1)[:, None]], axis=1)
    aims[~(places[..., 2] >= NEAREST_DEPTH).all(axis=1)] = np.nan
    return aims, places[..., 2].mean(axis=1)


def best(points: Floats, costs: Floats, count: int) -> tuple[Floats, Floats]:
    """The points (S, N) of the least finite ``costs`` (S,), in their order, and these."""
    order = np.argsort(costs, kind="stable")[:count]
    order = order[np.isfinite(costs[order])]
    return points[order], costs[order]


def refined(hulls: Hulls, points: Floats, steps: int) -> tuple[Floats, Floats]:
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
