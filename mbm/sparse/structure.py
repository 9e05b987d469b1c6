"""Which blocks of unknowns each equation touches: found once, valid for every point of a solve.

Columns are *padded*: every member of a family has the same number of columns, those of fixed coordinates too (they are
zero in the Jacobian), so that all work on a family goes through arrays of shape (members, size, …).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockFamily:
    """``members`` blocks of ``size`` columns, one after the other from column ``first`` on."""

    first: int
    members: int
    size: int

    @property
    def columns(self) -> slice:
        """All columns of the family."""
        return slice(self.first, self.first + self.members * self.size)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """Equations that touch blocks of the same families: ``rows`` rows with ``outputs`` residuals each.

    ``first`` is the first residual. Local block k belongs to family ``families[k]``, in row r to its member
    ``members[k, r]``, and its columns in the piece's values (rows, outputs, width) start at ``starts[k]``.
    """

    first: int
    outputs: int
    families: tuple[int, ...]
    members: Indices
    starts: tuple[int, ...]
    width: int

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.members.shape[1])

    @property
    def residuals(self) -> slice:
        """Where its residuals stand."""
        return slice(self.first, self.first + self.rows * self.outputs)


Values = Sequence[Floats]
"""The whitened Jacobian: for each piece an array (rows, outputs, width)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """``free`` (n,) are the estimated coordinates among the padded columns, of which there are ``columns``.

    There are ``count`` residuals; those that ``rows`` picks make up the problem (None: all), the others are zero.
    """

    families: tuple[BlockFamily, ...]
    pieces: tuple[Piece, ...]
    columns: int
    free: Indices
    count: int
    rows: Indices | None = None

    @property
    def dead(self) -> Mask:
        """Padded columns (columns,) that no coordinate stands behind."""
        dead = np.ones(self.columns, dtype=bool)
        dead[self.free] = False
        return dead

    def padded(self, step: Floats) -> Floats:
        """A vector or matrix (n, …) over the padded columns, zero where nothing is free."""
        result = np.zeros((self.columns, *step.shape[1:]))
        result[self.free] = step
        return result

    def matrix(self, values: Values) -> Any:
        """The Jacobian (m, columns) as a SciPy CSR array; of one piece it shares the memory of ``values``."""
        from scipy.sparse import csr_array

        pointers = np.zeros(self.count + 1, dtype=np.int64)
        for piece in self.pieces:
            pointers[1:][piece.residuals] = piece.width
        np.cumsum(pointers, out=pointers)
        flat = [found.reshape(-1) for found in values]
        columns = [_columns(self.families, piece) for piece in self.pieces]
        one = len(flat) == 1
        data, indices = (flat[0], columns[0]) if one else (np.concatenate(flat), np.concatenate(columns))
        return csr_array((data, indices, pointers), shape=(self.count, self.columns))

    def estimated(self, values: Values) -> Any:
        """The Jacobian of the residuals that count by the estimated coordinates (m, n), as a SciPy CSR array."""
        from scipy.sparse import csr_array

        found = self.matrix(values)
        if not np.array_equal(self.free, np.arange(self.columns)):
            found = csr_array(found[:, self.free])
        return found if self.rows is None else csr_array(found[self.rows])

    def zeros(self) -> list[Floats]:
        """The values of a Jacobian that is zero everywhere."""
        return [np.zeros((p.rows, p.outputs, p.width)) for p in self.pieces]

    def weighted(self, values: Values, factors: Floats) -> list[Floats]:
        """The Jacobian with each column multiplied by its factor (columns,)."""
        found = [part.copy() for part in values]
        for part, piece in zip(found, self.pieces, strict=True):
            for number, members, start in zip(piece.families, piece.members, piece.starts, strict=True):
                family = self.families[number]
                own = factors[family.columns].reshape(family.members, family.size)[members]
                part[:, :, start : start + family.size] *= own[:, None, :]
        return found


def structure(
    families: Sequence[BlockFamily], pieces: Sequence[Piece], free: Indices, count: int, rows: Indices | None = None
) -> Structure:
    """The structure of ``count`` residuals; ``free`` (n,) are the padded columns that are estimated."""
    return Structure(
        families=tuple(families),
        pieces=tuple(pieces),
        columns=sum(family.members * family.size for family in families),
        free=free,
        count=count,
        rows=rows,
    )


def _columns(families: Sequence[BlockFamily], piece: Piece) -> Indices:
    """The column of every number of a piece's values, flat."""
    found = np.empty((piece.rows, piece.outputs, piece.width), dtype=np.int32)
    for number, members, start in zip(piece.families, piece.members, piece.starts, strict=True):
        family = families[number]
        columns = family.first + members[:, None] * family.size + np.arange(family.size)
        found[:, :, start : start + family.size] = columns[:, None, :]
    return cast(Indices, found.reshape(-1))  # 32 bits: half the memory


def firsts(ascending: Indices) -> Indices:
    """Where each of the distinct numbers of an ascending vector begins."""
    return np.flatnonzero(np.diff(ascending, prepend=ascending[:1] - 1))


def distinct(codes: Indices) -> Indices:
    """Whole numbers (n,), ascending, each once.

    They are sorted: `numpy.unique` hashes them, which takes up to eighty times as long on codes of pairs.
    """
    ascending = np.sort(codes)
    return ascending[firsts(ascending)]
