"""One equation in some rows, at points of one's choosing: what closed forms are recognised by."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.scatter import scatter
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.thinning import ENOUGH
from mbm.kernels.types import Evaluation
from mbm.values import dataclass


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
        values, slopes = every._linearised(every._alone(every._given(points.repeat(rows, axis=0))), width)
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
        group, variables, given = self.group, self.roles.shape[1], self._given(points)
        if len(self.lines) + ENOUGH < group.rows:
            return self._alone(given)
        evaluation = group.evaluation
        evaluation.inputs[:, :variables] = np.nan
        evaluation.inputs[self.lines, :variables] = given
        evaluation.inputs[:, variables:] = group.parameters
        return evaluation, self.lines

    def _given(self, points: Floats) -> Floats:
        """The numbers (r, variables) of the unknowns in each row."""
        return np.where(self.roles >= 0, np.take_along_axis(points, np.maximum(self.roles, 0), axis=1), self.inputs)

    def _alone(self, given: Floats) -> tuple[Evaluation, slice]:
        """The kernel for the lines and no other rows."""
        group, variables = self.group, self.roles.shape[1]
        evaluation = group.cache.evaluation(group.number, group.kernel, len(self.lines))
        evaluation.inputs[:, :variables] = given
        evaluation.inputs[:, variables:] = group.parameters[self.lines]
        return evaluation, slice(None)
