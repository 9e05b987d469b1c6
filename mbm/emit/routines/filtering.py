"""What generated filters do besides filtering: noise that is stated by its inverse, and covariances of factors.

From stated noise to weights: L⁻¹ of a covariance, Lᵀ of an information matrix (as `mbm.equations.whitening`).
"""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.linear_algebra import cholesky, copied, filled, solve_lower, solve_lower_transposed, sum_of_products
from mbm.solver.noise_roots import SYMMETRIC


def weight_of_sigma(sigma: Real, weights: Reals) -> Integer:
    """1/σ; 0 where the standard deviation is none."""
    weights[0] = 1.0 / sigma
    good = 0
    if sigma > 0.0 and sigma - sigma == 0.0:
        good = 1
    return good


def lower_factor(matrix: ConstantReals, size: Integer, lower: Reals) -> Integer:
    """The lower triangle becomes Cholesky's factor of a matrix; 0: that is not symmetric and positive definite."""
    largest = 0.0
    for i in range(size * size):
        if not fabs(matrix[i]) <= largest:
            largest = fabs(matrix[i])
    if largest - largest != 0.0:
        return 0
    for i in range(size):
        for j in range(size):
            if fabs(matrix[i * size + j] - matrix[j * size + i]) > SYMMETRIC * largest:
                return 0
    copied(size * size, matrix, lower)
    return cholesky(size, lower)


def weights_of_covariance(matrix: ConstantReals, size: Integer, lower: Reals, weights: Reals) -> Integer:
    """L⁻¹ (size, size); ``lower`` is scratch of the same size. 0 where the covariance is none."""
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for i in range(size):
            row = weights[i * size :]
            filled(size, 0.0, row)
            row[i] = 1.0
            solve_lower_transposed(size, lower, row)
    return good


def weights_of_information(matrix: ConstantReals, size: Integer, lower: Reals, weights: Reals) -> Integer:
    """Lᵀ (size, size) as for `weights_of_covariance`."""
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for i in range(size):
            for j in range(size):
                weights[i * size + j] = lower[j * size + i] if j >= i else 0.0
    return good


def root_of_information(matrix: ConstantReals, size: Integer, stride: Integer, lower: Reals, root: Reals) -> Integer:
    """L (size, size) with ``L Lᵀ`` the inverse of an information matrix ``M Mᵀ``: ``M⁻ᵀ``. 0 where there is none.

    ``lower`` (size, size) is scratch.
    """
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for i in range(size):
            row = root[i * stride :]
            filled(size, 0.0, row)
            row[i] = 1.0
            solve_lower(size, lower, row)
    return good


def put_covariance(
    n: Integer, factor: ConstantReals, touched: ConstantIntegers, covariance: Reals, deviations: Reals
) -> None:
    """``UᵀU`` (n, n) of a factor, and the standard deviations; NaN, and -1, of coordinates that are not determined."""
    sum_of_products(n, n, factor, factor, covariance)
    for i in range(n):
        for j in range(n):
            if touched[i] == 1 or touched[j] == 1:
                covariance[i * n + j] = inf - inf
        deviations[i] = -1.0 if touched[i] == 1 else sqrt(covariance[i * n + i])
