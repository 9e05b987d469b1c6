"""The covariance of estimates with robust losses: the sandwich ``H⁻¹ G H⁻¹`` (Huber 1967), small samples corrected."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mbm.equations.losses import LossFunction
from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Covariance, Floats, Indices, Mask, Observability
from mbm.estimation.uncertainty.freedom import free_combinations, touched_by
from mbm.estimation.uncertainty.observability import of_factor
from mbm.solver import loss_spread as formulas
from mbm.solver.decisions import EPSILON, EXHAUSTED
from mbm.values import dataclass

Units = tuple[LossFunction, Indices, Indices]
"""A loss, the solves (U,) of units that it acts on, and the places (U, k) of their residuals."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sums:
    """One loss in K solves, over all its units: (K,), named as in `mbm.solver.loss_spread`."""

    total: Floats
    traces: Floats
    squared_traces: Floats
    spread: Floats
    count: Floats
    stated: Floats

    @property
    def curvature(self) -> Floats:
        """The factors (K,) of A in H."""
        return of_arrays(formulas.curvature_factor)(self.traces, self.total)

    def corrected(self, share: Floats) -> Floats:
        """The factors (K,) of A in G, where the units determine ``share`` (K,) unknowns."""
        return of_arrays(formulas.spread_factor)(
            share, self.total, self.traces, self.squared_traces, self.spread, self.count, self.stated
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pools:
    """All losses in K solves, of rows along r directions; ``fixed`` (K, r, r) is the information without a loss.

    ``weights`` (K, m) are those of the rows without a loss, then those of the rows of each loss; 0 for all others.
    """

    fixed: Floats
    weights: tuple[Floats, ...]
    losses: tuple[tuple[Sums, Floats], ...]
    """The sums of each loss, and the information A (K, r, r) that its weights leave."""

    @property
    def weighed(self) -> Floats:
        """The information (K, r, r) that the weights leave."""
        return self.fixed + sum(information for _, information in self.losses)

    @property
    def curvature(self) -> Floats:
        """H (K, r, r)."""
        return self.fixed + sum(sums.curvature[:, None, None] * information for sums, information in self.losses)

    def spread(self, inverse: Floats) -> Floats:
        """G (K, r, r), where ``inverse`` (K, r, r) is that of H."""
        factors = self._corrected(inverse)
        parts = zip(factors, self.losses, strict=True)
        return self.fixed + sum(factor[:, None, None] * information for factor, (_, information) in parts)

    def row_spreads(self, inverse: Floats) -> Floats:
        """The variances (K, m) of the rows in G, which is ``Σ v aᵀa``."""
        parts = zip(self._corrected(inverse), self.weights[1:], strict=True)
        return self.weights[0] + sum(factor[:, None] * weights for factor, weights in parts)

    def _corrected(self, inverse: Floats) -> list[Floats]:
        """The factor (K,) of A in G of each loss."""
        shares = (s.curvature * np.einsum("kij,kji->k", inverse, information) for s, information in self.losses)
        return [sums.corrected(share) for (sums, _), share in zip(self.losses, shares, strict=True)]

    def within(self, kept: Floats) -> Pools:
        """The same along some of the directions (r, s) alone."""
        within = tuple((sums, kept.T @ information @ kept) for sums, information in self.losses)
        return replace(self, fixed=kept.T @ self.fixed @ kept, losses=within)


def pools(units: Iterable[Units], residuals: Floats, along: Floats, stated: Floats) -> Pools:
    """Of plain whitened ``residuals`` (K, m) with their derivatives ``along`` r directions (K, m, r).

    ``stated`` (K, m) is 1 where the noise is stated, else 0; parts of a loss differ in the components of units at most.
    """
    plain = np.ones(residuals.shape)
    by_loss: dict[LossFunction, list[Units]] = {}
    for each in units:
        plain[each[1][:, None], each[2]] = 0.0
        by_loss.setdefault(each[0], []).append(each)
    found = [summed(parts, residuals, stated) for parts in by_loss.values()]
    return Pools(
        fixed=information(plain, along),
        weights=(plain, *(weights for weights, _ in found)),
        losses=tuple((sums, information(weights, along)) for weights, sums in found),
    )


def information(weights: Floats, along: Floats) -> Floats:
    """``Σ w aᵀa`` (K, r, r) of weights (K, m) and rows (K, m, r)."""
    return np.asarray(np.matmul((along * weights[:, :, None]).transpose(0, 2, 1), along))


def summed(parts: Iterable[Units], residuals: Floats, stated: Floats) -> tuple[Floats, Sums]:
    """The weights (K, m) of one loss, 0 where it does not act, and its sums solve by solve."""
    solves = len(residuals)
    weights = np.zeros(residuals.shape)
    sums = np.zeros((6, solves))
    for loss, solve, slots in parts:
        size = slots.shape[1]
        squares = np.square(residuals[solve[:, None], slots]).sum(axis=1)
        weight, traces = loss.weight(squares), loss.trace(squares, size)
        weights[solve[:, None], slots] = weight[:, None]
        known = weight * stated[solve, slots[:, 0]]
        of_units = (size * weight, traces, traces * traces / size, weight * weight * squares)
        for total, each in zip(sums, (*of_units, np.full(len(solve), float(size)), size * known), strict=True):
            total += np.bincount(solve, weights=each, minlength=solves)
    return weights, Sums(
        total=sums[0], traces=sums[1], squared_traces=sums[2], spread=sums[3], count=sums[4], stated=sums[5]
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bread:
    """What the sandwich is made of, along r directions, the columns of ``basis`` (n, r): H⁻¹ is ``inverse`` (r, r).

    In the directions JᵀJ is the identity, but for what weights leave: the condition is then that of the weights.

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
    strengths = observed.singular_values[: observed.row_space.shape[1]]
    basis = observed.row_space / strengths / observed.scale[:, None]
    along = np.where(np.isfinite(jacobian), jacobian, 0.0) @ basis
    units = ((loss, np.zeros(len(lines), dtype=np.int64), lines) for loss, lines in losses)
    found = pools(units, residuals[None], along[None], stated[None].astype(np.float64))
    free = flat_directions(found.curvature[0], found.weighed[0])
    if free is not None:
        kept = np.linalg.qr(free, mode="complete")[0][:, free.shape[1] :]
        basis, along, found = basis @ kept, along @ kept, found.within(kept)
        observed = flattened(observed, free / strengths[:, None], point)
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


def flat_directions(curvature: Floats, weighed: Floats) -> Floats | None:
    """Directions (r, k) along which ``curvature`` (r, r) is next to nothing of what is ``weighed`` (r, r); None: none.

    Both are well conditioned, as the derivatives of the square-root form are never larger than the weights:
    ``w² s/ρ ≤ w``. Directions that nothing weighs (a loss that ends may leave every row without weight) are among those
    found.
    """
    if not (np.isfinite(curvature).all() and np.isfinite(weighed).all()):
        return None
    weights, turned = np.linalg.eigh(weighed)
    felt = weights > EPSILON * np.max(weights, initial=0.0)
    root = turned[:, felt] / np.sqrt(weights[felt])
    shares, axes = np.linalg.eigh(root.T @ curvature @ root)
    flat = ~(shares > EXHAUSTED)
    if felt.all() and not flat.any():
        return None
    return np.hstack([root @ axes[:, flat], turned[:, ~felt]])


def flattened(observed: Observability, free: Floats, point: Floats) -> Observability:
    """The rank decision without the directions ``free`` (r, k) of its row space."""
    count = free.shape[1]
    turned = np.linalg.qr(free / np.sqrt(np.square(free).sum(axis=0)), mode="complete")[0]
    lost, kept = observed.row_space @ turned[:, :count], turned[:, count:]
    return replace(
        observed,
        row_space=observed.row_space @ kept,
        null_space=np.hstack([observed.null_space, lost]),
        combinations=(*observed.combinations, *free_combinations(lost, observed.scale, point)),
        estimable=observed.estimable & ~touched_by(lost),
        flat=count,
    )
