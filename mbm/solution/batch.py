"""The equations at many points at once: the rows of all points go through each kernel together.

What `solvers.batched` works on, for multi-start search (the same equations at every point) and for consensus (a subset
of the equations for each trial).
"""

from __future__ import annotations

import numpy as np

from mbm.kernels.types import Stream
from mbm.solution.assembly import Assembled
from mbm.solution.binding import Group
from mbm.solution.robust.losses.rooted import rooted, rooted_jacobian
from mbm.solution.scatter import Scatter
from mbm.solution.types import Floats, Indices, Mask
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Lines:
    """Rows of one kernel that some trials want: ``rows`` (P,) of the group, ``slots`` (P, outputs) in the residuals.

    ``trials`` (P,) says who wants them, None: all trials want all of them. A slot of m takes what nobody wants.
    """

    group: Group
    stream: Stream
    scatter: Scatter
    rows: Indices
    slots: Indices
    trials: Indices | None

    def pairs(self, which: Indices, trials: int) -> tuple[Indices, Indices, Indices]:
        """Point number (P',), row of the group (P',) and slots (P', outputs) for points that belong to ``which``."""
        if self.trials is None:
            points = np.repeat(np.arange(len(which)), len(self.rows))
            return points, np.tile(self.rows, len(which)), np.tile(self.slots, (len(which), 1))
        position = np.full(trials, -1, dtype=np.int64)
        position[which] = np.arange(len(which))
        points = position[self.trials]
        wanted = points >= 0
        return points[wanted], self.rows[wanted], self.slots[wanted]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Batch:
    """Equations at many points (protocol ``Stack`` of `solvers.batched`); made by ``batch``.

    ``columns`` (n,) are the coordinates that move, as positions in the vector of all coordinates; all other numbers
    stay as each point has them. ``count`` m is the largest number of residuals of a trial: what a trial has less is 0.
    """

    equations: Assembled
    columns: Indices
    count: int
    trials: int
    _lines: tuple[_Lines, ...]

    @property
    def dimension(self) -> int:
        """n."""
        return len(self.columns)

    @property
    def lower(self) -> Floats:
        """Hard lower bounds (n,)."""
        return self.equations.layout.lower[self.columns]

    @property
    def upper(self) -> Floats:
        """Hard upper bounds (n,)."""
        return self.equations.layout.upper[self.columns]

    @property
    def positive(self) -> Mask:
        """Coordinates that stay above zero (n,)."""
        return self.equations.layout.positive[self.columns]

    def residuals(self, points: Floats, which: Indices | None = None) -> Floats:
        """Whitened residuals (T, m) at points (T, N), losses included; ``which`` (T,) as in ``linearised``."""
        which = np.arange(len(points)) if which is None else which
        result = np.zeros((len(points), self.count + 1))
        for lines in self._lines:
            point, rows, slots = lines.pairs(which, self.trials)
            values = lines.stream.values(_inputs(lines.group, points, point, rows))
            result[point[:, None], slots] = self._whitened(lines.group, values, rows)
        return result[:, : self.count]

    def linearised(self, points: Floats, which: Indices) -> tuple[Floats, Floats]:
        """Whitened residuals (T, m) with their losses, and their derivatives by a step (T, m, n).

        ``which`` (T,) says to which trial a point belongs, where each trial has units of its own; no trial may occur
        twice. Otherwise it only counts the points.
        """
        residuals = np.zeros((len(points), self.count + 1))
        jacobian = np.zeros((len(points), self.count + 1, self.dimension))
        for lines in self._lines:
            point, rows, slots = lines.pairs(which, self.trials)
            values, nonzeros = lines.stream.values_and_jacobian(_inputs(lines.group, points, point, rows))
            slopes = np.zeros((len(rows), lines.group.kernel.outputs, self.dimension))
            _scattered(lines.scatter, nonzeros, rows, slopes)
            place = point[:, None]
            residuals[place, slots], jacobian[place, slots] = self._whitened_slopes(lines.group, values, slopes, rows)
        return residuals[:, : self.count], jacobian[:, : self.count]

    def coordinates(self, points: Floats) -> Floats:
        """The numbers that steps add to (T, n), 0 for rotations, directions and scales."""
        places = self.equations.layout.number[self.columns]
        return np.where(places >= 0, points[:, places], 0.0)

    def moved(self, points: Floats, steps: Floats) -> Floats:
        """The points after the steps (T, n), inside the bounds."""
        layout = self.equations.layout
        every = np.zeros((len(points), len(layout.number)))
        every[:, self.columns] = steps
        result = layout.retract(points, every)
        places = layout.number[self.columns]
        plain = places >= 0
        result[:, places[plain]] = np.clip(result[:, places[plain]], self.lower[plain], self.upper[plain])
        return result

    def _whitened(self, group: Group, values: Floats, rows: Indices) -> Floats:
        result = np.empty_like(values)
        for number, whitener in enumerate(group.whiteners):
            part = values[:, whitener.first : whitener.last]
            weights = whitener.weights[rows]
            part = part * weights if weights.ndim == 2 else np.einsum("rij,rj->ri", weights, part)
            if self.equations.factors is not None:
                part = part / self._factors(group, rows)[:, whitener.first : whitener.last]
            if group.losses:
                part = rooted(group.losses[number], part)
            result[:, whitener.first : whitener.last] = part
        return result

    def _whitened_slopes(self, group: Group, values: Floats, slopes: Floats, rows: Indices) -> tuple[Floats, Floats]:
        result = np.empty_like(values)
        for number, whitener in enumerate(group.whiteners):
            places = slice(whitener.first, whitener.last)
            part, slope = values[:, places], slopes[:, places]
            weights = whitener.weights[rows]
            if weights.ndim == 2:
                part, slope = part * weights, slope * weights[:, :, None]
            else:
                part, slope = np.einsum("rij,rj->ri", weights, part), np.einsum("rij,rjn->rin", weights, slope)
            if self.equations.factors is not None:
                factors = self._factors(group, rows)[:, places]
                part, slope = part / factors, slope / factors[:, :, None]
            if group.losses:
                loss = group.losses[number]
                part, slope = rooted(loss, part), rooted_jacobian(loss, part, slope)
            result[:, places], slopes[:, places] = part, slope
        return result, slopes

    def _factors(self, group: Group, rows: Indices) -> Floats:
        """The noise factors of rows of a group, shape (P, outputs)."""
        factors = self.equations.factors
        if factors is None:
            return np.ones((len(rows), group.kernel.outputs))
        return factors[group.first : group.first + group.count].reshape(group.rows, -1)[rows]


