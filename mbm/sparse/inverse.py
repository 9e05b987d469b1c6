"""The covariance of very many estimates without ever having it: its diagonal, and its products with a few vectors.

In column-scaled coordinates it is the pseudo-inverse of ``JᵀJ``: the factor of that matrix with pins that hold what is
free, between two projections along the free directions (Baarda's S-transformation). With a ``datum`` it is projected
once more, to the least norm in the coordinates themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.metric import taken_away
from mbm.equations.types import CovarianceFactor, Floats, Indices, Mask
from mbm.solver.decisions import SHARE
from mbm.sparse.structure import Values
from mbm.sparse.system import Factorised
from mbm.values import dataclass

CANCELLED = 1e-13
"""Share of a variance that may be left by rounding where constraints determine the coordinate."""

PART = 2_000_000
"""Numbers in the parts of the inverse that are put together for the rows of a piece at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalNull:
    """Free directions of single members of one family: of member ``members[t]`` along ``vectors[t]`` (unit length)."""

    columns: slice
    members: Indices
    vectors: Floats

    def removed(self, x: Floats) -> Floats:
        """``x`` (columns, k) without its part along these directions."""
        if not len(self.members):
            return x
        size = self.vectors.shape[1]
        parts = x[self.columns].reshape(-1, size, x.shape[1])
        along = np.einsum("ts,tsk->tk", self.vectors, parts[self.members])
        result = x.copy()
        view = result[self.columns].reshape(parts.shape)
        np.subtract.at(view, self.members, self.vectors[:, :, None] * along[:, None, :])
        return result

    def squares(self, count: int) -> Floats:
        """The diagonal of the projection onto these directions, for ``count`` columns."""
        result = np.zeros(count)
        if len(self.members):
            np.add.at(result[self.columns].reshape(-1, self.vectors.shape[1]), self.members, np.square(self.vectors))
        return result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SparseInverse:
    """``factors`` of the pinned, scaled matrix; ``scale`` (columns,); ``null`` (columns, g) orthonormal, free.

    Columns that are ``zero`` (columns,) in the Jacobian, or held, have no covariance. ``datum`` (n, g) is orthonormal.
    ``taken`` (n, k): the covariance without constraints, less ``taken @ takenᵀ``, is that with them.

    Coordinates of the public functions are the n estimated ones.
    """

    factors: Factorised
    scale: Floats
    null: Floats
    local: LocalNull
    zero: Mask
    datum: Floats | None = None
    taken: Floats | None = None

    def solve(self, right: Floats) -> Floats:
        """The covariance times a right side (n, k)."""
        if self.datum is None:
            return self._solved(right)
        found = self._solved(right - self.datum @ (self.datum.T @ right))
        return np.asarray(found - self.datum @ (self.datum.T @ found))

    def _solved(self, right: Floats) -> Floats:
        layout = self.factors.plan.structure
        scaled = self._projected(layout.padded(right) / self.scale[:, None])
        found = np.asarray((self._projected(self.factors.solve(scaled)) / self.scale[:, None])[layout.free])
        return found if self.taken is None else found - self.taken @ (self.taken.T @ right)

    def along(self, gradient: Floats, common: Floats) -> Floats:
        """How much of each row of a gradient (k, n) lies along free directions, relative to its length (k,).

        Those of single members, and ``common`` (n, g), which may be fewer than all in scaled coordinates.
        """
        layout = self.factors.plan.structure
        rows = layout.padded(gradient.T) / self.scale[:, None]
        length = np.square(rows).sum(axis=0)
        squares = np.square(rows - self.local.removed(rows)).sum(axis=0)
        squares += np.square(common.T @ rows[layout.free]).sum(axis=0)
        shares: Floats = np.divide(squares, length, out=np.zeros_like(squares), where=length > 0.0)
        return np.sqrt(shares)

    def single(self) -> Mask:
        """Coordinates (n,) that free directions of single members touch."""
        layout = self.factors.plan.structure
        return np.asarray(self.local.squares(layout.columns)[layout.free] > SHARE**2)

    def variances(self) -> Floats:
        """The diagonal of the covariance (n,)."""
        layout = self.factors.plan.structure
        blocks = self.factors.inverse(across=False)
        found = np.zeros(layout.columns)
        for number, (family, where) in enumerate(zip(layout.families, self.factors.plan.pattern.diagonal, strict=True)):
            found[family.columns] = np.einsum("bii->bi", blocks[number, number][where]).reshape(-1)
        found -= self.local.squares(layout.columns)
        if self.null.shape[1]:
            across = self.factors.solve(self.null)
            inner = self.null.T @ across
            found += np.einsum("ck,ck->c", self.null, self.null @ inner - 2.0 * across)
        found[self.zero] = 0.0
        result: Floats = (np.maximum(found, 0.0) / np.square(self.scale))[layout.free]
        if self.taken is not None:
            left = result - np.square(self.taken).sum(axis=1)
            result = np.where(left > CANCELLED * result, left, 0.0)
        if self.datum is not None:
            image = self._solved(self.datum)
            inner = self.datum.T @ image
            result = result + np.einsum("ck,ck->c", self.datum, self.datum @ inner - 2.0 * image)
        return np.maximum(result, 0.0)

    def leverages(self, values: Values, fixed: Mask) -> Floats:
        """The diagonal of ``J Σ Jᵀ`` (m,): how much each residual determines its own fitted value.

        Coordinates in ``fixed`` (n,) are known.
        """
        layout = self.factors.plan.structure
        result = np.zeros(layout.count)
        blocks = self.factors.inverse()
        still = layout.dead
        still[layout.free[fixed]] = True
        scaled = layout.weighted(values, np.where(still, 0.0, 1.0 / self.scale))
        for number, piece in enumerate(layout.pieces):
            places = self._block_places(number)
            step = max(PART // max(piece.width * piece.width, 1), 1)
            parts = []
            for start in range(0, piece.rows, step):
                rows = slice(start, min(start + step, piece.rows))
                image = np.zeros_like(scaled[number][rows])
                for (a, b), (key, where, turned) in places.items():
                    left = slice(piece.starts[a], piece.starts[a] + layout.families[piece.families[a]].size)
                    right = slice(piece.starts[b], piece.starts[b] + layout.families[piece.families[b]].size)
                    found = blocks[key][where[rows]]
                    found = (
                        np.where(turned[rows, None, None], found.transpose(0, 2, 1), found)
                        if (key[0] == key[1])
                        else (found.transpose(0, 2, 1) if turned.any() else found)
                    )
                    image[:, :, right] += np.matmul(scaled[number][rows][:, :, left], found)
                parts.append((image * scaled[number][rows]).sum(axis=2).reshape(-1))
            result[piece.residuals] = np.concatenate(parts) if parts else 0.0
        for column in () if self.taken is None else layout.padded(self.taken).T:
            result -= np.square(self.factors.plan.image(values, column))
        return result if layout.rows is None else result[layout.rows]

    def _block_places(self, number: int) -> Mapping[tuple[int, int], tuple[tuple[int, int], Indices, Indices]]:
        """For each pair of local blocks of a piece: the pair of families, the block of each row, whether transposed."""
        pattern = self.factors.plan.pattern
        piece = pattern.structure.pieces[number]
        found = {}
        for a, left in enumerate(piece.families):
            for b, right in enumerate(piece.families):
                swap = left > right
                key = (right, left) if swap else (left, right)
                i, j = (piece.members[b], piece.members[a]) if swap else (piece.members[a], piece.members[b])
                turned = np.full(piece.rows, swap)
                if left == right:
                    turned = i > j
                    i, j = np.minimum(i, j), np.maximum(i, j)
                found[a, b] = (key, pattern.pairs[key].places(i, j), turned)
        return found

    def _projected(self, x: Floats) -> Floats:
        x = np.where(self.zero[:, None], 0.0, x)
        if self.null.shape[1]:
            x = x - self.null @ (self.null.T @ x)
        return self.local.removed(x)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Constrained:
    """The covariance with constraints that hold, and how many dimensions their equations and inequalities take away."""

    inverse: SparseInverse
    equalities: int = 0
    inequalities: int = 0


def constrained_inverse(inverse: SparseInverse, slopes: Floats, equality: Mask) -> Constrained:
    """The covariance along the manifold of constraints with the ``slopes`` (k, n), some of which are equations.

    Without them it is A⁻¹, where A has rows for the constraints too, with any weight: with B an orthonormal basis of
    their slopes it is ``A⁻¹ − A⁻¹Bᵀ (B A⁻¹ Bᵀ)⁻¹ B A⁻¹``. Dependent constraints count once.
    """
    free = inverse.factors.plan.structure.free
    rows = np.where(inverse.zero[free], 0.0, slopes) / inverse.scale[free]
    directions, rank, equalities = taken_away(rows, equality, whole=False)
    if not rank:
        return Constrained(inverse=inverse)
    basis = (directions[:rank] * inverse.scale[free]).T
    image = inverse.solve(basis)
    factor = np.linalg.cholesky(basis.T @ image)
    taken = np.linalg.solve(factor, image.T).T
    return Constrained(inverse=replace(inverse, taken=taken), equalities=equalities, inequalities=rank - equalities)


def inverse_of(factor: CovarianceFactor | None) -> SparseInverse:
    """The covariance factor of a sparse problem.

    Raises:
        TypeError: the problem is not sparse.

    """
    if not isinstance(factor, SparseInverse):
        message = "the problem is not sparse"
        raise TypeError(message)
    return factor
