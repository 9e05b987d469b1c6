"""Robust losses in many solves: what is known of all of them side by side."""

from __future__ import annotations

import numpy as np

from mbm.equations.losses import rooted, rooted_jacobian
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.factor import filled, inverse_root
from mbm.estimation.batches.portion import Portion
from mbm.estimation.consensus.scores import STATED_CUT
from mbm.estimation.consensus.units import limits
from mbm.estimation.trust.nonlinearity import ORTHONORMAL
from mbm.estimation.uncertainty.pools import information, pools
from mbm.solver.decisions import EXHAUSTED
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sandwiches:
    """Covariances of K solves: their factors are ``own`` (K, n, n) in the coordinates at hand, where ``sound`` (K,).

    ``plain`` (K,): next to nothing is weighed down, so that they may be ``deviation`` (K,) squared times the inverse
    normal equations, for which alone `nonlinearity.surroundings` is made.
    """

    own: Floats
    sound: Mask
    plain: Mask
    deviation: Floats


def rooted_residuals(portion: Portion, residuals: Floats) -> Floats:
    """Residuals (K, m) in square-root form, from the plain ones; these where there are no losses."""
    result = residuals.copy() if portion.equations.lossy else residuals
    for loss, solve, slots in portion.losses():
        place = solve[:, None]
        result[place, slots] = rooted(loss, residuals[place, slots])
    return result


def rooted_slopes(portion: Portion, residuals: Floats, slopes: Floats) -> Floats:
    """Derivatives (K, m, n) of the residuals in square-root form, from those of the plain ones."""
    result = slopes.copy()
    for loss, solve, slots in portion.losses():
        place = solve[:, None]
        result[place, slots] = rooted_jacobian(loss, residuals[place, slots], slopes[place, slots])
    return result


def counted(portion: Portion, residuals: Floats) -> Mask:
    """Which of the residuals (K, m) count at all: those that consensus keeps, with a weight above zero."""
    found = portion.kept()
    for group, solve, slots in portion.bound_groups():
        if not group.counting.all():
            found[solve[:, None], slots] &= group.counting
    for loss, solve, slots in portion.losses():
        place = solve[:, None]
        found[place, slots] &= (loss.weight(np.square(residuals[place, slots]).sum(axis=1)) > 0.0)[:, None]
    return found


def outlying(portion: Portion, residuals: Floats, number: int, rows: int) -> Mask:
    """The ``rows`` (R,) of a group that some equation takes for an outlier, as `preparation.outliers` does."""
    found = np.zeros(rows, dtype=bool)
    for _, solve, slots in portion.losses(number):
        squares = np.square(residuals[solve[:, None], slots]).sum(axis=1)
        found |= ~(squares <= limits(np.full(1, slots.shape[1]), STATED_CUT)[0])
    return found


@np.errstate(all="ignore")
def sandwiches(
    portion: Portion, residuals: Floats, slopes: Floats, root: Floats, unknown: Mask, gone: Mask | None = None
) -> Sandwiches:
    """The covariances ``H⁻¹ G H⁻¹``, of what `robust.pools` has of each loss.

    ``residuals`` (K, m) and ``slopes`` (K, m, n) are plain; ``root`` (K, n, n) are coordinates in which to calculate,
    best those that make the normal equations with losses the identity. Columns that are ``gone`` (K, n) are zero in it.
    ``unknown`` (blocks,) says whose noise was estimated.
    """
    along = np.matmul(slopes, root)
    known = portion.by_slot([None if not unknown[owner] else np.zeros(1) for owner, _, _ in portion.groups()])
    pooled = pools(portion.losses(), residuals, along, known)
    half, sound = inverse_root(filled(pooled.curvature, gone))
    # in these coordinates the weights leave 1 at least: where there is next to none of it, the general path decides
    sound &= np.square(half).sum(axis=(1, 2)) < 1.0 / EXHAUSTED
    inverse = np.matmul(half, half.transpose(0, 2, 1))
    whole = filled(pooled.spread(inverse), gone)
    upper, definite = inverse_root(whole)
    # S = L Lᵀ, and X with Xᵀ S X = 1 is L⁻ᵀ
    return _judged(np.matmul(inverse, np.matmul(whole, upper)), sound & definite, gone)


@np.errstate(all="ignore")
def informed(weights: Floats, basis: Floats) -> Sandwiches:
    """The covariances ``(Jᵀ W J)⁻¹``, W the ``weights`` (K, m) of what is known, J the ``basis`` (K, m, n)."""
    return _judged(*inverse_root(information(weights, basis)))


def _judged(own: Floats, sound: Mask, gone: Mask | None = None) -> Sandwiches:
    gram = np.matmul(own.transpose(0, 2, 1), own)
    there = np.ones(gram.shape[:2]) if gone is None else 1.0 - gone
    gram = gram * there[:, :, None]
    variance = np.trace(gram, axis1=1, axis2=2) / np.maximum(there.sum(axis=1), 1.0)
    off = np.abs(gram / variance[:, None, None] - there[:, :, None] * np.eye(gram.shape[1])).max(axis=(1, 2))
    return Sandwiches(own=own, sound=sound, plain=~(off > 2 * ORTHONORMAL), deviation=np.sqrt(variance))
