"""Equations in some rows, as closed forms are given them: values and slopes at points of one's choosing.

One equation in some rows, at points of one's choosing: what closed forms are recognised by.

Of many rows of one member, enough are taken: what a start is computed from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.scatter import scatter
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.native.code import AnyCode, native_code
from mbm.kernels.types import Evaluation
from mbm.symbolic.types import ColumnInput
from mbm.values import dataclass

ENOUGH = 4_000
"""Rows of a group that each member keeps where closed forms give starts.

A start's variance is then that of the estimate times n / 4000, far inside its basin; the answer is found from all rows.
"""


def thinned(member: Indices, most: int) -> Indices:
    """Positions, ascending, of at most ``most`` rows of each member (n,); the same ones at each call.

    They are drawn without a pattern, so that rows in which stations or times recur are met as often as they occur.
    """
    if len(member) <= most or int(np.bincount(member).max()) <= most:
        return np.arange(len(member))
    mixed = np.random.default_rng(0).permutation(len(member))
    order = mixed[np.argsort(member[mixed], kind="stable")]
    grouped = member[order]
    rank = np.arange(len(member)) - np.searchsorted(grouped, grouped)
    return np.sort(order[rank < most])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """One equation of a group in some of its rows: outputs ``first … last`` of rows ``lines``.

    ``inputs`` (r, variables) holds what is known of the rows' unknowns, ``roles`` (r, variables) for each variable that
    the candidate gives its position among the candidate's numbers, -1 for the others. ``columns`` (M,) are those of all
    coordinates among the candidate's.
    """

    group: Group = field(repr=False)
    lines: Indices = field(repr=False)
    first: int
    last: int
    inputs: Floats = field(repr=False)
    roles: Indices = field(repr=False)
    columns: Indices = field(repr=False)

    def values(self, points: Floats) -> Floats:
        """The outputs (r, last - first) with the candidate's numbers (r, s) of each row."""
        evaluation, rows = self._filled(points)
        return evaluation.values()[rows, self.first : self.last]

    def linearised(self, points: Floats, width: int) -> tuple[Floats, Floats]:
        """The same, and their derivatives (r, last - first, width)."""
        return self._linearised(self._filled(points), width)

    def probed(self, points: Floats, width: int) -> tuple[Floats, Floats]:
        """The same with each of the candidate's numbers (K, s) in all rows: (K, r, …), by one call of the kernel."""
        count, rows = len(points), len(self.lines)
        every = replace(
            self,
            lines=np.tile(self.lines, count),
            inputs=np.tile(self.inputs, (count, 1)),
            roles=np.tile(self.roles, (count, 1)),
        )
        values, slopes = every._linearised(every._alone(every.given(points.repeat(rows, axis=0))), width)
        outputs = values.shape[1]  # there may be no rows to tell it
        return values.reshape(count, rows, outputs), slopes.reshape(count, rows, outputs, width)

    def _linearised(self, filled: tuple[Evaluation, Indices | slice], width: int) -> tuple[Floats, Floats]:
        evaluation, rows = filled
        group, kernel = self.group, self.group.kernel
        found, nonzeros = evaluation.values_and_jacobian()
        outputs, inputs, touched = kernel.jacobian_rows, kernel.jacobian_columns, group.columns[self.lines]
        dense = np.zeros((len(self.lines), kernel.outputs, width))
        scatter(outputs, inputs, touched, group.shared_columns, self.columns).add(nonzeros[rows], dense)
        return found[rows, self.first : self.last], dense[:, self.first : self.last]

    def some(self, mask: Mask) -> Piece:
        """The piece with the rows that ``mask`` (r,) picks."""
        return replace(self, lines=self.lines[mask], inputs=self.inputs[mask], roles=self.roles[mask])

    def _filled(self, points: Floats) -> tuple[Evaluation, Indices | slice]:
        """The kernel with its inputs, and which of its rows are the lines; few of many have one of their own."""
        group, variables, given = self.group, self.roles.shape[1], self.given(points)
        if len(self.lines) + ENOUGH < group.rows:
            return self._alone(given)
        evaluation = group.evaluation
        evaluation.inputs[:, :variables] = np.nan
        evaluation.inputs[self.lines, :variables] = given
        evaluation.inputs[:, variables:] = group.parameters
        return evaluation, self.lines

    def given(self, points: Floats) -> Floats:
        """The numbers (r, variables) of the unknowns in each row."""
        return np.where(self.roles >= 0, np.take_along_axis(points, np.maximum(self.roles, 0), axis=1), self.inputs)

    def _alone(self, given: Floats) -> tuple[Evaluation, slice]:
        """The kernel for the lines and no other rows."""
        group, variables = self.group, self.roles.shape[1]
        evaluation = group.cache.evaluation(group.number, group.kernel, len(self.lines))
        evaluation.inputs[:, :variables] = given
        evaluation.inputs[:, variables:] = group.parameters[self.lines]
        return evaluation, slice(None)


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


def finite(array: Floats, axes: int | tuple[int, ...]) -> Mask:
    """Where all entries along ``axes`` are finite."""
    return np.asarray(np.isfinite(array).all(axis=axes), dtype=bool)
