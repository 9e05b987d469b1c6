"""The work on blocks, by the routines of `mbm.sparse.blocks`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices
from mbm.machine.records import put
from mbm.sparse.blocks.parts import Cross, Entries, Links, Nonzeros, Piece, Products, Rest, product_name
from mbm.sparse.normal import Contribution, Elimination, Normal, NormalPattern
from mbm.sparse.routines import HEAVY, Making, Routines, processors
from mbm.sparse.structure import Structure, Values
from mbm.values import dataclass

NARROW = 512
"""Columns up to which the reduced matrix stays in the cache (2 MB), and is best added to member by member."""


TOGETHER = 2048
"""Rows whose derivatives are computed together: their inputs and nonzeros stay in the cache."""

SHARED = 500_000
"""Products of numbers from which threads share them: what takes half a millisecond."""

SMALL = 600
"""Columns up to which NumPy solves with a triangle before SciPy is loaded: it takes them for full."""


Places: TypeAlias = tuple[Indices, Indices, Indices]
"""Which nonzeros of a kernel, their places in a row of values, their outputs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PieceBlocks:
    """The local blocks of a piece as routines take them: starts, sizes, first columns, members."""

    starts: Indices
    sizes: Indices
    heads: Indices
    members: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arithmetic:
    """The work for a pattern and an elimination, or for none.

    ``pieces`` are those of the structure.
    """

    routines: Routines
    gone: Elimination | None
    pieces: tuple[PieceBlocks, ...]

    def put_jacobian(
        self, group: Group, numbers: Floats, weights: Floats, places: Places, values: Floats, target: Floats
    ) -> None:
        """Some rows at a time, each part from its inputs to its places while it is in the cache."""
        if group.sampled:  # at times that are unknown: the group knows how
            group.fill(numbers)
            values[...], nonzeros = group.evaluation.values_and_jacobian()
            self._put_nonzeros(nonzeros, weights, places, target)
            return
        kernel = group.cache.stream(group.number, group.kernel)
        sizes = (group.index.shape[1], group.parameters.shape[1])

        def part(first: int, last: int) -> None:
            rows = slice(first, last)
            inputs = np.empty((last - first, sum(sizes)))
            given = (*sizes, group.index[rows], numbers, group.parameters[rows], inputs)
            self.routines.call("put_inputs", 0, last - first, *given)
            values[rows], nonzeros = kernel.values_and_jacobian(inputs)
            self._put_nonzeros(nonzeros, weights[rows], places, target[rows])

        self.routines.share(part, group.rows, TOGETHER)

    def _put_nonzeros(self, nonzeros: Floats, weights: Floats, places: Places, target: Floats) -> None:
        rows, outputs = weights.shape
        length = nonzeros.strides[0] // nonzeros.itemsize
        chosen, targets, lines = places
        pattern = self.routines.filled(Nonzeros, count=len(chosen), chosen=chosen, targets=targets, lines=lines)
        put(pattern, Nonzeros, outputs=outputs, length=length, wide=target[0].size if rows else 0)
        self.routines.call("put_nonzeros", 0, rows, pattern, nonzeros, weights, target)

    def products(self, pattern: NormalPattern, values: Values) -> Mapping[tuple[int, int], Floats]:
        """The blocks of ``JᵀJ``: one pass over the rows of each."""
        blocks: dict[tuple[int, int], Floats] = {}
        for key, pair in pattern.pairs.items():
            total = np.zeros((len(pair.i), *pair.shape))
            for part in pair.contributions:
                self._add(values[part.piece], part, part.left, part.right, total)
                if part.mirrored:
                    self._add(values[part.piece], part, part.right, part.left, total)
            blocks[key] = total
        return blocks

    def _add(self, values: Floats, part: Contribution, left: int, right: int, total: Floats) -> None:
        outputs, width = values.shape[1:]
        name = product_name(outputs, total.shape[2])
        where = self.routines.filled(Products, targets=part.targets, starts=part.starts, rows=part.rows, values=values)
        put(where, Products, width=width, high=total.shape[1], left=left, right=right)
        if len(part.rows) * outputs * total[0].size < SHARED:
            self.routines.call(name, 0, len(part.targets), where, total)
        elif part.apart:
            total += self.routines.total(name, len(part.targets), total.shape, where)
        else:
            self.routines.run(name, len(part.targets), where, total)

    def gradient(self, layout: Structure, values: Values, residuals: Floats) -> Floats:
        """``Jᵀ r``."""
        result = np.zeros(layout.columns)
        for piece, own, part in zip(layout.pieces, self.pieces, values, strict=True):
            given = (self._piece(own, part), np.ascontiguousarray(residuals[piece.residuals]))
            result += self.routines.total("add_gradient", len(part), result.shape, *given)
        return result

    def squares(self, layout: Structure, values: Values) -> Floats:
        """The squared norms of the columns."""
        result = np.zeros(layout.columns)
        for own, part in zip(self.pieces, values, strict=True):
            result += self.routines.total("add_squares", len(part), result.shape, self._piece(own, part))
        return result

    def image(self, layout: Structure, values: Values, step: Floats) -> Floats:
        """``J step``."""
        result = np.zeros(layout.count)
        for piece, own, part in zip(layout.pieces, self.pieces, values, strict=True):
            given = (self._piece(own, part), np.ascontiguousarray(step), result[piece.residuals])
            self.routines.run("put_image", len(part), *given)
        return result

    def roots(self, blocks: Floats, added: Floats) -> Floats | None:
        """Inverse lower triangles."""
        result = np.zeros_like(blocks)
        good = self.routines.run("inverse_roots", len(blocks), blocks, np.ascontiguousarray(added), result)
        return result if good else None

    def couplings(self, normal: Normal, roots: Floats) -> Floats:
        """``Y``, from the blocks as they are stored."""
        gone = self._elimination()
        y = np.empty(gone.numbers)
        for cross in gone.crosses:
            size, wide = cross.shape
            along, across = (1, size) if cross.flipped else (wide, 1)
            where = self.routines.filled(Cross, members=cross.i, targets=cross.places, lengths=gone.links.lengths)
            put(where, Cross, wide=wide, along=along, across=across, blocks=normal.blocks[cross.pair])
            self.routines.run("put_couplings", len(cross.i), where, roots, y)
        return y

    def reduce(self, y: Floats, matrix: Floats) -> None:
        """``matrix -= YᵀY``, the upper triangle of blocks."""
        gone = self._elimination()
        if gone.width <= NARROW:
            matrix += self.routines.total("reduce_members", _members(gone), matrix.shape, self._links(y), gone.width)
        else:
            self.routines.run("reduce_blocks", len(gone.links.heads), self._rest(), self._links(y), matrix)

    def reduce_entries(self, y: Floats, keys: Indices, entries: Floats) -> None:
        """The same for a sparse matrix: row by row through a dense line."""
        gone = self._elimination()
        rows, indices = np.divmod(keys, gone.width)
        pointers = np.searchsorted(rows, np.arange(gone.width + 1))
        given = (
            self._rest(),
            self._links(y),
            self.routines.filled(Entries, pointers=pointers, indices=indices),
            entries,
        )
        self.routines.run("reduce_sparse", len(gone.links.heads), *given, scratch=_line(gone))

    def solved(self, lower: Floats, right: Floats) -> Floats:
        """One right side at once; many by BLAS, which takes a while to load: small triangles do without."""
        if right.shape[1] != 1:
            if len(lower) > SMALL:
                return triangular(lower, right)
            return np.asarray(np.linalg.solve(lower.T, np.linalg.solve(lower, right)))
        result = right.copy(order="C")
        self.routines.call("solve_triangular", len(lower), np.ascontiguousarray(lower), result)
        return result

    def rooted(self, roots: Floats, right: Floats, *, transposed: bool) -> Floats:
        """``L⁻¹ right``, or ``L⁻ᵀ right``."""
        right = np.ascontiguousarray(right)
        result = np.empty(right.shape)
        given = (int(transposed), roots, right.shape[1], right, result)
        self.routines.run("put_rooted", len(roots), *given)
        return result

    def carried(self, y: Floats, inner: Floats) -> Floats:
        """``Yᵀ inner``."""
        gone = self._elimination()
        name, sides = _coupling(inner)
        shape = (gone.width, inner.shape[1])
        links, given = self._links(y), np.ascontiguousarray(inner)
        return self.routines.total(name, _members(gone), shape, 1, links, *sides, given)

    def returned(self, y: Floats, rest: Floats) -> Floats:
        """``Y rest``."""
        gone = self._elimination()
        name, sides = _coupling(rest)
        result = np.zeros((_members(gone) * gone.size, rest.shape[1]))
        links, given = self._links(y), np.ascontiguousarray(rest)
        self.routines.run(name, _members(gone), 0, links, *sides, given, result)
        return result

    def inverse_diagonal(self, y: Floats, roots: Floats, rest: Any) -> Floats:
        """Member by member where all of the rest is known; else as below."""
        if not isinstance(rest, np.ndarray):
            return self.inverse_blocks(y, roots, rest)[1]
        gone = self._elimination()
        inner, diagonal = np.empty_like(roots), np.empty_like(roots)
        given = (self._links(y), gone.width, np.ascontiguousarray(rest), roots, inner, diagonal)
        self.routines.run("put_diagonals", len(roots), *given)
        return diagonal

    def inverse_blocks(self, y: Floats, roots: Floats, rest: Any) -> tuple[Floats, Floats]:
        """Images of ``Y`` at its own pattern, then small products, member by member."""
        gone = self._elimination()
        images, across = np.empty_like(y), np.empty_like(y)
        links, count = self._links(y), len(gone.links.heads)
        if isinstance(rest, np.ndarray):
            self.routines.run("images_dense", count, self._rest(), links, np.ascontiguousarray(rest), images)
        else:
            pointers, indices = rest.indptr.astype(np.int64), rest.indices.astype(np.int64)
            given = (self.routines.filled(Entries, pointers=pointers, indices=indices), rest.data, images)
            self.routines.run("images_sparse", count, self._rest(), links, *given, scratch=_line(gone))
        inner, diagonal = np.empty_like(roots), np.empty_like(roots)
        self.routines.run("put_inverse_blocks", len(roots), links, images, roots, inner, across, diagonal)
        return across, diagonal

    def _elimination(self) -> Elimination:
        if self.gone is None:
            message = "nothing is eliminated"
            raise TypeError(message)
        return self.gone

    def _piece(self, own: PieceBlocks, values: Floats) -> Any:
        rows, outputs, width = values.shape
        found = self.routines.filled(Piece, outputs=outputs, width=width, count=len(own.starts), rows=rows)
        put(found, Piece, values=values, starts=own.starts, sizes=own.sizes, heads=own.heads, members=own.members)
        return found

    def _rest(self) -> Any:
        gone = self._elimination()
        links = gone.links
        found = self.routines.filled(Rest, heads=links.heads, sizes=links.sizes, starts=links.starts, width=gone.width)
        put(found, Rest, links=links.order, members=links.members)
        return found

    def _links(self, y: Floats) -> Any:
        links = self._elimination().links
        found = self.routines.filled(Links, begins=links.begins, columns=links.columns, places=links.places, y=y)
        put(found, Links, wides=links.wides, lengths=links.lengths)
        return found


