"""Rank decision → covariance of the estimates on the estimable subspace, and of quantities derived from them.

``Σ = (JᵀJ)⁺`` of the whitened Jacobian, from its singular value decomposition; JᵀJ is never formed, nor inverted.
"""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Covariance, Floats, Observability, Propagated
from mbm.solver.decisions import SHARE


@np.errstate(all="ignore")
def covariance(observed: Observability, variance: float = 1.0) -> Covariance:
    """Covariance of the n coordinates, times ``variance`` (the estimated s² of `:sigma unknown`, else 1).

    Coordinates held at a bound count as known: variance 0, and the others as if they were constants (the covariance on
    the active constraint surface); so do movements away from constraints that hold. Coordinates that a free combination
    touches have no variance: NaN. All others keep theirs, whatever else is free.
    """
    if observed.inverse is not None:
        # Here and below: loaded by sparse problems only, so that the others start at once.
        from mbm.estimation.uncertainty.sparse import sparse_covariance

        return sparse_covariance(observed, variance)
    rank = observed.row_space.shape[1]
    factor = observed.row_space / observed.singular_values[:rank] / observed.scale[:, None] * np.sqrt(variance)
    return of_factor(factor, observed, variance)


def of_factor(factor: Floats, observed: Observability, variance: float = 1.0) -> Covariance:
    """The covariance with the ``factor`` (n, k) before a datum is chosen; NaN for what is not determined.

    ``variance`` is that of the residuals, which the ``factor`` holds.
    """
    factor = in_datum(factor, observed)
    matrix = factor @ factor.T
    undetermined = ~observed.estimable & ~observed.fixed
    matrix[undetermined, :] = np.nan
    matrix[:, undetermined] = np.nan
    return Covariance(matrix=matrix, sigma=np.sqrt(np.diag(matrix)), factor=factor, variance=variance)


def in_datum(vectors: Floats, observed: Observability) -> Floats:
    """Vectors (n, k) without their part along the free motions: the minimum-norm datum, where one was asked for."""
    space = observed.datum_space
    return vectors if space is None else vectors - space @ (space.T @ vectors)


@np.errstate(all="ignore")
def propagate(gradient: Floats, observed: Observability, estimated: Covariance) -> Propagated:
    """Covariance of k derived quantities with the gradient (k, n): ``G Σ Gᵀ``.

    A quantity that the free combinations leave unchanged to first order has a sigma, even where the coordinates that it
    is made of have none; any other has NaN.
    """
    if observed.inverse is not None:
        from mbm.estimation.uncertainty.sparse import sparse_propagate

        return sparse_propagate(gradient, observed, estimated)
    image = gradient @ estimated.factor
    matrix = image @ image.T
    weighted = gradient / observed.scale
    length = np.sqrt(np.square(weighted).sum(axis=1))
    along = np.sqrt(np.square(weighted @ observed.null_space).sum(axis=1))
    estimable = along <= SHARE * length
    matrix[~estimable, :] = np.nan
    matrix[:, ~estimable] = np.nan
    return Propagated(matrix=matrix, sigma=np.sqrt(np.diag(matrix)), estimable=estimable)
