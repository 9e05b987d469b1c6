"""Random points to start from: uniform over boxes, rotations and directions; elsewhere as wide as the data suggest."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.quasirandom import directions, rotations, sobol
from mbm.problem.manifold import Piece

WIDEST = 0.94
"""Share of a Cauchy distribution that is used for unbounded numbers: up to ten times the scale on either side."""

TOGETHER = 2_000_000
"""Residuals that are computed together."""

SINGLE = 3
"""Points up to which each is computed by itself: arrays for many are made ready for more."""

POSITIVE_DECADES = 2.0
"""Positive numbers range over so many powers of ten on either side of their scale."""


def random_points(equations: Assembled, base: Floats, wanted: Mask, count: int, seed: int) -> Floats:
    """Points (count, N): ``base`` with other values for the coordinates that ``wanted`` (M,) marks.

    Numbers with bounds are uniform over ``:start``, else over ``:in``; angles over the circle, rotations and directions
    over all of them. Any others follow a Cauchy distribution about 0, cut off, of the scale that the data suggest.
    """
    layout = equations.layout
    plain = np.flatnonzero(wanted & (layout.number >= 0))
    curved = [(c.piece, c.numbers[k]) for c in layout.curved for k in np.flatnonzero(wanted[c.coordinates].any(axis=1))]
    dimension = len(plain) + sum(p.tangent for p, _ in curved)
    cube = sobol(count, dimension, seed)
    points = np.tile(base, (count, 1))
    points[:, layout.number[plain]] = _numbers(equations, base, plain, cube[:, : len(plain)])
    used = len(plain)
    for piece, places in curved:
        part = cube[:, used : used + piece.tangent]
        used += piece.tangent
        points[:, places] = _CURVED[piece](part)
    return points


def costs(equations: Assembled, points: Floats) -> Floats:
    """``Σ r²`` at points (T, N), infinite where an equation has no value."""
    with np.errstate(all="ignore"):
        if equations.implicit is not None or len(points) <= SINGLE:
            found = np.array([float(np.square(equations.residuals(point)).sum()) for point in points])
        else:
            step = max(TOGETHER // max(equations.whole, 1), 1)
            parts = [equations.residuals_at(points[i : i + step]) for i in range(0, len(points), step)]
            found = np.concatenate([np.square(part).sum(axis=1) for part in parts])
    return np.where(np.isfinite(found), found, np.inf)


def _scales(cube: Floats) -> Floats:
    """Factors between a tenth and ten."""
    return np.asarray(10.0 ** (2.0 * cube - 1.0))


_CURVED = {Piece.QUATERNION: rotations, Piece.SPHERE: directions, Piece.SCALE: _scales}


def _numbers(equations: Assembled, base: Floats, plain: Indices, cube: Floats) -> Floats:
    layout = equations.layout
    low, high = (
        np.where(np.isnan(ours[plain]), theirs[plain], ours[plain])
        for ours, theirs in ((layout.start_lower, layout.lower), (layout.start_upper, layout.upper))
    )
    circle = layout.angle[plain] & ~(np.isfinite(low) & np.isfinite(high))
    low, high = np.where(circle, -np.pi, low), np.where(circle, np.pi, high)
    boxed = np.isfinite(low) & np.isfinite(high)
    scale = scales(equations, base, plain)[plain]
    free = scale * np.tan(np.pi / 2 * WIDEST * (2 * cube - 1))
    positive = scale * 10.0 ** (POSITIVE_DECADES * (2 * cube - 1))
    free = np.where(layout.positive[plain], positive, free)
    free = np.where(np.isfinite(low), low + np.abs(free), np.where(np.isfinite(high), high - np.abs(free), free))
    with np.errstate(invalid="ignore"):
        return np.where(boxed, low + cube * (high - low), free)


def scales(equations: Assembled, base: Floats, plain: Indices) -> Floats:
    """How large each coordinate (M,) may be: the median of the changes that would cancel single residuals.

    Taken at points where the unknown numbers, and those of the coordinates ``plain``, are 0, 1 and -1 (``base`` may fit
    already, with nothing left to cancel); 1 where no residual tells.
    """
    layout = equations.layout
    free = equations.free
    found = []
    missing = np.isnan(base)
    missing[layout.number[plain]] = True
    for value in (0.0, 1.0, -1.0):
        point = np.where(missing, value, base)
        for curved in layout.curved:
            idle = np.isnan(base[curved.numbers]).any(axis=1)
            point[curved.numbers[idle]] = np.eye(curved.piece.size)[0]
        with np.errstate(all="ignore"):
            residuals, jacobian = equations.residuals(point), equations.jacobian(point)
            steps = np.abs(residuals[:, None] / jacobian)
        found.append(np.where(np.isfinite(steps) & (steps > 0), steps, np.nan))
    result = np.ones(len(layout.number))
    every = np.vstack(found)
    for column, place in enumerate(free):
        known = every[np.isfinite(every[:, column]), column]
        if known.size:
            result[place] = np.clip(np.median(known), 1e-9, 1e9)
    return result
