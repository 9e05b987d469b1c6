"""Jacobian → rank decision: what is determined, and the covariance of it; in which combinations the rest is free.

Tall matrices → their triangle: all that least squares needs of them.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from mbm.equations.metric import metric, taken_away
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum, Observability, Propagated
from mbm.estimation.uncertainty.freedom import free_combinations
from mbm.solver.covariance import STILL
from mbm.solver.decisions import SHARE, decided_rank
from mbm.values import dataclass

BLOCK = 512
NARROW = 32
"""Matrices of at most so many columns are reduced in blocks of so many rows, which stay in the cache: three times
faster than all at once for a dozen columns, no gain beyond (measured)."""


def triangle(matrix: Floats) -> Floats:
    """``R`` (n, n) of the QR decomposition of a matrix (m, n), m >= n; its rows may differ in sign.

    Narrow ones by the reduction tree of Demmel, Grigori, Hoemmen and Langou (2012), as stable as Householder's.
    """
    rows, columns = matrix.shape
    blocks = rows // BLOCK
    if columns > NARROW or blocks < 2:
        return cast(Floats, np.linalg.qr(matrix, mode="r"))
    whole = matrix[: blocks * BLOCK].reshape(blocks, BLOCK, columns)
    tops = cast(Floats, np.linalg.qr(whole, mode="r"))
    return triangle(np.vstack([tops.reshape(-1, columns), matrix[blocks * BLOCK :]]))


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


FEW_NUMBERS = 1000
"""Numbers in a Jacobian up to which its singular values are found in half the time without its triangle (measured)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """Where the estimates may move: ``slopes`` (k, n) of the constraints that hold them, which of those are equations.

    Inequalities are there only where they hold with a force of their own: like a bound, they take a dimension away.
    """

    slopes: Floats
    equality: Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tangent:
    """Orthonormal directions (u, q) along the surface, and how many dimensions equations and inequalities take away."""

    basis: Floats
    equalities: int
    inequalities: int


def observability(
    jacobian: Floats, point: Floats, fixed: Mask, surface: Surface | None = None, *, affine: bool = False
) -> Observability:
    """The rank decision at ``point`` (n,) for a whitened Jacobian (m, n); coordinates in ``fixed`` (n,) do not move.

    ``affine``: it is the same everywhere, of products of data, and its singular values count down to their rounding.

    Column scaling makes the decision independent of the units of the unknowns. With a ``surface`` only movements along
    it count: what equations determine is determined, and each independent one adds to the rank.
    """
    n = point.size
    peaks = np.abs(jacobian).max(axis=0, initial=0.0)
    felt = peaks > 0.0
    safe = np.where(felt, peaks, 1.0)
    scale = np.where(felt, safe * np.sqrt(np.square(jacobian / safe).sum(axis=0)), 1.0)
    if surface is not None:
        scale = np.where(felt, scale, metric(jacobian, surface.slopes))
        felt = felt | (surface.slopes != 0.0).any(axis=0)
    moving = ~fixed
    used, unused = (felt & moving).nonzero()[0], (~felt & moving).nonzero()[0]
    tangent = None if surface is None else _tangent(surface, used, scale)
    reduced = jacobian[:, used] / scale[used]
    if tangent is not None:
        reduced = reduced @ tangent.basis
    width = reduced.shape[1]
    if reduced.shape[0] > 2 * width > 0 and reduced.size > FEW_NUMBERS:
        reduced = triangle(reduced)
    singular, right = np.zeros(0), np.zeros((0, width))
    if width and reduced.shape[0]:
        _, singular, right = np.linalg.svd(reduced, full_matrices=reduced.shape[0] < width)
    rank = decided_rank(len(singular), singular, int(affine))
    free = right[rank:].T if right.size else np.eye(width)
    determined, inner = right[:rank].T, free
    if tangent is not None:
        determined, inner = tangent.basis @ determined, tangent.basis @ inner
    row_space = np.zeros((n, rank))
    row_space[used] = determined
    null_space, estimable = np.zeros((n, unused.size + inner.shape[1])), moving
    if null_space.size:
        null_space[unused, np.arange(unused.size)] = 1.0
        null_space[used, unused.size :] = inner
        estimable = moving & ~(np.abs(null_space).max(axis=1) > SHARE)
    equalities, inequalities = (0, 0) if tangent is None else (tangent.equalities, tangent.inequalities)
    return Observability(
        dimension=n - int(fixed.sum()) - inequalities,
        rank=rank + equalities,
        equalities=equalities,
        condition=float(singular[0] / singular[rank - 1]) if rank else 1.0,
        singular_values=singular,
        scale=scale,
        row_space=row_space,
        null_space=null_space,
        combinations=free_combinations(null_space[:, unused.size :], scale, point),
        unused=tuple(unused.tolist()),
        estimable=estimable,
        fixed=fixed.copy(),
        limited_space=None if surface is None else _limited(surface, fixed, scale),
    )


