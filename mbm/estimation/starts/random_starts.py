"""Random points to start from: uniform over boxes, rotations and directions; elsewhere as wide as the data suggest."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.magnitudes import Magnitudes
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


CORE = 0.6
"""Share of random sizes within the range that the equations tell; the others reach two powers of ten beyond."""

BEYOND = 0.2
"""How far beyond the values among which a number lies it is looked for, as a share of their range."""


def random_points(
    equations: Assembled, base: Floats, wanted: Mask, count: int, seed: int, sizes: Magnitudes | None = None
) -> Floats:
    """Points (count, N): ``base`` with other values for the coordinates that ``wanted`` (M,) marks.

    Numbers with bounds are uniform over ``:start``, else over ``:in``; angles over the circle, rotations and directions
    over all of them. Any others are of the ``sizes`` that the equations tell, else follow a Cauchy distribution about
    0, cut off, of the scale that the data suggest.
    """
    layout = equations.layout
    plain = np.flatnonzero(wanted & (layout.number >= 0))
    curved = [(c.piece, c.numbers[k]) for c in layout.curved for k in np.flatnonzero(wanted[c.coordinates].any(axis=1))]
    dimension = len(plain) + sum(p.tangent for p, _ in curved)
    cube = sobol(count, dimension, seed)
    points = np.tile(base, (count, 1))
    points[:, layout.number[plain]] = numbers_at(equations, base, plain, cube[:, : len(plain)], sizes)
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


def numbers_at(
    equations: Assembled, base: Floats, plain: Indices, cube: Floats, sizes: Magnitudes | None = None
) -> Floats:
    """Numbers (count, some) of the coordinates ``plain`` (some,) at points of the cube; as `random_points` has them."""
    layout = equations.layout
    low, high = (
        np.where(np.isnan(ours[plain]), theirs[plain], ours[plain])
        for ours, theirs in ((layout.start_lower, layout.lower), (layout.start_upper, layout.upper))
    )
    circle = layout.angle[plain] & ~(np.isfinite(low) & np.isfinite(high))
    low, high = np.where(circle, -np.pi, low), np.where(circle, np.pi, high)
    boxed = np.isfinite(low) & np.isfinite(high)
    free = _free(equations, base, plain, cube) if sizes is None else _sized(layout.positive[plain], plain, cube, sizes)
    free = np.where(np.isfinite(low), low + np.abs(free), np.where(np.isfinite(high), high - np.abs(free), free))
    with np.errstate(invalid="ignore"):
        return np.where(boxed, low + cube * (high - low), free)


def _free(equations: Assembled, base: Floats, plain: Indices, cube: Floats) -> Floats:
    """Numbers (count, some) as large as the changes that would cancel single residuals."""
    scale = scales(equations, base, plain)[plain]
    free = scale * np.tan(np.pi / 2 * WIDEST * (2 * cube - 1))
    positive = scale * 10.0 ** (POSITIVE_DECADES * (2 * cube - 1))
    return np.where(equations.layout.positive[plain], positive, free)


def _sized(positive: Mask, plain: Indices, cube: Floats, sizes: Magnitudes) -> Floats:
    """Numbers (count, some) of the sizes that are told, of either sign; half of them among the values that are told."""
    first, last = sizes.first[plain], sizes.last[plain]
    among = np.isfinite(first) & np.isfinite(last) & ~positive
    edge = BEYOND * (last - first)
    share = np.where(among, 2 * cube - 1, cube)
    sign = np.where(positive | (share >= 0.5), 1.0, -1.0)
    within = np.where(positive, share, np.abs(2 * share - 1))
    low, high = np.nan_to_num(sizes.low[plain]), np.nan_to_num(sizes.high[plain])
    tail = (1 - CORE) / 2
    powers = low + (high - low) * np.clip((within - tail) / CORE, 0.0, 1.0)
    powers += POSITIVE_DECADES * (np.minimum(within / tail, 1.0) - 1 + np.maximum((within - 1 + tail) / tail, 0.0))
    size = np.clip(10.0**powers, sizes.least[plain], sizes.most[plain])
    return np.where(among & (cube < 0.5), first - edge + 2 * cube * (last - first + 2 * edge), sign * size)


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
            residuals, jacobian = equations.linearised(point)
            steps = np.abs(residuals[:, None] / jacobian)
        found.append(np.where(np.isfinite(steps) & (steps > 0), steps, np.nan))
    result = np.ones(len(layout.number))
    every = np.vstack(found)
    for column, place in enumerate(free):
        known = every[np.isfinite(every[:, column]), column]
        if known.size:
            result[place] = np.clip(np.median(known), 1e-9, 1e9)
    return result
