"""What generated filters do besides filtering: noise that is stated by its inverse, and covariances of factors."""

from __future__ import annotations

from math import inf, sqrt

from mbm.emit.routines.whitening import lower_factor
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals


def root_of_information(matrix: ConstantReals, size: Integer, stride: Integer, lower: Reals, root: Reals) -> Integer:
    """L (size, size) with ``L Lᵀ`` the inverse of an information matrix ``M Mᵀ``: ``M⁻ᵀ``. 0 where there is none.

    ``lower`` (size, size) is scratch.
    """
    good = lower_factor(matrix, size, lower)
    if good == 1:
        for column in range(size):
            for k in range(size):
                i = size - 1 - k
                total = 1.0 if i == column else 0.0
                for j in range(i + 1, size):
                    total -= lower[j * size + i] * root[j * stride + column]
                root[i * stride + column] = total / lower[i * size + i]
    return good


def put_covariance(
    n: Integer, factor: ConstantReals, touched: ConstantIntegers, covariance: Reals, deviations: Reals
) -> None:
    """``UᵀU`` (n, n) of a factor, and the standard deviations; NaN, and -1, of coordinates that are not determined."""
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += factor[k * n + i] * factor[k * n + j]
            if touched[i] == 1 or touched[j] == 1:
                total = inf - inf
            covariance[i * n + j] = total
            covariance[j * n + i] = total
        deviations[i] = -1.0 if touched[i] == 1 else sqrt(covariance[i * n + i])
