"""Jacobians of many solves → their triangular factors, all at once, where nothing is near to being undetermined.

Of robust losses, what is known of all solves side by side: their roots, and what they make of covariances.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.losses import loss_weights
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.portion import Portion
from mbm.estimation.trust.nonlinearity import ORTHONORMAL
from mbm.estimation.uncertainty.sandwich import information, pools
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


def counted(portion: Portion, residuals: Floats) -> Mask:
    """Which of the residuals (K, m) count at all: those that consensus keeps, with a weight above zero."""
    found = portion.kept()
    for each in portion.lines:
        if not each.group.counting.all():
            found[each.solve[:, None], each.slots] &= each.group.counting
    return found & (loss_weights(portion.acting(), residuals) > 0.0) if portion.equations.lossy else found


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
    known = portion.by_slot([np.zeros(1) if unknown[each.group.kernel.owner] else None for each in portion.lines])
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


if TYPE_CHECKING:
    from mbm.estimation.batches.types import Tangents

WELL_DETERMINED = 1e7
"""Condition of the column-scaled Jacobian up to which two rounds of Cholesky decomposition give the factor to rounding
(Yamamoto et al. 2015); far from 1e9, where the rank begins to be a matter of decision (`decisions.SUSPECT`)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factors:
    """Of K Jacobians J (K, m, n): ``root`` (K, n, n) with ``root @ rootᵀ = (JᵀJ)⁻¹``, ``basis = J @ root`` (K, m, n)
    orthonormal, where ``good`` (K,); anything elsewhere. ``scale`` (K, n) are the lengths of the columns.

    With constraints the inverse is that on their surface: columns of ``root`` and ``basis`` that are ``gone`` (K, n)
    are zero (None: none is).
    """

    root: Floats
    scale: Floats
    basis: Floats
    good: Mask
    gone: Mask | None = None


@np.errstate(all="ignore")
def factors(jacobian: Floats, along: Tangents | None = None) -> Factors:
    """The factors of K Jacobians (K, m, n), of movements ``along`` the surface of constraints alone.

    ``good`` where they are of full rank beyond doubt.
    """
    width = jacobian.shape[2]
    gone = None if along is None else along.gone
    if along is None:
        length = np.sqrt(np.einsum("kmn,kmn->kn", jacobian, jacobian))
        good = (np.isfinite(length) & (length > 0.0)).all(axis=1)
        root = np.broadcast_to(np.eye(width), (len(jacobian), width, width))
    else:
        length, root = along.scale, along.basis
        good = along.clear & np.isfinite(jacobian).all(axis=(1, 2))
    scale = np.where(good[:, None], length, 1.0)
    basis = jacobian / scale[:, None, :]
    basis[~good] = 0.0
    if along is not None:
        basis = np.matmul(basis, root)
    for _ in range(2):
        inverse, sound = inverse_root(filled(np.matmul(basis.transpose(0, 2, 1), basis), gone))
        good &= sound
        root = np.matmul(root, inverse)
        basis = np.matmul(basis, inverse)
    # columns of length 1: the largest singular value is √n at most, the smallest at least 1/‖root‖
    condition = np.sqrt(width) * np.sqrt(np.square(root).sum(axis=(1, 2)))
    good &= condition <= WELL_DETERMINED
    return Factors(root=root / scale[:, :, None], scale=scale, basis=basis, good=good, gone=gone)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Factors (K, n, n) of the covariances where ``sound`` (K,), and what they are made of.

    ``root`` and ``scale`` as `Factors` has them, of the Jacobian with the information that there is; ``basis``
    (K, m, n) is that Jacobian times a factor of the covariance, but for the estimated noise, whose factor is
    ``deviation`` (K,), 1 where noise is stated. ``looked_at`` (K,): the covariance is that factor squared times the
    inverse normal equations, so that intervals may be looked at.
    """

    factor: Floats
    root: Floats
    scale: Floats
    basis: Floats
    deviation: Floats
    looked_at: Mask
    sound: Mask

    @property
    def sigma(self) -> Floats:
        """Standard deviations (K, n)."""
        return np.asarray(np.sqrt(np.square(self.factor).sum(axis=2)))


def filled(gram: Floats, gone: Mask | None) -> Floats:
    """Symmetric matrices (K, n, n) with 1 on the diagonal for what is ``gone`` (K, n), so that they have an inverse."""
    return gram if gone is None else gram + gone[:, :, None] * np.eye(gram.shape[1])


def inverse_root(gram: Floats) -> tuple[Floats, Mask]:
    """Upper triangular (K, n, n) X with ``Xᵀ G X = 1``, and where there is one (K,): Cholesky's, all K together."""
    count, width, _ = gram.shape
    lower = np.zeros_like(gram)
    sound = np.ones(count, dtype=bool)
    for j in range(width):
        rest = gram[:, j:, j] - np.einsum("kij,kj->ki", lower[:, j:, :j], lower[:, j, :j])
        sound &= rest[:, 0] > 0.0
        pivot = np.sqrt(np.where(rest[:, 0] > 0.0, rest[:, 0], 1.0))
        lower[:, j:, j] = rest / pivot[:, None]
        lower[:, j, j] = pivot
    inverse = np.zeros_like(gram)
    for j in range(width):
        inverse[:, j, j] = 1.0 / lower[:, j, j]
        for i in range(j + 1, width):
            inverse[:, i, j] = -np.einsum("kr,kr->k", lower[:, i, j:i], inverse[:, j:i, j]) / lower[:, i, i]
    return inverse.transpose(0, 2, 1), sound
