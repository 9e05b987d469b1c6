"""Where a shape must stand to be seen as large as it was measured, and where it was measured."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.estimation.starts.silhouettes.hulls import DIRECTIONS, Hulls, support
from mbm.kernels.outlines.arcs import NEAREST_DEPTH

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
