"""Rank decision and covariance of sparse problems, in the terms of the dense ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.types import (
    ConstraintState,
    Covariance,
    Floats,
    FreeCombination,
    Mask,
    Minimum,
    Observability,
    Propagated,
)
from mbm.estimation.uncertainty.freedom import free_combination, touched_by
from mbm.solver.decisions import SHARE
from mbm.sparse.inverse import Constrained, constrained_inverse, inverse_of
from mbm.sparse.rank import Decision, decided
from mbm.sparse.system import BlockJacobian, blocks_of

NAMED = 20
"""Free directions of single members that are put into words; the others are counted."""

HELD = 5000
"""Coordinates up to which the covariance matrix is made, if it is asked for: 200 MB."""

PART = 4_000_000
"""Numbers in the right sides that are solved for at once."""


@np.errstate(all="ignore")
def sparse_observability(
    minimum: Minimum, point: Floats, weights: Floats | None = None, *, affine: bool = False
) -> Observability:
    """The rank decision at a minimum of a sparse problem, with the coordinates ``point`` (n,).

    ``weights`` (m,) multiply the rows of its Jacobian (None: all 1). ``affine``: see `observability`.
    """
    blocks = blocks_of(minimum)
    fixed = minimum.at_bound != 0
    values = blocks.values if weights is None else weighted_rows(blocks, weights)
    return described(
        decided(blocks.plan, values, held_columns(blocks, fixed), affine=affine), point, fixed, minimum.constraints
    )


def held_columns(blocks: BlockJacobian, fixed: Mask) -> Mask:
    """The padded columns (columns,) of the coordinates that are ``fixed`` (n,)."""
    layout = blocks.plan.structure
    held = np.zeros(layout.columns, dtype=bool)
    held[layout.free] = fixed
    return held


def weighted_rows(blocks: BlockJacobian, weights: Floats) -> list[Floats]:
    """The Jacobian with the rows of the residuals that count multiplied by ``weights`` (m,); constraints stay."""
    layout = blocks.plan.structure
    whole = np.ones(layout.count)
    whole[slice(len(weights)) if layout.rows is None else layout.rows] = weights
    return [
        values * whole[piece.residuals].reshape(values.shape[:2])[:, :, None]
        for piece, values in zip(layout.pieces, blocks.values, strict=True)
    ]


def constrained(found: Decision, limits: ConstraintState | None) -> Constrained:
    """The covariance along the manifold of the constraints that hold the estimates."""
    if limits is None or not bool(limits.forcing.any()):
        return Constrained(inverse=found.inverse)
    return constrained_inverse(found.inverse, limits.slopes[limits.forcing], limits.equality[limits.forcing])


def described(found: Decision, point: Floats, fixed: Mask, limits: ConstraintState | None) -> Observability:
    """A rank decision at ``point`` (n,), of whose coordinates some are ``fixed`` (n,), on the manifold of constraints.

    Those that hold the estimates had rows in the equations that were decided upon.
    """
    held = constrained(found, limits)
    inverse = held.inverse
    layout = inverse.factors.plan.structure
    common = inverse.null[layout.free]
    unused = found.unused[layout.free]
    scale = inverse.scale[layout.free]
    touched = touched_by(common) | unused | inverse.single()
    dimension = len(point) - int(fixed.sum()) - held.inequalities
    return Observability(
        dimension=dimension,
        rank=dimension - int(unused.sum()) - common.shape[1] - len(inverse.local.members),
        equalities=held.equalities,
        condition=found.largest / found.smallest if found.smallest > 0.0 else 1.0,
        singular_values=np.array([found.largest, found.smallest]),
        scale=scale,
        row_space=np.zeros((len(point), 0)),
        null_space=common,
        combinations=_single(found, scale, point),
        unused=tuple(np.flatnonzero(unused).tolist()),
        estimable=~touched & ~fixed,
        fixed=fixed,
        inverse=inverse,
        complete=found.complete,
    )


def _single(found: Decision, scale: Floats, point: Floats) -> tuple[FreeCombination, ...]:
    """The first few free directions of single members."""
    local, layout = found.inverse.local, found.inverse.factors.plan.structure
    size = local.vectors.shape[1]
    result = []
    for member, vector in list(zip(local.members.tolist(), local.vectors, strict=True))[:NAMED]:
        direction = np.zeros(layout.columns)
        first = local.columns.start + member * size
        direction[first : first + size] = vector
        result.append(free_combination(direction[layout.free], scale, point))
    return tuple(result)


def sparse_covariance(observed: Observability, variance: float) -> Covariance:
    """Standard deviations of all coordinates; the matrix is left empty, as the factor is."""
    inverse = replace(inverse_of(observed.inverse), datum=observed.datum_space)
    undetermined = ~observed.estimable & ~observed.fixed
    variances = inverse.variances() * variance
    sigma = np.where(undetermined, np.nan, np.where(observed.fixed, 0.0, np.sqrt(variances)))
    factor = np.zeros((len(observed.scale), 0))
    return Covariance(matrix=np.zeros((0, 0)), sigma=sigma, factor=factor, variance=variance, inverse=inverse)


@np.errstate(all="ignore")
def whole_covariance(estimated: Covariance) -> Floats | None:
    """The covariance matrix (n, n), NaN for coordinates without a sigma; None where it would be too large."""
    count = len(estimated.sigma)
    if estimated.inverse is None:
        return estimated.matrix
    if count > HELD:
        return None
    matrix = inverse_of(estimated.inverse).solve(np.eye(count)) * estimated.variance
    matrix = (matrix + matrix.T) / 2.0
    undetermined = np.isnan(estimated.sigma)
    matrix[undetermined, :] = np.nan
    matrix[:, undetermined] = np.nan
    return matrix


@np.errstate(all="ignore")
def sparse_propagate(gradient: Floats, observed: Observability, estimated: Covariance) -> Propagated:
    """Covariance of k derived quantities with the gradient (k, n)."""
    inverse = inverse_of(estimated.inverse)
    count = len(gradient)
    image = np.empty((count, len(observed.scale)))
    along = np.empty(count)
    step = max(PART // max(image.shape[1], 1), 1)
    unused = np.flatnonzero(inverse.zero[inverse.factors.plan.structure.free] & ~observed.fixed)
    for start in range(0, count, step):
        part = gradient[start : start + step]
        image[start : start + step] = inverse.solve(part.T).T
        along[start : start + step] = inverse.along(part, observed.null_space)
    matrix = image @ gradient.T * estimated.variance
    matrix = (matrix + matrix.T) / 2.0
    estimable = (along <= SHARE) & ~(gradient[:, unused] != 0.0).any(axis=1)
    matrix[~estimable, :] = np.nan
    matrix[:, ~estimable] = np.nan
    return Propagated(matrix=matrix, sigma=np.sqrt(np.diag(matrix)), estimable=estimable)


@np.errstate(all="ignore")
def sparse_rows(gradient: Floats, minimum: Minimum, estimated: Covariance) -> Floats:
    """``G Σ Jᵀ`` (k, m) of k quantities with the gradient (k, n), Σ without its estimated variance."""
    blocks, count = blocks_of(minimum), len(minimum.residuals)
    layout = blocks.plan.structure
    chosen = slice(count) if layout.rows is None else layout.rows
    moved = layout.padded(inverse_of(estimated.inverse).solve(gradient.T))
    found = [blocks.plan.image(blocks.values, column)[chosen] for column in moved.T]
    return np.stack(found) if found else np.zeros((0, count))