def arithmetic(
    pattern: NormalPattern, gone: Elimination | None, making: Making, workers: int | None = None
) -> Arithmetic:
    """The work for a pattern and an elimination; ``workers`` threads share it if it is heavy (None: all processors)."""
    layout = pattern.structure
    sizes = {
        (layout.pieces[part.piece].outputs, pair.shape[1])
        for pair in pattern.pairs.values()
        for part in pair.contributions
    }
    pieces = []
    for piece in layout.pieces:
        families = [layout.families[f] for f in piece.families]
        pieces.append(
            PieceBlocks(
                starts=np.array(piece.starts, dtype=np.int64),
                sizes=np.array([f.size for f in families], dtype=np.int64),
                heads=np.array([f.first for f in families], dtype=np.int64),
                members=np.ascontiguousarray(piece.members, dtype=np.int64),
            )
        )
    threads = (processors() if workers is None else workers) if making.numbers >= HEAVY else 1
    made = making.routines(sizes, None if gone is None else gone.size, threads)
    return Arithmetic(routines=made, gone=gone, pieces=tuple(pieces))


def _coupling(right: Floats) -> tuple[str, list[int]]:
    """The routine for right sides (…, k), and what it is told of their number."""
    sides = right.shape[1]
    return ("add_coupled_once", []) if sides == 1 else ("add_coupled", [sides])


def _members(gone: Elimination) -> int:
    return len(gone.links.begins) - 1


def _line(gone: Elimination) -> int:
    """Numbers in the widest block row of the rest."""
    return int(gone.links.sizes.max(initial=0)) * gone.width


def triangular(lower: Floats, right: Floats) -> Floats:
    """``(L Lᵀ)⁻¹ right`` for a lower triangle (n, n) and right sides (n, k)."""
    from scipy.linalg.blas import dtrsm

    half = dtrsm(1.0, lower.T, right, lower=0, trans_a=1)
    return np.asarray(dtrsm(1.0, lower.T, half, lower=0))
