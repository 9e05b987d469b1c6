"""The work on blocks with NumPy and SciPy: what works everywhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.sparse.arithmetic import Places
from mbm.sparse.elimination import Elimination
from mbm.sparse.normal import Contribution, Normal, NormalPattern
from mbm.sparse.structure import Structure, Values
from mbm.values import dataclass

SHARED = 24
"""Rows per block from which one product of tall matrices is cheaper than many small ones that are added up."""

CHUNK = 4_000_000
"""Numbers in a dense part of ``Y`` that is worked on at once."""

TOGETHER = 16384
"""Rows whose derivatives are computed together."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Interpreted:
    """``pointers``, ``indices``: the CSR pattern of ``Y`` (family's columns × width), whose data its panels are.

    ``element`` has the place in ``Y`` of each number of the crosses' blocks, one array for each cross.
    """

    gone: Elimination | None
    pointers: NDArray[np.int32]
    indices: NDArray[np.int32]
    element: tuple[Indices, ...]

    def put_jacobian(
        self, group: Group, numbers: Floats, weights: Floats, places: Places, values: Floats, target: Floats
    ) -> None:
        """By columns, some rows at a time."""
        chosen, targets, lines = places
        for rows, part in _parts(group):
            part.fill(numbers)
            values[rows], nonzeros = part.evaluation.values_and_jacobian()
            found = target[rows]
            found.reshape(len(found), -1)[:, targets] = nonzeros[:, chosen] * weights[rows][:, lines]

    def products(self, pattern: NormalPattern, values: Values) -> Mapping[tuple[int, int], Floats]:
        """The blocks of ``JᵀJ``."""
        blocks: dict[tuple[int, int], Floats] = {}
        for key, pair in pattern.pairs.items():
            total = np.zeros((len(pair.i), *pair.shape))
            for part in pair.contributions:
                total[part.targets] += _summed(values[part.piece], part)
            blocks[key] = total
        return blocks

    def gradient(self, layout: Structure, values: Values, residuals: Floats) -> Floats:
        """``Jᵀ r``."""
        return np.asarray(layout.matrix(values).T @ residuals).reshape(-1)

    def squares(self, layout: Structure, values: Values) -> Floats:
        """Sums by column; where a row has the same member twice, its columns are added before they are squared."""
        places, sums = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for piece, part in zip(layout.pieces, values, strict=True):
            for a, first in enumerate(piece.starts):
                family = layout.families[piece.families[a]]
                columns = family.first + piece.members[a][:, None] * family.size + np.arange(family.size)
                for b, second in enumerate(piece.starts[: a + 1]):
                    if piece.families[b] != piece.families[a]:
                        continue
                    sides = part[:, :, first : first + family.size], part[:, :, second : second + family.size]
                    terms = np.einsum("roc,roc->rc", *sides)
                    if a != b:
                        terms = np.where((piece.members[a] == piece.members[b])[:, None], 2.0 * terms, 0.0)
                    places.append(columns.reshape(-1))
                    sums.append(terms.reshape(-1))
        found = np.bincount(np.concatenate(places), np.concatenate(sums), minlength=layout.columns)
        return np.asarray(found, dtype=np.float64)

    def image(self, layout: Structure, values: Values, step: Floats) -> Floats:
        """``J step``."""
        return np.asarray(layout.matrix(values) @ step)

    def roots(self, blocks: Floats, added: Floats) -> Floats | None:
        """Inverse lower triangles."""
        whole = blocks.copy()
        each = np.arange(blocks.shape[1])
        whole[:, each, each] += added
        try:
            return np.asarray(np.linalg.inv(np.linalg.cholesky(whole)))
        except np.linalg.LinAlgError:
            return None

    def couplings(self, normal: Normal, roots: Floats) -> Floats:
        """``Y`` by batches of small products."""
        gone = self._elimination()
        y = np.empty(gone.numbers)
        for cross, element, w in zip(gone.crosses, self.element, gone.couplings(normal), strict=True):
            y[element] = np.matmul(roots[cross.i], w)
        return y

    def reduce(self, y: Floats, matrix: Floats) -> None:
        """A part of the rows of ``Y`` at a time, dense."""
        whole = self._matrix(y)
        lines, width = whole.shape
        step = max(CHUNK // max(width, 1), 1)
        for start in range(0, lines, step):
            part = whole[start : start + step].toarray()
            matrix -= part.T @ part

    def reduce_entries(self, y: Floats, keys: Indices, entries: Floats) -> None:
        """A sparse product."""
        from scipy.sparse import triu

        whole = self._matrix(y)
        product = triu(whole.T @ whole).tocoo()
        places = np.searchsorted(keys, product.row.astype(np.int64) * whole.shape[1] + product.col)
        entries[places] -= product.data

    def solved(self, lower: Floats, right: Floats) -> Floats:
        """By BLAS."""
        return triangular(lower, right)

    def rooted(self, roots: Floats, right: Floats, *, transposed: bool) -> Floats:
        """A batch of small products."""
        parts = right.reshape(*roots.shape[:2], right.shape[1])
        found = np.matmul(roots.transpose(0, 2, 1) if transposed else roots, parts)
        return np.asarray(found.reshape(right.shape))

    def carried(self, y: Floats, inner: Floats) -> Floats:
        """``Yᵀ inner``."""
        return np.asarray(self._matrix(y).T @ inner)

    def returned(self, y: Floats, rest: Floats) -> Floats:
        """``Y rest``."""
        return np.asarray(self._matrix(y) @ rest)

    def inverse_diagonal(self, y: Floats, roots: Floats, rest: Any) -> Floats:
        """As below."""
        return self.inverse_blocks(y, roots, rest)[1]

    def inverse_blocks(self, y: Floats, roots: Floats, rest: Any) -> tuple[Floats, Floats]:
        """Images of the rows of ``Y`` a part at a time, then batches of small products."""
        gone = self._elimination()
        images = self._images(y, rest)
        across = np.empty_like(y)
        inner = np.broadcast_to(np.eye(gone.size), roots.shape).copy()
        for cross, element in zip(gone.crosses, self.element, strict=True):
            image = images[element]
            np.add.at(inner, cross.i, np.matmul(image, y[element].transpose(0, 2, 1)))
            across[element] = -np.matmul(roots[cross.i].transpose(0, 2, 1), image)
        return across, np.matmul(np.matmul(roots.transpose(0, 2, 1), inner), roots)

    def _images(self, y: Floats, rest: Any) -> Floats:
        """The elements of ``Y Z`` where Y has some."""
        from scipy.sparse import csr_array, issparse

        whole = self._matrix(y)
        lines, width = whole.shape
        result = np.empty(len(y))
        step = max(CHUNK // max(width, 1), 1)
        for start in range(0, lines, step):
            part = whole[start : start + step]
            where = slice(int(self.pointers[start]), int(self.pointers[min(start + step, lines)]))
            rows = np.repeat(np.arange(part.shape[0]), np.diff(part.indptr))
            image = part @ rest
            if issparse(image):
                image = csr_array(image).toarray()
            result[where] = image[rows, part.indices]
        return result

    def _elimination(self) -> Elimination:
        if self.gone is None:
            message = "nothing is eliminated"
            raise TypeError(message)
        return self.gone

    def _matrix(self, y: Floats) -> Any:
        from scipy.sparse import csr_array

        return csr_array((y, self.indices, self.pointers), shape=(len(self.pointers) - 1, self._elimination().width))


def interpreted(gone: Elimination | None) -> Interpreted:
    """The work for an elimination, or for none."""
    if gone is None:
        none = np.zeros(0, dtype=np.int32)
        return Interpreted(gone=None, pointers=none, indices=none, element=())
    links = gone.links
    pointers = np.concatenate([[0], np.cumsum(np.repeat(links.lengths, gone.size))])
    indices = np.empty(gone.numbers, dtype=np.int32)
    element = []
    for cross in gone.crosses:
        wide = np.arange(cross.shape[1])
        rows = np.arange(gone.size)[:, None] * links.lengths[cross.i][:, None, None]
        element.append(cross.places[:, None, None] + rows + wide)
    along = np.repeat(links.columns - np.concatenate([[0], np.cumsum(links.wides)[:-1]]), links.wides)
    columns = along + np.arange(len(along))
    for row in range(gone.size):
        lines = _stretched(pointers[row : -1 : gone.size], links.lengths)
        indices[lines] = columns
    return Interpreted(gone=gone, pointers=pointers.astype(np.int32), indices=indices, element=tuple(element))


def triangular(lower: Floats, right: Floats) -> Floats:
    """``(L Lᵀ)⁻¹ right`` for a lower triangle (n, n) and right sides (n, k)."""
    from scipy.linalg.blas import dtrsm

    half = dtrsm(1.0, lower.T, right, lower=0, trans_a=1)
    return np.asarray(dtrsm(1.0, lower.T, half, lower=0))


def _stretched(firsts: Indices, lengths: Indices) -> Indices:
    """``first … first + length`` for each of them, one after the other."""
    before = np.cumsum(lengths) - lengths
    return np.asarray(np.arange(int(lengths.sum())) + np.repeat(firsts - before, lengths))


def _parts(group: Group) -> Iterator[tuple[slice, Group]]:
    """The rows a part at a time, so that what the kernel gives is not held for all of them."""
    if group.rows <= TOGETHER or group.sampled:
        yield slice(0, group.rows), group
        return
    for first in range(0, group.rows, TOGETHER):
        rows = slice(first, min(first + TOGETHER, group.rows))
        made = group.cache.evaluation(group.number, group.kernel, rows.stop - first)
        yield rows, replace(group, evaluation=made, index=group.index[rows], parameters=group.parameters[rows])


def _summed(values: Floats, part: Contribution) -> Floats:
    """The contribution to each target (targets, left size, right size)."""
    left = values[part.rows, :, part.left]
    right = left if part.left == part.right else values[part.rows, :, part.right]
    counts = np.diff(part.starts)
    if len(part.rows) > SHARED * len(counts):
        runs = zip(part.starts[:-1].tolist(), part.starts[1:].tolist(), strict=True)
        a, b = left.shape[2], right.shape[2]
        products = np.array([left[s:e].reshape(-1, a).T @ right[s:e].reshape(-1, b) for s, e in runs])
    else:
        products = np.matmul(left.transpose(0, 2, 1), right)
        if len(counts) < len(part.rows):
            products = np.add.reduceat(products, part.starts[:-1], axis=0)
    return products + products.transpose(0, 2, 1) if part.mirrored else products