def _limited(surface: Surface, fixed: Mask, scale: Floats) -> Floats | None:
    """An orthonormal basis (n, k) of the directions that bounds and inequalities take away and equations do not,
    scaled; None: those of coordinates at a bound alone.
    """
    slopes, tied = surface.slopes / scale, surface.equality
    if bool(tied.all()) and not (bool(fixed.any()) and bool((slopes[:, fixed] != 0.0).any())):
        return None
    slopes = np.vstack([slopes, np.eye(len(scale))[fixed]])
    tied = np.append(tied, np.zeros(int(fixed.sum()), dtype=bool))
    lengths = np.sqrt(np.square(slopes).sum(axis=1))
    slopes, tied = slopes[lengths > 0.0] / lengths[lengths > 0.0, None], tied[lengths > 0.0]
    directions, rank, _ = taken_away(slopes[tied], tied[tied], whole=False)
    along = directions[:rank]
    rows = slopes[~tied] - slopes[~tied] @ along.T @ along
    _, singular, right = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(right[: int((singular > STILL).sum())].T)


def observed_at(
    minimum: Minimum, point: Floats, weights: Floats | None = None, *, affine: bool = False
) -> Observability:
    """The rank decision at a minimum with the coordinates ``point`` (n,), on the surface of its constraints.

    ``weights`` (m,) multiply the rows of its Jacobian (None: all 1). ``affine``: see `observability`.
    """
    if minimum.blocks is not None:
        # Loaded by sparse problems only, so that the others start at once.
        from mbm.estimation.uncertainty.sparse import sparse_observability

        return sparse_observability(minimum, point, weights, affine=affine)
    surface, held = None, minimum.constraints
    if held is not None and bool(held.forcing.any()):
        surface = Surface(slopes=held.slopes[held.forcing], equality=held.equality[held.forcing])
    own = minimum.jacobian if weights is None else weights[:, None] * minimum.jacobian
    return observability(own, point, minimum.at_bound != 0, surface, affine=affine)


def _tangent(surface: Surface, used: Indices, scale: Floats) -> _Tangent:
    """The directions along the surface, in the scaled coordinates ``used``; dependent constraints count once."""
    directions, rank, equalities = taken_away(surface.slopes[:, used] / scale[used], surface.equality)
    return _Tangent(basis=directions[rank:].T, equalities=equalities, inequalities=rank - equalities)


def limited(observed: Observability) -> bool:
    """Whether a bound or an inequality holds some estimate."""
    return observed.limited_space is not None or bool(observed.fixed.any())


def pinned(observed: Observability, gradient: Floats) -> tuple[Mask, Mask]:
    """Which quantities with the gradient (k, n) change only as estimates leave the limits that hold them, and which
    not even then: of what limits hold and equations tie together.
    """
    if not limited(observed):
        return np.zeros(len(gradient), dtype=bool), np.zeros(len(gradient), dtype=bool)
    weighted = gradient / observed.scale
    steep = np.isinf(weighted)
    weighted = np.where(steep.any(axis=1, keepdims=True), np.sign(weighted) * steep, weighted)
    held, loose = np.where(observed.fixed, weighted, 0.0), np.where(observed.fixed, 0.0, weighted)
    if observed.limited_space is not None:
        held = weighted @ observed.limited_space
    if observed.inverse is None:
        loose = np.hstack([loose @ observed.row_space, loose @ observed.null_space])
    held_by, moved_by, whole = (np.square(each).sum(axis=1) for each in (held, loose, weighted))
    still = (whole > 0.0) & (moved_by <= STILL**2 * whole)
    return np.asarray(still & (held_by > STILL**2 * whole)), np.asarray(still & (held_by <= STILL**2 * whole))


def pinned_coordinates(observed: Observability) -> Mask:
    """Which of the coordinates (n,) change only so: those at a bound, and those that inequalities and equations hold
    with them.
    """
    if observed.limited_space is None:
        return observed.fixed
    return pinned(observed, np.eye(len(observed.fixed)))[0]
