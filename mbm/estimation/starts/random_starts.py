"""Random points to start from: uniform over boxes, rotations and directions; elsewhere as wide as the data suggest.

They are scrambled Sobol points in the unit cube, and rotations and directions made of them. Point number i depends on
the seed, on i and on the dimension alone: more points only append, and any split of the work gives the same ones.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.magnitudes import Magnitudes
from mbm.problem.manifold import Piece

_TABLE = (
    "3:1 7:1,3 11:1,3,1 13:1,1,1 19:1,1,3,3 25:1,3,5,13 37:1,1,5,5,17 41:1,1,5,5,5 47:1,1,7,11,19 55:1,1,5,1,1 "
    "59:1,1,1,3,11 61:1,3,5,5,31 67:1,3,3,9,7,49 91:1,1,1,15,21,21 97:1,3,1,13,27,49 103:1,1,1,15,7,5 "
    "109:1,3,1,15,13,25 115:1,1,5,5,19,61 131:1,3,7,11,23,15,103 137:1,3,7,13,13,15,69 143:1,1,3,13,7,35,63 "
    "145:1,3,5,9,1,25,53 157:1,3,1,13,9,35,107 167:1,3,1,5,27,61,31 171:1,1,5,11,19,41,61 185:1,3,5,3,3,13,69 "
    "191:1,1,7,13,1,19,1 193:1,3,7,5,13,19,59 203:1,1,3,9,25,29,41 211:1,3,5,13,23,1,55 213:1,3,7,3,13,59,17 "
    "229:1,3,1,3,5,53,69 239:1,1,5,5,23,33,13 241:1,1,7,7,1,61,123 247:1,1,7,9,13,61,49 253:1,3,3,5,3,55,33 "
    "285:1,3,1,15,31,13,49,245 299:1,3,5,15,31,59,63,97 301:1,3,1,11,11,11,77,249"
)
"""Primitive polynomials (as bits) and initial direction numbers of dimensions 2 … 40: Joe and Kuo (2008, SIAM J. Sci.
Comput. 30, 2635-2654), `new-joe-kuo-6`."""

BITS = 32
"""Binary digits of a coordinate before the scrambling's own."""


def sobol(count: int, dimension: int, seed: int) -> Floats:
    """The first ``count`` points of the scrambled Sobol sequence, shape (count, dimension), in [0, 1).

    Scrambled by a random lower triangular matrix and a digital shift for each dimension (Matoušek 1998). Dimensions
    beyond the table's forty are independent random numbers.
    """
    directions = _directions()
    points = np.empty((count, dimension))
    gray = np.arange(count, dtype=np.uint64)
    gray ^= gray >> np.uint64(1)
    for axis in range(dimension):
        generator = np.random.default_rng([seed, axis])
        if axis >= len(directions):
            points[:, axis] = generator.random(count)
            continue
        columns = _scrambled(directions[axis], generator)
        digits = np.full(count, generator.integers(0, 1 << BITS, dtype=np.uint64))
        for bit in range(int(count).bit_length()):
            digits ^= np.where((gray >> np.uint64(bit)) & np.uint64(1), columns[bit], np.uint64(0))
        points[:, axis] = (digits + 0.5) / 2.0**BITS
    return points


def rotations(cube: Floats) -> Floats:
    """Uniformly distributed unit quaternions (w, x, y, z), shape (T, 4), from points of the cube (T, 3).

    Shoemake (1992), Uniform random rotations, Graphics Gems III.
    """
    inner, outer = np.sqrt(1.0 - cube[:, 0]), np.sqrt(cube[:, 0])
    first, second = 2.0 * np.pi * cube[:, 1], 2.0 * np.pi * cube[:, 2]
    parts = (outer * np.cos(second), inner * np.sin(first), inner * np.cos(first), outer * np.sin(second))
    return np.stack(parts, axis=1)


def directions(cube: Floats) -> Floats:
    """Uniformly distributed unit vectors (T, 3) from points of the square (T, 2): Archimedes' hat-box theorem."""
    height = 2.0 * cube[:, 0] - 1.0
    radius = np.sqrt(1.0 - height * height)
    turn = 2.0 * np.pi * cube[:, 1]
    return np.stack((radius * np.cos(turn), radius * np.sin(turn), height), axis=1)


@cache
def _directions() -> NDArray[np.uint64]:
    """Direction numbers (dimensions, BITS), digit 1 highest; the first dimension is van der Corput's sequence."""
    rows = [[1 << (BITS - 1 - k) for k in range(BITS)]]
    for entry in _TABLE.split():
        polynomial, numbers = entry.split(":")
        coefficients = int(polynomial)
        degree = coefficients.bit_length() - 1
        column = [int(m) << (BITS - 1 - k) for k, m in enumerate(numbers.split(","))]
        for k in range(degree, BITS):
            value = column[k - degree] ^ (column[k - degree] >> degree)
            for j in range(1, degree):
                if coefficients >> (degree - j) & 1:
                    value ^= column[k - j]
            column.append(value)
        rows.append(column)
    return np.array(rows, dtype=np.uint64)


def _scrambled(columns: NDArray[np.uint64], generator: np.random.Generator) -> NDArray[np.uint64]:
    """The direction numbers of a dimension multiplied by a random lower triangular matrix of binary digits."""
    shifts = np.arange(BITS - 1, -1, -1, dtype=np.uint64)
    digits = ((columns[:, None] >> shifts) & np.uint64(1)).astype(np.int64)
    lower = np.tril(generator.integers(0, 2, size=(BITS, BITS)), -1) + np.eye(BITS, dtype=np.int64)
    mixed = (digits @ lower.T) % 2
    return np.asarray((mixed.astype(np.uint64) << shifts).sum(axis=1, dtype=np.uint64))


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
        if len(points) <= SINGLE:
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
