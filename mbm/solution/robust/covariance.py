"""The covariance of estimates with robust losses: the sandwich ``H⁻¹ G H⁻¹`` (Huber 1967), small samples minded.

H is the derivative of the estimating equations ``Σ Jᵀψ = 0``, G the covariance of their left side. Within each loss the
two are pooled over its units, so that they are as certain as the sample allows: with the weights w = ρ', and k the
number of components, ``A = Σ w JᵀJ`` is the information that the weights leave (rows that count nothing leave none),
``H = Σ E[tr Dψ]/(w k) A`` and ``G = Σ E[|ψ|²]/(w k) A``. What has no loss enters both with ``JᵀJ``.

Residuals tell their spread as far as the weights leave more of them than unknowns. Where a loss that ends keeps no
more rows than it takes to fit them exactly, ψ vanishes and with it G, though the next measurements scatter as ever:
there the stated noise counts (`least_spread`).

Beyond the corner of Huber's loss the cost is linear: where next to no residual is inside, ``Σ tr Dψ`` is rounding of
zero, and what only these rows determine can be moved at no cost. Such directions count as free (`flattened`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mbm.solution.covariance import in_datum
from mbm.solution.freedom import free_combinations, touched_by
from mbm.solution.robust.losses import LossFunction
from mbm.solution.types import Covariance, Floats, Indices, Mask, Observability
from mbm.target.decisions import EPSILON, EXHAUSTED, TOLD
from mbm.values import dataclass


def least_spread(slope: float | Floats, total: float | Floats, stated: float | Floats, share: float | Floats) -> Floats:
    """The least factor of A in G: that with which ``H⁻¹ G H⁻¹ = A⁻¹``, as far as residuals cannot tell a smaller one.

    Args:
        slope: the factor of A in H, scalar or (K,) for as many solves.
        total: sum of the weights, over all components.
        stated: that of the components whose noise is stated; nothing is known of the spread of others.
        share: the unknowns that this loss's units determine, so that ``total - share`` is the redundancy that counts.

    """
    told = np.minimum(np.maximum((total - share) / TOLD, 0.0), 1.0)
    return np.asarray((1.0 - told) * slope * slope * stated / np.maximum(total, 1e-300), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Pool:
    """One loss: ``information`` A (r, r) along the estimable directions, and the two factors of it in H and G.

    ``total`` is the sum of the weights over all components, ``stated`` that over those whose noise is stated.
    """

    information: Floats
    slope: float
    spread: float
    count: int
    bend: float
    total: float
    stated: float


@np.errstate(all="ignore")
def sandwich(
    losses: Iterable[tuple[LossFunction, Indices]],
    residuals: Floats,
    jacobian: Floats,
    observed: Observability,
    stated: Mask,
    point: Floats,
) -> tuple[Covariance, Observability]:
    """The covariance of the n coordinates ``point`` (n,), and ``observed`` with what losses leave free as well.

    ``losses`` come with the places (units, k) of the residuals they act on.
    ``residuals`` (m,) and ``jacobian`` (m, n) are plain, whitened with the noise that the estimates hold with, which is
    ``stated`` (m,) or was estimated;
    ``observed`` is the rank decision, in whose estimable subspace the covariance lives.
    """
    basis = observed.row_space / observed.scale[:, None]
    along = np.where(np.isfinite(jacobian), jacobian, 0.0) @ basis
    plain = np.ones(len(residuals), dtype=bool)
    by_loss: dict[LossFunction, list[Indices]] = {}
    for loss, lines in losses:
        plain[lines] = False
        by_loss.setdefault(loss, []).append(lines)
    pools = [_pool(loss, parts, residuals, along, stated) for loss, parts in by_loss.items()]
    fixed = along[plain].T @ along[plain]
    curvature, spread = fixed.copy(), fixed.copy()
    for pool in pools:
        curvature += pool.slope * pool.information
    free = flat_directions(curvature, fixed + sum(pool.information for pool in pools), observed)
    if free is not None:
        observed, kept = flattened(observed, free, point)
        basis = basis @ kept
        curvature, spread = kept.T @ curvature @ kept, kept.T @ spread @ kept
        pools = [replace(pool, information=kept.T @ pool.information @ kept) for pool in pools]
    inverse = np.asarray(np.linalg.pinv(curvature, hermitian=True), dtype=np.float64)
    for pool in pools:
        spread += _corrected(pool, inverse) * pool.information
    lengths, axes = np.linalg.eigh(spread)
    factor = basis @ inverse @ (axes * np.sqrt(np.maximum(lengths, 0.0)))
    return _covariance(in_datum(factor, observed), ~observed.estimable & ~observed.fixed), observed


def curved(slope: float | Floats) -> Floats:
    """The factors of A in H, 0 where they are rounding of it."""
    return np.where(np.abs(slope) > EXHAUSTED, slope, 0.0)


def flat_directions(curvature: Floats, weighed: Floats, observed: Observability) -> Floats | None:
    """Directions (r, k) along which ``curvature`` (r, r) is next to nothing of what is ``weighed`` (r, r); None: none.

    Both in the coordinates of ``row_space``. Divided by the singular values they are well conditioned, as the
    derivatives of the square-root form are never larger than the weights: ``w² s/ρ ≤ w``. Directions that
    nothing weighs (a loss that ends may leave every row without weight) are among those found.
    """
    strengths = observed.singular_values[: len(curvature)]
    across = np.outer(strengths, strengths)
    if not (np.isfinite(curvature).all() and np.isfinite(weighed).all()):
        return None
    weights, turned = np.linalg.eigh(weighed / across)
    felt = weights > EPSILON * np.max(weights, initial=0.0)
    root = turned[:, felt] / np.sqrt(weights[felt])
    shares, axes = np.linalg.eigh(root.T @ (curvature / across) @ root)
    flat = ~(shares > EXHAUSTED)
    if felt.all() and not flat.any():
        return None
    found = np.hstack([root @ axes[:, flat], turned[:, ~felt]]) / strengths[:, None]
    return np.asarray(found / np.sqrt(np.square(found).sum(axis=0)), dtype=np.float64)


def flattened(observed: Observability, free: Floats, point: Floats) -> tuple[Observability, Floats]:
    """The rank decision with the directions ``free`` (r, k) of its row space, and the others (r, r − k) of that."""
    count = free.shape[1]
    turned = np.linalg.qr(free, mode="complete")[0]
    lost, kept = observed.row_space @ turned[:, :count], turned[:, count:]
    changed = replace(
        observed,
        row_space=observed.row_space @ kept,
        null_space=np.hstack([observed.null_space, lost]),
        combinations=(*observed.combinations, *free_combinations(lost, observed.scale, point)),
        estimable=observed.estimable & ~touched_by(lost),
        flat=count,
    )
    return changed, kept


def _pool(loss: LossFunction, parts: list[Indices], residuals: Floats, along: Floats, stated: Mask) -> _Pool:
    """Sums over all units of one loss; parts differ in the number of components at most between losses."""
    information = np.zeros((along.shape[1], along.shape[1]))
    total = known = slope = spread = 0.0
    slopes = []
    for lines in parts:
        squares = np.square(residuals[lines]).sum(axis=1)
        weight = loss.weight(squares)
        size = lines.shape[1]
        rows = along[lines]
        information += np.einsum("u,ukr,uks->rs", weight, rows, rows)
        traces = size * weight + 2.0 * loss.slope(squares) * squares
        total += size * float(weight.sum())
        known += size * float(weight[stated[lines[:, 0]]].sum())
        slope += float(traces.sum())
        spread += float((weight * weight * squares).sum())
        slopes.append(np.repeat(traces / size, size))
    every = np.concatenate(slopes)
    mean = float(every.mean()) if every.size else 1.0
    safe = max(total, 1e-300)
    factor = float(curved(slope / safe))
    bend = float(every.var()) / mean**2 if every.size and factor > 0.0 else 0.0
    return _Pool(
        information=information,
        slope=factor,
        spread=spread / safe,
        count=every.size,
        bend=bend,
        total=total,
        stated=known,
    )


def _corrected(pool: _Pool, inverse: Floats) -> float:
    """The factor of A in G with Huber's correction for small samples, ``K² n/(n − p)``, ``K = 1 + p/n var ψ'/(E ψ')²``.

    p is the number of unknowns that this loss's units determine (Huber 1981, 7.6). Where these take up all that the
    units say, no residual tells the spread, and what the noise was stated to be counts: 1.
    """
    share = pool.slope * float(np.trace(inverse @ pool.information))
    freedom = pool.count - share
    if freedom <= EXHAUSTED * pool.count:
        return 1.0
    bend = 1.0 + share / pool.count * pool.bend
    least = float(least_spread(pool.slope, pool.total, pool.stated, share))
    return max(pool.spread * bend * bend * pool.count / freedom, least)


def _covariance(factor: Floats, undetermined: Mask) -> Covariance:
    matrix = factor @ factor.T
    matrix[undetermined, :] = np.nan
    matrix[:, undetermined] = np.nan
    return Covariance(matrix=matrix, sigma=np.sqrt(np.diag(matrix)), factor=factor)
