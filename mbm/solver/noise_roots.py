"""The noise of transitions as matrices L: rows equal ``L w`` for a standard normal w, so that it may be singular."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import Integer, Real, Reals

SYMMETRIC = 1e-9
"""Share of its largest element by which a symmetric matrix may be none; of a covariance, that a rank may leave."""

NEGLIGIBLE = 1e-12
"""A variance that is left of a covariance and is this share of the largest, or less, is rounding."""


def root_of_sigma(sigma: Real, root: Reals) -> Integer:
    """A standard deviation, which may be 0, as its own root; 0 where it is none."""
    root[0] = sigma
    good = 0
    if sigma >= 0.0 and sigma - sigma == 0.0:
        good = 1
    return good


def root_of_covariance(matrix: Reals, size: Integer, width: Integer, stride: Integer, root: Reals) -> Integer:
    """L (size, width), rows ``stride`` apart, with ``L Lᵀ`` the matrix, which may be singular and is used up.

    Cholesky's factor with the largest variance first (Higham 1990). 0 where the matrix is no covariance, or of a higher
    rank than ``width``.
    """
    largest = 0.0
    for i in range(size):
        if not matrix[i * size + i] >= 0.0:
            return 0
        largest = max(largest, matrix[i * size + i])
    for i in range(size):
        for j in range(i):
            if not fabs(matrix[i * size + j] - matrix[j * size + i]) <= SYMMETRIC * largest:
                return 0
    if largest - largest != 0.0:
        return 0
    for column in range(width):
        best = 0
        for i in range(size):
            root[i * stride + column] = 0.0
            if matrix[i * size + i] > matrix[best * size + best]:
                best = i
        if matrix[best * size + best] > NEGLIGIBLE * largest:
            pivot = sqrt(matrix[best * size + best])
            for i in range(size):
                root[i * stride + column] = matrix[i * size + best] / pivot
            for i in range(size):
                for j in range(size):
                    matrix[i * size + j] -= root[i * stride + column] * root[j * stride + column]
    for i in range(size):
        if not fabs(matrix[i * size + i]) <= SYMMETRIC * largest:
            return 0
    return 1


def roots_of_covariances(count: Integer, size: Integer, matrices: Reals, roots: Reals) -> Integer:
    """``roots`` (count, size, size) of so many ``matrices``, which are used up; how many have one."""
    found = 0
    square = size * size
    for i in range(count):
        found += root_of_covariance(matrices[i * square :], size, size, size, roots[i * square :])
    return found
