"""Normal equations → factors: eliminate the family that decouples, then Cholesky of the rest, dense or by fronts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbm.solution.sparse.cholesky import FrontFactor, factorise
from mbm.solution.sparse.cholmod import CholmodFactor, Symbolic, symbolic
from mbm.solution.sparse.elimination import Elimination, eliminable, elimination, squared
from mbm.solution.sparse.fronts import Fronts, fronts
from mbm.solution.sparse.normal import Normal, NormalPattern, normal_pattern
from mbm.solution.sparse.structure import Structure
from mbm.solution.types import Floats, Indices

NARROW = 400
"""Reduced systems of at most so many columns are dense."""

WIDE = 6000
"""Reduced systems of more columns are never dense (300 MB)."""

FULL = 0.25
"""Reduced systems filled to this share are dense up to WIDE."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """How the normal equations of one pattern are solved; found once for a solve.

    The ``width`` columns that stay after the elimination (all without one) obey a matrix with entries at ``keys``
    (row · width + column, ascending, upper triangle); the blocks of the pairs that stay, flattened one after the other,
    go to ``places``. ``tree`` None: the matrix is dense; ``library``: CHOLMOD takes the place of the fronts.
    """

    pattern: NormalPattern
    elimination: Elimination | None
    kept: tuple[tuple[int, int], ...]
    columns: Indices
    width: int
    keys: Indices
    places: Indices
    diagonal: Indices
    tree: Fronts | None
    library: Symbolic | None

    @property
    def structure(self) -> Structure:
        """The structure of the Jacobian."""
        return self.pattern.structure


def plan(found: Structure) -> Plan:
    """Choose the elimination and the representation of what is left."""
    pattern = normal_pattern(found)
    family = eliminable(pattern)
    gone = None if family is None else elimination(pattern, family)
    place = np.arange(found.columns) if gone is None else gone.rest
    columns = np.flatnonzero(place >= 0)
    width = len(columns)
    kept = tuple(key for key in pattern.pairs if family is None or family not in key)
    rows_, columns_ = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for key in kept:
        pair = pattern.pairs[key]
        left, right = found.families[key[0]], found.families[key[1]]
        row = left.first + pair.i[:, None, None] * left.size + np.arange(left.size)[:, None]
        column = right.first + pair.j[:, None, None] * right.size + np.arange(right.size)
        shape = (len(pair.i), left.size, right.size)
        rows_.append(place[np.broadcast_to(row, shape).reshape(-1)])
        columns_.append(place[np.broadcast_to(column, shape).reshape(-1)])
    row, column = np.concatenate(rows_), np.concatenate(columns_)
    codes = np.minimum(row, column) * width + np.maximum(row, column)
    keys = np.unique(codes)
    dense = width <= NARROW
    if gone is not None and not dense:
        coupled = _coupled(gone)
        keys = np.unique(np.concatenate([keys, coupled]))
        dense = width <= WIDE and len(keys) > FULL * width * width / 2
    tree = None
    if not dense:
        sizes = [np.full(f.members, f.size) for n, f in enumerate(found.families) if n != family]
        tree = fronts(keys // width, keys % width, np.concatenate(sizes))
    return Plan(
        pattern=pattern,
        elimination=gone,
        kept=kept,
        columns=columns,
        width=width,
        keys=keys,
        places=np.searchsorted(keys, codes),
        diagonal=np.searchsorted(keys, np.arange(width) * (width + 1)),
        tree=tree,
        library=None if tree is None else symbolic(keys, width, tree),
    )


def _coupled(gone: Elimination) -> Indices:
    """The keys of ``YᵀY``, upper triangle."""
    from scipy.sparse import csr_array, triu

    ones = csr_array(
        (np.ones(len(gone.indices)), gone.indices, gone.pointers), shape=(len(gone.pointers) - 1, gone.width)
    )
    found = triu(ones.T @ ones).tocoo()
    return np.asarray(found.row.astype(np.int64) * gone.width + found.col)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factorised:
    """Factors of a matrix with the pattern of ``JᵀJ``; vectors are over the padded columns.

    ``roots`` (members, size, size) are the inverse lower triangles of the eliminated blocks, ``y`` their coupling;
    ``rest`` the factor of what is left: sparse, or the dense lower triangle.
    """

    plan: Plan
    roots: Floats | None
    y: Any
    rest: FrontFactor | CholmodFactor | Floats | None

    def solve(self, right: Floats) -> Floats:
        """The solution (columns, k) for a right side (columns, k)."""
        gone = self.plan.elimination
        x = np.empty_like(right)
        remaining = right[self.plan.columns]
        if gone is None or self.roots is None:
            x[self.plan.columns] = self._rest(remaining)
            return x
        own = self.plan.structure.families[gone.family].columns
        members, size = self.roots.shape[:2]
        count = right.shape[1]
        inner = np.matmul(self.roots, right[own].reshape(members, size, count)).reshape(-1, count)
        if self.plan.width:
            remaining = self._rest(remaining - self.y.T @ inner)
            x[self.plan.columns] = remaining
            inner = inner - self.y @ remaining
        x[own] = np.matmul(self.roots.transpose(0, 2, 1), inner.reshape(members, size, count)).reshape(-1, count)
        return x

    def _rest(self, right: Floats) -> Floats:
        from scipy.linalg.blas import dtrsm

        if isinstance(self.rest, FrontFactor | CholmodFactor):
            return self.rest.solve(right)
        if self.rest is None:
            return right
        half = dtrsm(1.0, self.rest.T, right, lower=0, trans_a=1)
        return np.asarray(dtrsm(1.0, self.rest.T, half, lower=0))

    def inverse(self) -> Mapping[tuple[int, int], Floats]:
        """The blocks of the inverse at the blocks of ``JᵀJ``, for each pair of families."""
        entries, whole = self._rest_inverse()
        found: dict[tuple[int, int], Floats] = {}
        taken = entries[self.plan.places]
        reached = 0
        for key in self.plan.kept:
            pair = self.plan.pattern.pairs[key]
            size = len(pair.i) * pair.shape[0] * pair.shape[1]
            found[key] = taken[reached : reached + size].reshape(len(pair.i), *pair.shape)
            reached += size
        if self.plan.elimination is not None and self.roots is not None:
            self._eliminated_inverse(self.plan.elimination, self.roots, whole, found)
        return found

    def _rest_inverse(self) -> tuple[Floats, Any]:
        """The inverse of what is left at the plan's keys, and as a matrix: dense, or sparse with these elements."""
        from scipy.sparse import coo_array, triu

        width, keys = self.plan.width, self.plan.keys
        if isinstance(self.rest, FrontFactor | CholmodFactor):
            entries = self.rest.inverse(len(keys))
            if self.plan.elimination is None:
                return entries, None
            upper = coo_array((entries, (keys // width, keys % width)), shape=(width, width)).tocsr()
            return entries, (upper + triu(upper, 1).T).tocsr()
        whole = self._rest(np.eye(width))
        return whole[keys // max(width, 1), keys % max(width, 1)], whole

    def _eliminated_inverse(
        self, gone: Elimination, roots: Floats, whole: Any, found: dict[tuple[int, int], Floats]
    ) -> None:
        size = roots.shape[1]
        inner = np.broadcast_to(np.eye(size), roots.shape).copy()
        images = gone.blocks(_at_pattern(self.y, whole))
        for cross, image, own in zip(gone.crosses, images, gone.blocks(self.y.data), strict=True):
            np.add.at(inner, cross.i, np.matmul(image, own.transpose(0, 2, 1)))
            block = -np.matmul(roots[cross.i].transpose(0, 2, 1), image)
            found[cross.pair] = block.transpose(0, 2, 1) if cross.flipped else block
        found[gone.family, gone.family] = np.matmul(np.matmul(roots.transpose(0, 2, 1), inner), roots)


def _at_pattern(y: Any, whole: Any) -> Floats:
    """The elements of ``Y Z`` where Y has some, in the order of its data."""
    from scipy.sparse import csr_array, issparse

    lines, width = y.shape
    result = np.empty(len(y.data))
    step = max(4_000_000 // max(width, 1), 1)
    for start in range(0, lines, step):
        part = y[start : start + step]
        where = slice(int(y.indptr[start]), int(y.indptr[min(start + step, lines)]))
        rows = np.repeat(np.arange(part.shape[0]), np.diff(part.indptr))
        image = part @ whole
        if issparse(image):
            image = csr_array(image).toarray()
        result[where] = image[rows, part.indices]
    return result


def factorised(found: Plan, normal: Normal, added: Floats) -> Factorised | None:
    """Factors of ``JᵀJ`` with ``added`` (columns,) on its diagonal; None where it is not positive definite."""
    gone = found.elimination
    flat = [normal.blocks[key].reshape(-1) for key in found.kept]
    data = np.zeros(len(found.keys))
    data[found.places] = np.concatenate(flat) if flat else np.zeros(0)
    data[found.diagonal] += added[found.columns]
    roots, y = None, None
    if gone is not None:
        family = found.structure.families[gone.family]
        diagonal = normal.blocks[gone.family, gone.family].copy()
        each = np.arange(family.size)
        diagonal[:, each, each] += added[family.columns].reshape(family.members, family.size)
        try:
            roots = np.linalg.inv(np.linalg.cholesky(diagonal))
        except np.linalg.LinAlgError:
            return None
        coupled = [np.matmul(roots[c.i], w) for c, w in zip(gone.crosses, gone.couplings(normal), strict=True)]
        y = gone.sparse(coupled)
    rest = _rest_factor(found, data, y)
    return None if rest is None else Factorised(plan=found, roots=roots, y=y, rest=rest)


def _rest_factor(found: Plan, data: Floats, y: Any) -> FrontFactor | CholmodFactor | Floats | None:
    width = found.width
    if found.tree is not None:
        if y is not None:
            from scipy.sparse import triu

            product = triu(y.T @ y).tocoo()
            data[np.searchsorted(found.keys, product.row.astype(np.int64) * width + product.col)] -= product.data
        return factorise(found.tree, data) if found.library is None else found.library.factorise(data)
    matrix = np.zeros((width, width))
    row, column = (found.keys // width, found.keys % width) if width else (found.keys, found.keys)
    matrix[column, row] = data
    if y is not None:
        matrix -= squared(y)
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
