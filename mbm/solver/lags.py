"""Products of successive residuals, with their moments under independent noise: `mbm.estimation.trust.coarse`."""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.linear_algebra import add_multiple, dot, filled, sum_of_products

LEAST_FREEDOM, CHECKED_HALF = 4.5, 0.499
"""Degrees of freedom of the rows looked at from which the test can tell anything, all of them and for each row; next to
whole numbers, which roundings may fall short of."""


def trace_of_square(k: Integer, matrix: ConstantReals) -> Real:
    """The trace of the square of a matrix (k, k)."""
    total = 0.0
    for i in range(k):
        for j in range(k):
            total += matrix[i * k + j] * matrix[j * k + i]
    return total


def trace(k: Integer, matrix: ConstantReals) -> Real:
    """That of the matrix itself."""
    total = 0.0
    for i in range(k):
        total += matrix[i * k + i]
    return total


def lag_score(
    m: Integer,
    k: Integer,
    residuals: ConstantReals,
    basis: ConstantReals,
    following: ConstantIntegers,
    scratch: Reals,
    score: Reals,
) -> None:
    """r, its mean and standard deviation, and the degrees of freedom of one data set, into ``score`` (4,).

    (0, 0, -1, 0) where nothing is told.

    ``basis`` (m, k) is orthonormal, ``following`` (m,) the place of the residual after each, -1: none follows.
    ``scratch`` has room for 2 k (m + k) + m numbers.
    """
    own = scratch
    averaged = scratch[m * k :]
    crossed = scratch[2 * m * k :]
    squared = scratch[2 * m * k + k * k :]
    series = scratch[2 * k * (m + k) :]
    score[0] = 0.0
    score[1] = 0.0
    score[2] = -1.0
    score[3] = 0.0
    filled(m, 0.0, series)
    filled(2 * m * k, 0.0, scratch)
    products = 0.0
    pairs = 0.0
    for i in range(m):
        after = following[i]
        if after >= 0:
            series[i] = 1.0
            series[after] = 1.0
            pairs += 1.0
            products += residuals[i] * residuals[after]
            add_multiple(k, 0.5, basis[after * k :], averaged[i * k :])
            add_multiple(k, 0.5, basis[i * k :], averaged[after * k :])
    length = 0.0
    squares = 0.0
    for i in range(m):
        if series[i] > 0.0:
            length += 1.0
            squares += residuals[i] * residuals[i]
            add_multiple(k, 1.0, basis[i * k :], own[i * k :])
    sum_of_products(m, k, own, averaged, crossed)
    sum_of_products(m, k, own, own, squared)
    inside = trace(k, squared)
    free = length - inside
    if not (free >= LEAST_FREEDOM and free >= CHECKED_HALF * length and squares > 0.0):
        return
    mean = -trace(k, crossed)
    twice = 0.5 * pairs - 2.0 * dot(m * k, averaged, averaged) + trace_of_square(k, crossed)
    whole = length - 2.0 * inside + trace_of_square(k, squared)
    expected = mean / free
    variance = (2.0 * twice + mean * mean) / (free * free + 2.0 * whole) - expected * expected
    score[0] = products / squares
    score[1] = expected
    score[3] = free
    if variance > 0.0:
        score[2] = sqrt(variance)


def lag_scores(
    count: Integer,
    m: Integer,
    k: Integer,
    residuals: ConstantReals,
    basis: ConstantReals,
    following: ConstantIntegers,
    scratch: Reals,
    scores: Reals,
) -> Integer:
    """The same of so many data sets, one behind the other; 0 is given."""
    for t in range(count):
        lag_score(m, k, residuals[t * m :], basis[t * m * k :], following[t * m :], scratch, scores[4 * t :])
    return 0
