"""Residuals of rows that follow one another: alike, or opposed, beyond what independent noise lets expect."""

from __future__ import annotations

from functools import partial

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.native.tails import lags_code
from mbm.estimation.native.code import AnyCode
from mbm.estimation.trust import faults
from mbm.estimation.trust.fits import Fits, Said
from mbm.problem.types import BlockRole, Problem

ALIKE, OPPOSED = 1.70, 2.58
"""Standard deviations from the mean beyond which successive residuals are taken to be correlated: positively, which
makes standard deviations too small, by chance in 4.5 % of all solves; negatively, in 0.5 %."""

FEW, FEW_ALIKE = 7.5, 2.1
"""Degrees of freedom below which it takes more, by chance in 2 %: means of 6 to 8 readings, lines of 7 to 9."""


def in_order(problem: Problem, owner: int) -> bool:
    """Whether the rows of a block stand in an order."""
    block = problem.blocks[owner]
    return block.role is BlockRole.OBSERVATION and block.table is not None and problem.sequence is None


def directions(image: Floats, *, scaled: bool) -> Floats:
    """The orthonormal directions (m, k) in which residuals follow the estimates; NaN where one has no number.

    ``image`` (m, k) is their Jacobian times a factor of the covariance, which is ``scaled`` to the normal equations.
    """
    if scaled:
        return image
    return np.linalg.qr(image)[0] if bool(np.isfinite(image).all()) else np.full(image.shape, np.nan)


def lag_scores(code: AnyCode, residuals: Floats, basis: Floats, following: Indices) -> tuple[Floats, ...]:
    """r, its mean, its standard deviation, NaN where too few rows follow one another, and degrees of freedom (…,).

    ``residuals`` (…, m); ``basis`` (…, m, k) orthonormal, the directions in which they follow the estimates;
    ``following`` (…, m) is the place of the residual after each, -1 for none. ``code`` is the solver's.
    """
    m, k = basis.shape[-2:]
    shape = residuals.shape[:-1]
    count = residuals.size // m
    scores, scratch = np.empty((*shape, 4)), np.empty(2 * k * (m + k) + m)
    code.expect(float(count * m * k * (2 * k + 4)))
    find = code.routine("lag_scores", int, int, int, *[object] * 5)
    find(count, m, k, *map(np.ascontiguousarray, (residuals, basis, following)), scratch, scores)
    spread = np.where(scores[..., 2] > 0.0, scores[..., 2], np.nan)
    return scores[..., 0], scores[..., 1], spread, scores[..., 3]


def correlated(found: Floats, expected: Floats, spread: Floats, freedom: Floats) -> np.ndarray:
    """Where r is beyond what chance makes of it."""
    away = (found - expected) / spread
    return np.asarray((away > np.where(freedom < FEW, FEW_ALIKE, ALIKE)) | (away < -OPPOSED))


def autocorrelated(fits: Fits, overstated: Mask, tested: Indices | None = None) -> Said:
    """Residuals that are correlated along the rows, but for places (k,) that are ``tested`` (None: none).

    ``overstated`` (K,): chi² says that the stated noise is too large. Under losses they count by their pull: two large
    errors side by side are no correlation.
    """
    following = _following(fits)
    if following is None:
        return
    if tested is not None:
        following[:, tested] = -1
    scores = lag_scores(lags_code(fits.solves.equations, fits.basis), fits.pull, fits.basis, following)
    for place in np.flatnonzero(correlated(*scores)).tolist():
        numbers, small = [float(each[place]) for each in scores[:3]], bool(overstated[place])
        yield place, partial(faults.autocorrelated_residuals, fits.problem.span, *numbers, overstated=small)


def _following(fits: Fits) -> Indices | None:
    """The places (K, m) of the residuals after each, -1 for none; None where no rows are in order, or none is normal.

    Windows are stacked by time, and a solve by itself has its rows as the table has them.
    """
    if fits.solves.consensus or fits.solves.equations.likely:
        return None
    none = np.full(1, -1, dtype=np.int64)
    every = []
    for each in fits.solves.lines:
        owner, positions, solve = each.group.kernel.owner, each.positions, each.solve
        table, after = fits.problem.blocks[owner].table, none
        if in_order(fits.problem, owner) and len(solve) > 1 and positions is not None and table is not None:
            rows = fits.tables[table].rows[positions]
            same = solve[1:] == solve[:-1]
            sorted_already = bool((rows[1:] > rows[:-1])[same].all())
            order = slice(None) if sorted_already else np.lexsort((rows, solve))
            after = np.full(each.slots.shape, -1, dtype=np.int64)
            after[order] = np.vstack([np.where(same[:, None], each.slots[order][1:], -1), after[:1]])
        every.append(after)
    following = fits.solves.by_slot(every, missing=-1)
    return following if bool((following >= 0).any()) else None
