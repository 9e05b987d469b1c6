"""Where random starts lie: scrambled Sobol points in the unit cube, and rotations and directions made of them.

Point number i depends on the seed, on i and on the dimension alone: more points only append, and any split of the work
gives the same ones.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from mbm.equations.types import Floats

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
