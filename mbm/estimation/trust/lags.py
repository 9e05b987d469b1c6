"""Whether residuals of successive rows are correlated: independent noise, a right model and right weights leave none.

The statistic is r = Σ eᵢeᵢ₊₁ / Σ eᵢ² over the rows of each clause in their order, as in the test of Durbin and Watson
(1950, Biometrika 37, 409–428). Of fitted residuals e = Mu it is not centred at 0; its mean and variance under
independent normal noise u follow from the traces of MB and MBMB, where B averages over both neighbours.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Indices, Minimum
from mbm.estimation.trust import faults
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

ALIKE, OPPOSED = 1.70, 2.58
"""Standard deviations from the mean beyond which successive residuals are taken to be correlated: positively, which
makes standard deviations too small, by chance in 4.5 % of all solves; negatively, in 0.5 %."""

LEAST_FREEDOM, CHECKED_HALF = 7.5, 0.499
"""Degrees of freedom of the rows looked at from which the test can tell anything, all of them and for each row; next to
whole numbers, which roundings may fall short of."""


def in_order(problem: Problem, owner: int) -> bool:
    """Whether the rows of a block stand in an order."""
    block = problem.blocks[owner]
    return block.role is BlockRole.OBSERVATION and block.table is not None and problem.sequence is None


@np.errstate(all="ignore")
def lag_scores(residuals: Floats, basis: Floats, following: Indices) -> tuple[Floats, Floats, Floats]:
    """r, its mean and its standard deviation (…,); the latter NaN where too few rows follow one another.

    ``residuals`` (…, m); ``basis`` (…, m, k) orthonormal, the directions in which they follow the estimates;
    ``following`` (…, m) is the place of the residual after each, -1 for none.
    """
    count = residuals.shape[-1]
    has = following >= 0
    first = np.flatnonzero(has)
    second = first - first % count + following.ravel()[first]  # of the same data set
    series = has.copy()
    series.ravel()[second] = True
    own = basis if bool(series.all()) else np.where(series[..., None], basis, 0.0)
    lines = own.reshape(residuals.size, own.shape[-1])
    averaged = np.zeros_like(lines)
    averaged[first] = lines[second]
    averaged[second] += lines[first]
    averaged = averaged.reshape(own.shape) / 2.0
    turned = np.swapaxes(own, -1, -2)
    crossed, squared = np.matmul(turned, averaged), np.matmul(turned, own)
    inside = np.einsum("...ii->...", squared)
    mean = -np.einsum("...ii->...", crossed)
    length = series.sum(axis=-1)
    free = length - inside
    trace = has.sum(axis=-1) / 2.0 - 2.0 * np.square(averaged).sum(axis=(-2, -1)) + _double(crossed)
    whole = length - 2.0 * inside + _double(squared)
    expected = mean / free
    spread = np.sqrt((2.0 * trace + np.square(mean)) / (np.square(free) + 2.0 * whole) - np.square(expected))
    products = np.zeros(residuals.shape)
    products.ravel()[first] = residuals.ravel()[first] * residuals.ravel()[second]
    found = products.sum(axis=-1) / np.where(series, np.square(residuals), 0.0).sum(axis=-1)
    return (
        found,
        expected,
        np.where((free >= LEAST_FREEDOM) & (free >= CHECKED_HALF * length), spread, np.nan),
    )


def correlated(found: Floats, expected: Floats, spread: Floats, share: float = 0.0) -> np.ndarray:
    """Where r is beyond what chance makes of it, or nearer to that than by a ``share``."""
    away = (found - expected) / spread
    return np.asarray((away > ALIKE * (1.0 - share)) | (away < -OPPOSED * (1.0 - share)))


@np.errstate(all="ignore")
def autocorrelation(
    problem: Problem, equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """A warning where residuals at a minimum are correlated along the rows."""
    if (
        minimum.blocks is not None
        or equations.rows is not None
        or equations.likely
        or len(minimum.residuals) != equations.count
    ):
        return ()
    following = np.full(equations.count, -1, dtype=np.int64)
    for group in equations.groups:
        if in_order(problem, group.kernel.owner) and group.rows > 1:
            places = group.first + np.arange(group.count - group.kernel.outputs)
            following[places] = places + group.kernel.outputs
    image = minimum.jacobian @ estimated.factor
    if not bool((following >= 0).any()) or not bool(np.isfinite(image).all()) or minimum.cost == 0.0:
        return ()
    basis = np.linalg.qr(image)[0]
    found, expected, spread = lag_scores(minimum.residuals, basis, following)
    if not correlated(found, expected, spread):
        return ()
    return (faults.autocorrelated_residuals(problem.span, float(found), float(expected), float(spread)),)


def _double(matrix: Floats) -> Floats:
    """The trace of the square of matrices (…, k, k)."""
    return np.asarray(np.einsum("...ij,...ji->...", matrix, matrix))
