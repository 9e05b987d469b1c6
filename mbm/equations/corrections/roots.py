"""Whitening with the covariance ``S = B Bᵀ + Σ`` of the linearised conditions: its inverse root, never formed."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mbm.equations.corrections.steps import spread
from mbm.equations.types import Floats, Mask
from mbm.values import dataclass


class Root(Protocol):
    """Something that makes the equations of each component independent with variance 1."""

    def apply(self, values: Floats) -> Floats:
        """``values`` (R, k, n) whitened; NaN where S is singular."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Scalars:
    sigma: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(values / self.sigma[:, :, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    lower: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.lower, values))


@dataclass(frozen=True, slots=True, eq=False)
class _LowRank:
    """``(I + B Bᵀ)^(-1/2) = I + B V diag(((1 + s)^(-1/2) − 1)/s) Vᵀ Bᵀ`` with ``BᵀB = V diag(s) Vᵀ``."""

    slopes: Floats
    inner: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(values + self.slopes @ (self.inner @ (self.slopes.transpose(0, 2, 1) @ values)))


@np.errstate(all="ignore")
def root(slopes: Floats, noisy: Mask) -> Root:
    """The root for ``slopes`` (R, k, q) and equations with own noise where ``noisy`` (R, k)."""
    _, k, q = slopes.shape
    if k == 1:
        squares = np.einsum("rkq,rkq->rk", slopes, slopes) + noisy
        return _Scalars(np.where(squares > 0.0, np.sqrt(squares), np.nan))
    if k > q and bool(noisy.all()):
        squared, vectors = np.linalg.eigh(slopes.transpose(0, 2, 1) @ slopes)
        squared = np.maximum(squared, 0.0)
        grown = np.sqrt(1.0 + squared)
        factors = -1.0 / (grown * (1.0 + grown))  # ((1 + s)^(-1/2) − 1)/s without its cancellation
        return _LowRank(slopes, (vectors * factors[:, None, :]) @ vectors.transpose(0, 2, 1))
    covariance = spread(slopes, noisy)
    try:
        return _Triangles(np.asarray(np.linalg.cholesky(covariance), dtype=np.float64))
    except np.linalg.LinAlgError:
        lower = np.full(covariance.shape, np.nan)
        for i, matrix in enumerate(covariance):
            try:
                lower[i] = np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                continue
        return _Triangles(lower)
