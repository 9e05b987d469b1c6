"""Whether residuals of successive rows are correlated: independent noise, a right model and right weights leave none.

The statistic is r = Σ eᵢeᵢ₊₁ / Σ eᵢ² over the rows of each clause in their order, as in the test of Durbin and Watson
(1950, Biometrika 37, 409–428). Of fitted residuals e = Mu it is not centred at 0; its mean and variance under
independent normal noise u follow from the traces of MB and MBMB, where B averages over both neighbours.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Indices, Minimum
from mbm.estimation.minimise.native.tails import solver_code
from mbm.estimation.native.code import AnyCode
from mbm.estimation.trust import faults
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

ALIKE, OPPOSED = 1.70, 2.58
"""Standard deviations from the mean beyond which successive residuals are taken to be correlated: positively, which
makes standard deviations too small, by chance in 4.5 % of all solves; negatively, in 0.5 %."""


def in_order(problem: Problem, owner: int) -> bool:
    """Whether the rows of a block stand in an order."""
    block = problem.blocks[owner]
    return block.role is BlockRole.OBSERVATION and block.table is not None and problem.sequence is None


def directions(equations: Assembled, minimum: Minimum, estimated: Covariance) -> Floats:
    """The orthonormal directions (m, k) in which residuals follow the estimates; NaN where one has no number."""
    image = minimum.jacobian @ estimated.factor
    if not equations.lossy and estimated.variance > 0.0:  # the factor is that of the inverse normal equations
        return np.asarray(image / np.sqrt(estimated.variance))
    return np.linalg.qr(image)[0] if bool(np.isfinite(image).all()) else np.full(image.shape, np.nan)


def lag_scores(code: AnyCode, residuals: Floats, basis: Floats, following: Indices) -> tuple[Floats, Floats, Floats]:
    """r, its mean and its standard deviation (…,); the latter NaN where too few rows follow one another.

    ``residuals`` (…, m); ``basis`` (…, m, k) orthonormal, the directions in which they follow the estimates;
    ``following`` (…, m) is the place of the residual after each, -1 for none. ``code`` is the solver's.
    """
    m, k = basis.shape[-2:]
    shape = residuals.shape[:-1]
    count = residuals.size // m
    scores, scratch = np.empty((*shape, 3)), np.empty(2 * k * (m + k) + m)
    code.expect(float(count * m * k * (2 * k + 4)))
    find = code.routine("lag_scores", int, int, int, *[object] * 5)
    find(count, m, k, *map(np.ascontiguousarray, (residuals, basis, following)), scratch, scores)
    return scores[..., 0], scores[..., 1], np.where(scores[..., 2] > 0.0, scores[..., 2], np.nan)


def correlated(found: Floats, expected: Floats, spread: Floats, share: float = 0.0) -> np.ndarray:
    """Where r is beyond what chance makes of it, or nearer to that than by a ``share``."""
    away = (found - expected) / spread
    return np.asarray((away > ALIKE * (1.0 - share)) | (away < -OPPOSED * (1.0 - share)))


@np.errstate(all="ignore")
def autocorrelation(
    problem: Problem,
    equations: Assembled,
    minimum: Minimum,
    basis: Floats,
    tested: Indices,
    *,
    overstated: bool,
) -> tuple[Diagnostic, ...]:
    """A warning where residuals at a minimum are correlated along the rows, but for places that are ``tested`` (k,).

    ``basis`` (m, k) has the directions in which residuals follow the estimates;
    ``overstated``: chi² says that the stated noise is too large.
    """
    if equations.rows is not None or equations.likely:
        return ()
    following = np.full(equations.count, -1, dtype=np.int64)
    for group in equations.groups:
        if in_order(problem, group.kernel.owner) and group.rows > 1:
            places = group.first + np.arange(group.count - group.kernel.outputs)
            following[places] = places + group.kernel.outputs
    following[tested] = -1
    if not bool((following >= 0).any()) or not bool(np.isfinite(basis).all()):
        return ()
    found, expected, spread = lag_scores(solver_code(equations), minimum.residuals, basis, following)
    if not correlated(found, expected, spread):
        return ()
    sums = float(found), float(expected), float(spread)
    return (faults.autocorrelated_residuals(problem.span, *sums, overstated=overstated),)
