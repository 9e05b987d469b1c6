"""Images by parallel rays, of cameras that do not divide by the depth → their scale, and poses but for the depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.types import Floats

LINE = 1e-3
"""Extent of points across their line, beside that along it, up to which they tell of no plane."""


def parallel_poses(points: Floats, image: Floats, deep: float) -> tuple[Floats, Floats, Floats]:
    """Poses R (k, 3, 3), t (k, 3) with ``image = s (R x + t)`` but for the depth, which is 0; and the map (2, 3).

    Points (n, 3) whose extent across their likeliest plane is no more than ``deep`` of the largest are taken for plane:
    such an image has two poses, mirror images of one another (Necker's cube); the better fitting one comes first. None
    (k = 0) of points on a line. The map is that of the points about their middle, in axes of their own: its last
    column is 0 for plane ones.
    """
    origin, middle = points.mean(axis=0), image.mean(axis=0)
    _, extent, basis = np.linalg.svd(points - origin)
    if len(points) < 3 or not extent[1] > LINE * extent[0]:
        return np.empty((0, 3, 3)), np.empty((0, 3)), np.zeros((2, 3))
    basis *= np.linalg.det(basis)
    flat = len(points) < 4 or not extent[2] > deep * extent[0]
    places = (points - origin) @ basis.T
    A = np.zeros((2, 3))
    A[:, : 2 if flat else 3] = np.linalg.lstsq(places[:, : 2 if flat else 3], image - middle, rcond=None)[0].T
    U, sizes, Vt = np.linalg.svd(A[:, :2] if flat else A, full_matrices=False)
    scale = float(sizes[0] if flat else sizes.mean())
    if not scale > 0.0:
        return np.empty((0, 3, 3)), np.empty((0, 3)), A
    if flat:
        ahead = np.sqrt(1.0 - (sizes[1] / scale) ** 2) * Vt[1]
        columns = [np.vstack([A[:, :2] / scale, sign * ahead]) for sign in (1.0, -1.0)]
        turns = np.stack([np.column_stack([c, np.cross(c[:, 0], c[:, 1])]) for c in columns])
    else:
        rows = U @ Vt
        turns = np.stack([np.vstack([rows, np.cross(rows[0], rows[1])])])
    R = turns @ basis
    t = np.zeros((len(R), 3))
    t[:, :2] = middle / scale - (R @ origin)[:, :2]
    seen = scale * (np.einsum("kij,nj->kni", R, points) + t[:, None])[:, :, :2]
    order = np.argsort(np.square(seen - image).sum(axis=(1, 2)), kind="stable")
    return R[order], t[order], A


def parallel_camera(views: Sequence[tuple[Floats, Floats]], deep: float, *, one_focal: bool) -> Floats | None:
    """The scales (2,) of the axes of a camera; None where points on lines are all that is seen.

    Of space the rows of the map are as long as these. Of a plane, the map B over the scales is part of a rotation, so
    that its larger singular value is 1: with p, q the inverse squares of the scales ``1 − |b₁|² p − |b₂|² q + |B|² p q
    = 0``, from three views on linear in p, q and their product. Two or one view are taken for those of one scale.
    """
    maps = [A for R, _, A in (parallel_poses(*view, deep) for view in views) if len(R)]
    if not maps:
        return None
    spatial = [A for A in maps if A[:, 2].any()]
    if spatial and not one_focal:
        return np.asarray(np.median([np.linalg.norm(A, axis=1) for A in spatial], axis=0))
    if len(maps) > 2 and not one_focal:
        squares = np.array([[*np.square(A).sum(axis=1), -(np.linalg.det(A[:, :2]) ** 2)] for A in maps])
        p, q, _ = np.linalg.lstsq(squares, np.ones(len(maps)), rcond=None)[0]
        if p > 0.0 and q > 0.0:
            return np.asarray(1.0 / np.sqrt([p, q]))
    sizes = [np.linalg.svd(A, compute_uv=False) for A in spatial or maps]
    return np.full(2, np.median([each.mean() if spatial else each[0] for each in sizes]))