def batch(equations: Assembled, *, columns: Indices | None = None, units: Indices | None = None) -> Batch:
    """The equations for many points at once.

    Args:
        equations: the problem at hand; its ``free`` coordinates, and the rows and weights that it has.
        columns: positions, in the vector of all coordinates, of those that move; ``equations.free`` if None.
        units: numbers of the units (`Assembled.units`) that count: shape (k,) for all points alike, or (T, k) for trial
            0 … T−1 each with its own (repeated ones count twice); all of ``equations`` if None.

    """
    columns = equations.free if columns is None else columns
    units = np.unique(equations.units) if units is None else units
    place = np.full(len(equations.layout.number), -1, dtype=np.int64)
    place[columns] = np.arange(len(columns))
    sizes = _unit_sizes(equations)
    chosen = units if units.ndim == 2 else units[None, :]
    ends = np.cumsum(sizes[chosen], axis=1)
    count = int(ends[:, -1].max()) if ends.size else 0
    lines = [
        _lines_of(group, chosen, ends, count, place, shared=units.ndim == 1)
        for group in equations.groups
        if group.rows and group.whiteners
    ]
    kept = tuple(line for line in lines if len(line.rows))
    return Batch(equations=equations, columns=columns, count=count, trials=len(chosen), _lines=kept)


def _unit_sizes(equations: Assembled) -> Indices:
    """Scalar residuals of each unit, in the order of all units."""
    parts = [np.tile([w.last - w.first for w in g.whiteners], g.rows) for g in equations.groups]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)


def _lines_of(group: Group, units: Indices, ends: Indices, count: int, place: Indices, *, shared: bool) -> _Lines:
    """The rows of a group that hold units (T, k), whose residuals end at ``ends`` (T, k)."""
    per_row = len(group.whiteners)
    inside = (units >= group.first_unit) & (units < group.first_unit + per_row * group.rows)
    trial, position = np.nonzero(inside)
    row, equation = np.divmod(units[trial, position] - group.first_unit, per_row)
    slots = np.full((len(row), group.kernel.outputs), count, dtype=np.int64)
    for number, whitener in enumerate(group.whiteners):
        mine = equation == number
        size = whitener.last - whitener.first
        slots[mine, whitener.first : whitener.last] = ends[trial, position][mine, None] - size + np.arange(size)
    if shared and per_row > 1:
        row, first = np.unique(row, return_inverse=True)
        joined = np.full((len(row), group.kernel.outputs), count, dtype=np.int64)
        np.minimum.at(joined, first, slots)
        slots = joined
    return _Lines(
        group=group,
        stream=group.cache.stream(group.number, group.kernel),
        scatter=group.scatter(place),
        rows=row,
        slots=slots,
        trials=None if shared else trial,
    )


def _inputs(group: Group, points: Floats, point: Indices, rows: Indices) -> Floats:
    """Inputs of a kernel for rows (P,) of a group at points (P,): unknowns, then data."""
    variables = group.index.shape[1]
    result = np.empty((len(rows), variables + group.parameters.shape[1]))
    result[:, :variables] = points[point[:, None], group.index[rows]]
    result[:, variables:] = group.parameters[rows]
    for each in group.sampled:
        each.fill(result[:, variables:], lambda places: points[point, places], rows, whole=False)
    return result


def _scattered(places: Scatter, nonzeros: Floats, rows: Indices, target: Floats) -> None:
    """Add nonzeros (P, nonzeros) of rows (P,) of a group to ``target`` (P, outputs, n)."""
    for k, output, column in places.fixed:
        target[:, output, column] += nonzeros[:, k]
    for k, output, columns in places.varying:
        chosen = columns[rows]
        kept = np.flatnonzero(chosen >= 0)
        target[kept, output, chosen[kept]] += nonzeros[kept, k]
