"""Normal equations → factors: eliminate the family that decouples, then Cholesky of the rest, dense or by fronts.

A matrix that is made when it is first looked at: what solves and reports seldom ask for costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.equations.types import Floats, Indices, Minimum
from mbm.sparse.arithmetic import Arithmetic, arithmetic
from mbm.sparse.frontal import FrontFactor, FrontSolver, front_solver, fronts, minimum_degree
from mbm.sparse.normal import Elimination, Normal, NormalPattern, eliminable, elimination, normal_pattern
from mbm.sparse.routines import Making
from mbm.sparse.structure import Structure, Values, distinct
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.types import Backend


class DeferredMatrix:
    """Behaves as the SciPy sparse array of the given ``shape`` that ``make`` makes, once."""

    __array_ufunc__ = None  # products with NumPy's arrays are left to this class

    def __init__(self, shape: tuple[int, int], make: Callable[[], Any]) -> None:
        self.shape = shape
        self._make = make
        self._made: Any = None

    @property
    def matrix(self) -> Any:
        """The matrix itself."""
        if self._made is None:
            self._made = self._make()
        return self._made

    def __matmul__(self, other: Any) -> Any:
        return self.matrix @ other

    def __rmatmul__(self, other: Any) -> Any:
        return other @ self.matrix

    def __mul__(self, other: Any) -> Any:
        return self.matrix * other

    def __rmul__(self, other: Any) -> Any:
        return other * self.matrix

    def __abs__(self) -> Any:
        return abs(self.matrix)

    def __getitem__(self, key: Any) -> Any:
        return self.matrix[key]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.matrix, name)


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
    go to ``places``. ``fronts`` None: the matrix is dense.
    """

    pattern: NormalPattern
    elimination: Elimination | None
    kept: tuple[tuple[int, int], ...]
    columns: Indices
    width: int
    keys: Indices
    places: Indices
    diagonal: Indices
    fronts: FrontSolver | None
    arithmetic: Arithmetic

    @property
    def structure(self) -> Structure:
        """The structure of the Jacobian."""
        return self.pattern.structure

    def accumulate(self, values: Values, factors: Floats | None = None) -> Normal:
        """The blocks of ``JᵀJ``, where each column of J is multiplied by its factor (columns,)."""
        blocks = self.arithmetic.products(self.pattern, values)
        if factors is not None:
            own = [factors[family.columns].reshape(family.members, family.size) for family in self.structure.families]
            for key, block in blocks.items():
                pair = self.pattern.pairs[key]
                block *= own[key[0]][pair.i][:, :, None]
                block *= own[key[1]][pair.j][:, None, :]
        return Normal(pattern=self.pattern, blocks=blocks)

    def gradient(self, values: Values, residuals: Floats) -> Floats:
        """``Jᵀ r`` (columns,)."""
        return self.arithmetic.gradient(self.structure, values, residuals)

    def squares(self, values: Values) -> Floats:
        """The squared norms of the Jacobian's columns (columns,)."""
        return self.arithmetic.squares(self.structure, values)

    def image(self, values: Values, step: Floats) -> Floats:
        """``J step`` (m,)."""
        return self.arithmetic.image(self.structure, values, step)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlockJacobian:
    """The whitened Jacobian at a point: ``values`` for each piece of the structure that ``plan`` was made for."""

    plan: Plan
    values: Values


def blocks_of(minimum: Minimum) -> BlockJacobian:
    """The Jacobian of a sparse problem at its minimum.

    Raises:
        TypeError: the problem is not sparse.

    """
    if not isinstance(minimum.blocks, BlockJacobian):
        message = "the problem is not sparse"
        raise TypeError(message)
    return minimum.blocks


def without_slopes(minimum: Minimum) -> Minimum:
    """The minimum of a sparse problem with the Jacobian zero everywhere: a point where there is none."""
    blocks = blocks_of(minimum)
    layout = blocks.plan.structure
    values = layout.zeros()
    shape = (len(minimum.residuals), len(layout.free))
    jacobian: Any = DeferredMatrix(shape, lambda: layout.estimated(values))
    return replace(minimum, jacobian=jacobian, blocks=replace(blocks, values=values))


