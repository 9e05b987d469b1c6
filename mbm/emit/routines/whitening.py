"""From stated noise to weights: L⁻¹ of a covariance, Lᵀ of an information matrix (as `mbm.equations.whitening`)."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.noise_roots import SYMMETRIC


def weight_of_sigma(sigma: Real, weights: Reals) -> Integer:
    """1/σ; 0 where the standard deviation is none."""
    weights[0] = 1.0 / sigma
    good = 0
    if sigma > 0.0 and sigma - sigma == 0.0:
        good = 1
    return good


def lower_factor(matrix: ConstantReals, size: Integer, lower: Reals) -> Integer:
    """Cholesky's factor of a matrix row by row; 0 where it is not symmetric and positive definite."""
    largest = 0.0
    for i in range(size * size):
        if not fabs(matrix[i]) <= largest:
            largest = fabs(matrix[i])
    if largest - largest != 0.0:
        return 0
    for i in range(size):
        for j in range(size):
            lower[i * size + j] = 0.0
            if fabs(matrix[i * size + j] - matrix[j * size + i]) > SYMMETRIC * largest:
                return 0
    for j in range(size):
        for i in range(j, size):
            total = matrix[i * size + j]
            for k in range(j):
                total -= lower[i * size + k] * lower[j * size + k]
            if i == j:
                if not total > 0.0:
                    return 0
                lower[j * size + j] = sqrt(total)
            else:
                lower[i * size + j] = total / lower[j * size + j]
    return 1


def weights_of_covariance(matrix: ConstantReals, size: Integer, lower: Reals, weights: Reals) -> Integer:
    """L⁻¹ (size, size); ``lower`` is scratch of the same size. 0 where the covariance is none."""
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for j in range(size):
            for i in range(size):
                total = 1.0 if i == j else 0.0
                for k in range(j, i):
                    total -= lower[i * size + k] * weights[k * size + j]
                weights[i * size + j] = 0.0 if i < j else total / lower[i * size + i]
    return good


def weights_of_information(matrix: ConstantReals, size: Integer, lower: Reals, weights: Reals) -> Integer:
    """Lᵀ (size, size) as for `weights_of_covariance`."""
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for i in range(size):
            for j in range(size):
                weights[i * size + j] = lower[j * size + i]
    return good
