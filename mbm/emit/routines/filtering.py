"""What generated filters do besides filtering: noise that is stated by its inverse, and covariances of factors."""

from __future__ import annotations

from math import inf, sqrt

from mbm.emit.routines.whitening import lower_factor
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals
from mbm.solver.linear_algebra import filled, solve_lower, sum_of_products


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