def plan(found: Structure, backend: Backend | None = None, workers: int | None = None) -> Plan:
    """Choose the elimination and the representation of what is left.

    ``workers`` threads share the work where it is heavy (None: one for each processor); the store of the ``backend``
    keeps the routines.
    """
    making = Making(backend, sum(p.rows * p.outputs * p.width for p in found.pieces))
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
    keys = distinct(codes)
    dense = width <= NARROW
    if gone is not None and not dense:
        keys = distinct(np.concatenate([keys, _coupled(gone)]))
        dense = width <= WIDE and len(keys) > FULL * width * width / 2
    solver: FrontSolver | None = None
    if not dense:
        sizes = [np.full(f.members, f.size) for n, f in enumerate(found.families) if n != family]
        made = making.front_routines()
        tree = fronts(keys // width, keys % width, np.concatenate(sizes), partial(minimum_degree, made))
        solver = front_solver(tree, made)
    return Plan(
        pattern=pattern,
        elimination=gone,
        kept=kept,
        columns=columns,
        width=width,
        keys=keys,
        places=np.searchsorted(keys, codes),
        diagonal=np.searchsorted(keys, np.arange(width) * (width + 1)),
        fronts=solver,
        arithmetic=arithmetic(pattern, gone, making, workers),
    )


def _coupled(gone: Elimination) -> Indices:
    """The keys of ``YᵀY``, upper triangle."""
    links = gone.links
    left, right = gone.coupled()
    found = []
    for high in np.unique(links.sizes):
        for wide in np.unique(links.sizes):
            chosen = (links.sizes[left] == high) & (links.sizes[right] == wide)
            row = links.heads[left[chosen]][:, None, None] + np.arange(high)[:, None]
            column = links.heads[right[chosen]][:, None, None] + np.arange(wide)
            codes = row * gone.width + column
            found.append(codes[column >= row])
    return np.concatenate(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Factorised:
    """Factors of a matrix with the pattern of ``JᵀJ``; vectors are over the padded columns.

    ``roots`` (members, size, size) are the inverse lower triangles of the eliminated blocks, ``y`` their coupling as
    panels; ``rest`` the factor of what is left: sparse, or the dense lower triangle.
    """

    plan: Plan
    roots: Floats | None
    y: Floats | None
    rest: FrontFactor | Floats | None

    def solve(self, right: Floats) -> Floats:
        """The solution (columns, k) for a right side (columns, k)."""
        gone, work = self.plan.elimination, self.plan.arithmetic
        x = np.empty_like(right)
        remaining = right[self.plan.columns]
        if gone is None or self.roots is None or self.y is None:
            x[self.plan.columns] = self._rest(remaining)
            return x
        own = self.plan.structure.families[gone.family].columns
        inner = work.rooted(self.roots, right[own], transposed=False)
        if self.plan.width:
            remaining = self._rest(remaining - work.carried(self.y, inner))
            x[self.plan.columns] = remaining
            inner -= work.returned(self.y, remaining)
        x[own] = work.rooted(self.roots, inner, transposed=True)
        return x

    def least_pivot(self, diagonal: Floats) -> float:
        """The smallest square of a pivot beside its element on the ``diagonal`` (columns,) of the matrix."""
        squares = np.empty(len(diagonal))
        if isinstance(self.rest, FrontFactor):
            squares[self.plan.columns] = np.square(self.rest.pivots())
        elif self.rest is not None:
            squares[self.plan.columns] = np.square(np.diagonal(self.rest))
        if self.plan.elimination is not None and self.roots is not None:
            own = self.plan.structure.families[self.plan.elimination.family].columns
            squares[own] = 1.0 / np.square(np.einsum("bii->bi", self.roots).reshape(-1))
        return float((squares / diagonal).min(initial=1.0))

    def _rest(self, right: Floats) -> Floats:
        if isinstance(self.rest, np.ndarray):
            return self.plan.arithmetic.solved(self.rest, right)
        return right if self.rest is None else self.rest.solve(right)

    def inverse(self, *, across: bool = True) -> Mapping[tuple[int, int], Floats]:
        """The blocks of the inverse at the blocks of ``JᵀJ``, for each pair of families.

        Without those between the eliminated family and the others if not ``across``.
        """
        entries, whole = self._rest_inverse()
        found: dict[tuple[int, int], Floats] = {}
        taken = entries[self.plan.places]
        reached = 0
        for key in self.plan.kept:
            pair = self.plan.pattern.pairs[key]
            size = len(pair.i) * pair.shape[0] * pair.shape[1]
            found[key] = taken[reached : reached + size].reshape(len(pair.i), *pair.shape)
            reached += size
        gone = self.plan.elimination
        if gone is None or self.roots is None or self.y is None:
            return found
        own = (gone.family, gone.family)
        if not across:
            found[own] = self.plan.arithmetic.inverse_diagonal(self.y, self.roots, whole)
            return found
        panels, found[own] = self.plan.arithmetic.inverse_blocks(self.y, self.roots, whole)
        for cross in gone.crosses:
            lengths = gone.links.lengths[cross.i][:, None, None]
            places = cross.places[:, None, None] + np.arange(gone.size)[:, None] * lengths
            block = panels[places + np.arange(cross.shape[1])]
            found[cross.pair] = block.transpose(0, 2, 1) if cross.flipped else block
        return found

    def _rest_inverse(self) -> tuple[Floats, Any]:
        """The inverse of what is left at the plan's keys, and as a matrix: dense, or sparse with these elements."""
        width, keys = self.plan.width, self.plan.keys
        if self.rest is not None and not isinstance(self.rest, np.ndarray):
            entries = self.rest.inverse(len(keys))
            if self.plan.elimination is None:
                return entries, None
            from scipy.sparse import coo_array, triu

            upper = coo_array((entries, (keys // width, keys % width)), shape=(width, width)).tocsr()
            return entries, (upper + triu(upper, 1).T).tocsr()
        whole = self._rest(np.eye(width))
        return whole[keys // max(width, 1), keys % max(width, 1)], whole


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
        own = added[family.columns].reshape(family.members, family.size)
        roots = found.arithmetic.roots(normal.blocks[gone.family, gone.family], own)
        if roots is None:
            return None
        y = found.arithmetic.couplings(normal, roots)
    rest = _rest_factor(found, data, y)
    return None if rest is None else Factorised(plan=found, roots=roots, y=y, rest=rest)


def _rest_factor(found: Plan, data: Floats, y: Floats | None) -> FrontFactor | Floats | None:
    width = found.width
    if found.fronts is not None:
        if y is not None:
            found.arithmetic.reduce_entries(y, found.keys, data)
        return found.fronts.factorise(data)
    matrix = np.zeros((width, width))
    row, column = (found.keys // width, found.keys % width) if width else (found.keys, found.keys)
    matrix[row, column] = data
    if y is not None:
        found.arithmetic.reduce(y, matrix)
    try:
        return np.asarray(np.linalg.cholesky(matrix.T), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
