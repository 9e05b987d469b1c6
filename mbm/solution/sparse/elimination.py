"""Schur elimination: a family of which no two members meet is solved for member by member, and leaves the equations.

With ``A = L Lᵀ`` the diagonal blocks of the family, ``W`` its coupling to the rest and ``Y = L⁻¹ W``, the rest obeys
``S = B - YᵀY`` (Brown 1958; Triggs, McLauchlan, Hartley and Fitzgibbon 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbm.solution.sparse.normal import Normal, NormalPattern
from mbm.solution.types import Floats, Indices

WORTH = 8
"""A family is eliminated if it has at least so many members …"""

CHUNK = 4_000_000
"""Numbers in a dense part of ``Y`` that is multiplied at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cross:
    """The blocks between the eliminated family and another one, at members ``i`` (eliminated) and ``j``."""

    pair: tuple[int, int]
    flipped: bool
    i: Indices
    j: Indices
    shape: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elimination:
    """``family`` goes; ``rest`` (columns,) gives the place of each padded column among the others, -1 in the family.

    ``pointers``, ``indices`` are the CSR pattern of ``Y`` (family's columns × width), ``order`` the element of the
    crosses' blocks, flattened one after the other, that stands at each of its places.
    """

    family: int
    crosses: tuple[Cross, ...]
    rest: Indices
    width: int
    pointers: Indices
    indices: Indices
    order: Indices

    def couplings(self, normal: Normal) -> list[Floats]:
        """``W`` as blocks (blocks, size of the family, size of the other), one array for each cross."""
        found = []
        for cross in self.crosses:
            blocks = normal.blocks[cross.pair]
            found.append(blocks.transpose(0, 2, 1) if cross.flipped else blocks)
        return found

    def sparse(self, blocks: list[Floats]) -> Any:
        """Blocks at the crosses as a CSR array (family's columns, width)."""
        from scipy.sparse import csr_array

        flat = np.concatenate([b.reshape(-1) for b in blocks]) if blocks else np.zeros(0)
        lines = len(self.pointers) - 1
        return csr_array((flat[self.order], self.indices, self.pointers), shape=(lines, self.width))

    def blocks(self, data: Floats) -> list[Floats]:
        """The converse of ``sparse``, from the data of its CSR array."""
        flat = np.empty(len(data))
        flat[self.order] = data
        sizes = [len(c.i) * c.shape[0] * c.shape[1] for c in self.crosses]
        parts = np.split(flat, np.cumsum(sizes)[:-1]) if sizes else []
        return [p.reshape(len(c.i), *c.shape) for p, c in zip(parts, self.crosses, strict=True)]


def eliminable(pattern: NormalPattern) -> int | None:
    """The largest family of which no two members meet; None where it is not worth while.

    It should outweigh the rest of the unknowns: else the order of elimination in sparse Cholesky does as well.
    """
    families = pattern.structure.families
    best, size = None, 0
    for number, family in enumerate(families):
        pair = pattern.pairs[number, number]
        if len(pair.i) == family.members and family.members >= WORTH and family.members * family.size > size:
            best, size = number, family.members * family.size
    return best if 2 * size >= pattern.structure.columns else None


def elimination(pattern: NormalPattern, family: int) -> Elimination:
    """The places of everything once ``family`` is gone."""
    families = pattern.structure.families
    gone = families[family]
    rest = np.full(pattern.structure.columns, -1, dtype=np.int64)
    kept = np.ones(len(rest), dtype=bool)
    kept[gone.columns] = False
    rest[kept] = np.arange(int(kept.sum()))
    crosses, rows, columns = [], [], []
    for (left, right), pair in pattern.pairs.items():
        if left == right or family not in (left, right) or not len(pair.i):
            continue
        flipped = right == family
        i, j = (pair.j, pair.i) if flipped else (pair.i, pair.j)
        other = families[left if flipped else right]
        shape = (gone.size, other.size)
        crosses.append(Cross(pair=(left, right), flipped=flipped, i=i, j=j, shape=shape))
        row = (
            i[:, None, None] * gone.size + np.arange(gone.size)[:, None] + np.zeros((1, 1, other.size), dtype=np.int64)
        )
        column = rest[other.first] + j[:, None, None] * other.size + np.arange(other.size)
        rows.append(row.reshape(-1))
        columns.append(np.broadcast_to(column, row.shape).reshape(-1))
    every = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    indices = np.concatenate(columns) if columns else np.zeros(0, dtype=np.int64)
    order = np.lexsort((indices, every))
    lines = gone.members * gone.size
    pointers = np.searchsorted(every[order], np.arange(lines + 1))
    return Elimination(
        family=family,
        crosses=tuple(crosses),
        rest=rest,
        width=int(kept.sum()),
        pointers=pointers.astype(np.int32),
        indices=indices[order].astype(np.int32),
        order=order,
    )


def squared(y: Any) -> Floats:
    """``YᵀY`` of a CSR array, dense, a part of its rows at a time."""
    lines, width = y.shape
    total = np.zeros((width, width))
    step = max(CHUNK // max(width, 1), 1)
    for start in range(0, lines, step):
        part = y[start : start + step].toarray()
        total += part.T @ part
    return total
