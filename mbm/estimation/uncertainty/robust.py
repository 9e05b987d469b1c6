"""The covariance of estimates with robust losses: the sandwich ``H⁻¹ G H⁻¹`` (Huber 1967), small samples minded.

H is the derivative of the estimating equations ``Σ Jᵀψ = 0``, G the covariance of their left side. Within each loss the
two are pooled over its units (`mbm.solver.loss_spread`), so that they are as certain as the sample allows. What
has no loss enters both with ``JᵀJ``.

Residuals tell their spread as far as the weights leave more of them than unknowns. Where a loss that ends keeps no
more rows than it takes to fit them exactly, ψ vanishes and with it G, though the next measurements scatter as ever:
there the stated noise counts.

Beyond the corner of Huber's loss the cost is linear: where next to no residual is inside, ``Σ tr Dψ`` is rounding of
zero, and what only these rows determine can be moved at no cost. Such directions count as free (`flattened`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mbm.equations.losses import LossFunction
from mbm.equations.types import Covariance, Floats, Indices, Mask, Observability
from mbm.estimation.uncertainty.covariance import of_factor
from mbm.estimation.uncertainty.freedom import free_combinations, touched_by
from mbm.estimation.uncertainty.pools import information, pools
from mbm.solver.decisions import EPSILON, EXHAUSTED
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bread:
    """What the sandwich is made of, along r directions, the columns of ``basis`` (n, r): H⁻¹ is ``inverse`` (r, r).

    ``along`` (m, r) are the derivatives of the plain residuals, and ``spread`` (m,) their variances in G, so that
    ``G = Σ spread · aᵀa``. ``observed`` is the rank decision with what losses leave free as well.
    """

    observed: Observability
    basis: Floats
    inverse: Floats
    along: Floats
    spread: Floats


def bread(
    losses: Iterable[tuple[LossFunction, Indices]],
    residuals: Floats,
    jacobian: Floats,
    observed: Observability,
    stated: Mask,
    point: Floats,
) -> Bread:
    """The parts of the sandwich at the coordinates ``point`` (n,).

    ``losses`` come with the places (units, k) of the residuals they act on.
    ``residuals`` (m,) and ``jacobian`` (m, n) are plain, whitened with the noise that the estimates hold with, which is
    ``stated`` (m,) or was estimated;
    ``observed`` is the rank decision, in whose estimable subspace the covariance lives.
    """
    basis = observed.row_space / observed.scale[:, None]
    along = np.where(np.isfinite(jacobian), jacobian, 0.0) @ basis
    units = ((loss, np.zeros(len(lines), dtype=np.int64), lines) for loss, lines in losses)
    found = pools(units, residuals[None], along[None], stated[None].astype(np.float64))
    free = flat_directions(found.curvature[0], found.weighed[0], observed)
    if free is not None:
        observed, kept = flattened(observed, free, point)
        basis, along, found = basis @ kept, along @ kept, found.within(kept)
    inverse = np.asarray(np.linalg.pinv(found.curvature[0], hermitian=True), dtype=np.float64)
    return Bread(
        observed=observed, basis=basis, inverse=inverse, along=along, spread=found.row_spreads(inverse[None])[0]
    )


@np.errstate(all="ignore")
def sandwich(
    losses: Iterable[tuple[LossFunction, Indices]],
    residuals: Floats,
    jacobian: Floats,
    observed: Observability,
    stated: Mask,
    point: Floats,
) -> tuple[Covariance, Observability]:
    """The covariance of the n coordinates, and ``observed`` with what losses leave free as well; as for `bread`."""
    found = bread(losses, residuals, jacobian, observed, stated, point)
    spread = information(found.spread[None], found.along[None])[0]
    lengths, axes = np.linalg.eigh(spread)
    factor = found.basis @ found.inverse @ (axes * np.sqrt(np.maximum(lengths, 0.0)))
    return of_factor(factor, found.observed), found.observed


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
