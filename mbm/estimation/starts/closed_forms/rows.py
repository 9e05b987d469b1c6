"""Equations in some rows, as closed forms are given them: values and slopes at points of one's choosing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.native.code import AnyCode, native_code
from mbm.estimation.starts.closed_forms.piece import Piece
from mbm.symbolic.types import ColumnInput
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Equations of ``width`` components that hold no unknown numbers but one member's of a candidate; n of them.

    ``member`` (n,) is the member, ``unit`` (n,) the number of the equation among all, ``weight`` (n,) 1/σ² of a
    component (the mean of several).
    """

    columns: Indices = field(repr=False)
    pieces: tuple[Piece, ...] = field(repr=False)
    width: int
    member: Indices = field(repr=False)
    unit: Indices = field(repr=False)
    weight: Floats = field(repr=False)

    @classmethod
    def without_numbers(cls, count: int, width: int) -> Rows:
        """So many of equal weight that a closed form has put together itself: they have no values."""
        return cls(
            columns=np.empty(0, dtype=np.int64),
            pieces=(),
            width=width,
            member=np.zeros(count, dtype=np.int64),
            unit=np.arange(count),
            weight=np.ones(count),
        )

    @property
    def code(self) -> AnyCode:
        """The solver's routines, as they are kept with the problem."""
        return native_code(self.pieces[0].group.cache).solver

    def __len__(self) -> int:
        """n."""
        return len(self.member)

    def values(self, points: Floats) -> Floats:
        """The equations, not whitened, (n, width), each row with its own numbers (n, s), or all with the same (s,)."""
        found = np.empty((len(self), self.width))
        for piece, mine in self._parts():
            found[mine] = piece.values(self._points(points)[mine])
        return found

    def slopes(self, points: Floats) -> Floats:
        """Derivatives (n, width, q) by the coordinates of the candidate's tangent space; points as for ``values``."""
        return self.linearised(points)[1]

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """``values`` and ``slopes`` by one evaluation."""
        coordinates = int(self.columns.max()) + 1
        values = np.empty((len(self), self.width))
        slopes = np.empty((len(self), self.width, coordinates))
        for piece, mine in self._parts():
            values[mine], slopes[mine] = piece.linearised(self._points(points)[mine], coordinates)
        return values, slopes

    def probed(self, points: Floats) -> tuple[Floats, Floats]:
        """``linearised`` with each of the points (K, s) in all rows: (n, K, width) and (n, K, width, q)."""
        coordinates, count = int(self.columns.max()) + 1, len(points)
        values = np.empty((len(self), count, self.width))
        slopes = np.empty((len(self), count, self.width, coordinates))
        for piece, mine in self._parts():
            found, steep = piece.probed(points, coordinates)
            values[mine], slopes[mine] = found.swapaxes(0, 1), steep.swapaxes(0, 1)
        return values, slopes

    def _points(self, points: Floats) -> Floats:
        return np.broadcast_to(points, (len(self), points.shape[-1]))

    def _parts(self) -> Iterator[tuple[Piece, slice]]:
        first = 0
        for piece in self.pieces:
            yield piece, slice(first, first + len(piece.lines))
            first += len(piece.lines)

    def column(self, name: str) -> Floats:
        """The numbers (n,) of a column that the equations use.

        Raises:
            LookupError: they use none of this name.

        """
        found = np.empty(len(self))
        for piece, mine in self._parts():
            names = [p.name if isinstance(p, ColumnInput) else None for p in piece.group.kernel.parameters]
            if name not in names:
                message = f"the equations use no column `{name}`"
                raise LookupError(message)
            found[mine] = piece.group.parameters[piece.lines, names.index(name)]
        return found

    def of_member(self, member: int) -> Indices:
        """The rows of one member."""
        return np.flatnonzero(self.member == member)

    def picked(self, mask: Mask) -> Rows:
        """Some of the rows."""
        return replace(
            self,
            pieces=tuple(piece.some(mask[mine]) for piece, mine in self._parts()),
            member=self.member[mask],
            unit=self.unit[mask],
            weight=self.weight[mask],
        )
