"""Errors of measured values, eliminated: residuals and Jacobian of the unknowns alone.

The errors-in-variables problem minimises ``vᵀ Σ_y⁻¹ v + eᵀ Σ_h⁻¹ e`` over the unknowns x, the corrections v of the
measured values y and the equations' own errors e, subject to ``h(y + v, x) = e``. For every x the best corrections are
found exactly (`feet`). With B = ∂h/∂y and A = ∂h/∂x there, ``w = h − B v`` and ``S = B Σ_y Bᵀ + Σ_h``, the best cost
is ``wᵀ S⁻¹ w``, and by the envelope theorem its gradient is ``2 Aᵀ S⁻¹ w``. So ``r = S^(-1/2) w`` and
``J = S^(-1/2) A`` are residuals and a Jacobian with the exact cost and gradient, and ``(JᵀJ)⁻¹`` is the covariance of
Gauss and Helmert's model (Koch 1999, 3.7; Lenzmann and Lenzmann 2004 on where to linearise).

The inverse root of ``S = B Bᵀ + Σ`` is never formed: what whitens with it is a `Root`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Protocol

import numpy as np

from mbm.equations.binding import INPUTS_AT_A_TIME, EvaluationCache, Group
from mbm.equations.corrected import CorrectedColumn
from mbm.equations.corrections.feet import feet, first_feet
from mbm.equations.corrections.measured import Measured, MeasuredColumn, check_sharing, measured, rows_of_groups
from mbm.equations.corrections.search import spread
from mbm.equations.corrections.straight import Builder, straight_groups
from mbm.equations.corrections.system import System
from mbm.equations.corrections.types import Conditions, Feet, MeasuredErrors
from mbm.equations.scatter import Scatter
from mbm.equations.types import Floats, Indices, Mask
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.values import dataclass


class Root(Protocol):
    """Something that makes the equations of each component independent with variance 1."""

    def apply(self, values: Floats) -> Floats:
        """``values`` (R, k, n) whitened; NaN where S is singular."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Scalars:
    sigma: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(values / self.sigma[:, :, None])


@dataclass(frozen=True, slots=True, eq=False)
class _Triangles:
    lower: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.lower, values))


@dataclass(frozen=True, slots=True, eq=False)
class _LowRank:
    """``(I + B Bᵀ)^(-1/2) = I + B V diag(((1 + s)^(-1/2) − 1)/s) Vᵀ Bᵀ`` with ``BᵀB = V diag(s) Vᵀ``."""

    slopes: Floats
    inner: Floats

    def apply(self, values: Floats) -> Floats:
        return np.asarray(values + self.slopes @ (self.inner @ (self.slopes.transpose(0, 2, 1) @ values)))


@np.errstate(all="ignore")
def root(slopes: Floats, noisy: Mask) -> Root:
    """The root for ``slopes`` (R, k, q) and equations with own noise where ``noisy`` (R, k)."""
    _, k, q = slopes.shape
    if k == 1:
        squares = np.einsum("rkq,rkq->rk", slopes, slopes) + noisy
        return _Scalars(np.where(squares > 0.0, np.sqrt(squares), np.nan))
    if k > q and bool(noisy.all()):
        squared, vectors = np.linalg.eigh(slopes.transpose(0, 2, 1) @ slopes)
        squared = np.maximum(squared, 0.0)
        grown = np.sqrt(1.0 + squared)
        factors = -1.0 / (grown * (1.0 + grown))  # ((1 + s)^(-1/2) − 1)/s without its cancellation
        return _LowRank(slopes, (vectors * factors[:, None, :]) @ vectors.transpose(0, 2, 1))
    covariance = spread(slopes, noisy)
    try:
        return _Triangles(np.asarray(np.linalg.cholesky(covariance), dtype=np.float64))
    except np.linalg.LinAlgError:
        lower = np.full(covariance.shape, np.nan)
        for i, matrix in enumerate(covariance):
            try:
                lower[i] = np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                continue
        return _Triangles(lower)


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """A system at one point: the feet, the root of the covariance there, the whitened residuals (R, k)."""

    feet: Feet
    root: Root
    residuals: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Components:
    """The components of a system at one point.

    ``groups`` hold the rows of its parts with their measured values corrected, ``residuals`` (R, k) are whitened; so is
    a Jacobian (R, k, width) that is divided by the equations' own noise, once ``root`` is applied.
    """

    groups: tuple[Group, ...]
    root: Root
    residuals: Floats


class _Memory:
    """The last point and what was found there: residuals and Jacobian are asked for one after the other.

    ``carried``: it was begun from what was found at the point before. ``straight`` are groups, and those that were made
    of them.
    """

    def __init__(self) -> None:
        self.point: Floats | None = None
        self.solved: tuple[_Solved, ...] = ()
        self.carried = False
        self.straight: tuple[tuple[Group, ...], tuple[Group, ...] | None] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Elimination:
    """The equations of one data set that have errors in measured columns.

    ``rough``: corrections are found to first order, one step from the measured values (Sampson 1982).
    """

    problem: Problem
    tables: Mapping[str, Table]
    groups: tuple[Group, ...]
    measured: Measured
    cache: EvaluationCache
    systems: tuple[System, ...]
    rough: bool = False
    _whole: Elimination | None = None
    _scatters: tuple[tuple[Scatter, ...], ...] = ()
    _memory: _Memory = field(default_factory=_Memory)

    def over(self, columns: Indices) -> Elimination:
        """The same, with Jacobians over other unknowns; ``columns`` (M,) places each coordinate, -1: nowhere."""
        scatters = tuple(tuple(part.group.scatter(columns) for part in system.parts) for system in self.systems)
        return replace(self, _scatters=scatters)

    def kept(self, residuals: Mask, columns: Indices) -> Elimination:
        """The same for some of all residuals; values that only the others used are not corrected any more."""
        kept = {}
        for number in self.measured.ids:
            group = self.groups[number]
            lines = residuals[group.first : group.first + group.count]
            kept[number] = lines.reshape(group.rows, group.kernel.outputs)
        systems = Builder(self.problem, self.groups, self.measured, self.cache, kept).systems()
        return replace(self, systems=systems, _scatters=(), _whole=self._whole or self, _memory=_Memory()).over(columns)

    def some(self, groups: tuple[Group, ...], rows: Sequence[Indices]) -> Elimination:
        """The same for ``groups``, which hold those ``rows`` of each of its groups."""
        ids = {number: found[rows[number]] for number, found in self.measured.ids.items()}
        chosen = replace(self.measured, ids=ids)
        systems = Builder(self.problem, groups, chosen, self.cache, None).systems()
        return replace(
            self, groups=groups, measured=chosen, systems=systems, _scatters=(), _whole=None, _memory=_Memory()
        )

    def everything(self, columns: Indices) -> Elimination:
        """The same with no residual left out."""
        return self if self._whole is None else self._whole.over(columns)

    def roughly(self) -> Elimination:
        """The same with corrections to first order."""
        return replace(self, rough=True, _whole=None, _memory=_Memory())

    @property
    def widest(self) -> int:
        """Most coordinates that one component touches."""
        return max((system.touched for system in self.systems), default=0)

    def components(self, number: int, numbers: Floats) -> Components:
        """The components of system ``number`` where all unknowns are ``numbers`` (N,)."""
        solved = self._solved(numbers)[number]
        return Components(
            groups=tuple(part.at(solved.feet.corrections) for part in self.systems[number].parts),
            root=solved.root,
            residuals=solved.residuals,
        )

    def forget(self, numbers: Floats) -> None:
        """Let the corrections at ``numbers`` (N,) be found without those of another point; they stay if they were."""
        memory = self._memory
        if memory.carried or not _same(memory.point, numbers):
            memory.point, memory.solved = None, ()

    def add_residuals(self, numbers: Floats, target: Floats) -> None:
        """Enter the whitened residuals into those of all equations; NaN where no corrections meet the equations."""
        for system, solved in zip(self.systems, self._solved(numbers), strict=True):
            target[system.residuals] = solved.residuals

    def residuals_at(self, points: Floats, target: Floats) -> None:
        """Enter the whitened residuals at points (P, N) into those of all equations (P, all residuals)."""
        for system in self.systems:
            count, k = system.noisy.shape
            step = max(INPUTS_AT_A_TIME // max(count * (k + system.corrections) ** 2, 1), 1)
            for first in range(0, len(points), step):
                some = points[first : first + step]
                found = _solved(system.at_points(some), None, rough=self.rough).residuals
                target[first : first + step, system.residuals] = found.reshape(len(some), count, k)

    def add_jacobian(self, numbers: Floats, target: Floats) -> None:
        """Enter the whitened Jacobian into that of all equations (all residuals, n)."""
        width = target.shape[1]
        found = zip(self.systems, self._solved(numbers), self._scatters, strict=True)
        for system, solved, scatters in found:
            slopes = np.zeros((system.noisy.size, width))
            for part, places in zip(system.parts, scatters, strict=True):
                group = part.at(solved.feet.corrections)
                rows = np.zeros((group.rows, group.kernel.outputs, width))
                group.add_jacobian(numbers, places, rows)
                group.whiten_rows(rows)
                slopes[part.equations] = rows
            target[system.residuals] = solved.root.apply(slopes.reshape(*system.noisy.shape, width))

    @np.errstate(all="ignore")
    def shared_out(self, numbers: Floats, parts: Floats) -> tuple[Floats, MeasuredErrors]:
        """Parts (k, all residuals) of standard deviations, by what causes them: ``w = h − B v`` whitened is ``r``.

        A part belongs to an error of one standard deviation in a residual. The first array answered has what is due to
        the equations' own noise instead, the values what is due to the errors of measured columns.
        """
        own, every = parts.copy(), np.zeros((len(parts), len(self.measured.sigma)))
        cells, used = np.full(len(self.measured.sigma), np.nan), np.zeros(len(self.measured.sigma), dtype=bool)
        for system, solved in zip(self.systems, self._solved(numbers), strict=True):
            along = parts[:, system.residuals]
            identity = np.broadcast_to(np.eye(system.noisy.shape[1]), (*system.noisy.shape, system.noisy.shape[1]))
            of_noise = np.einsum("ark,rkj->arj", along, solved.root.apply(identity))
            own[:, system.residuals] = np.where(system.noisy, of_noise, 0.0)
            of_values = -np.einsum("ark,rkq->arq", along, solved.root.apply(solved.feet.slopes))
            for part in system.parts:
                there = part.places >= 0
                every[:, part.ids[there]] = of_values.reshape(len(parts), -1)[:, part.places[there]]
                cells[part.ids] = part.measured
                used[part.ids] = True
        chosen = np.flatnonzero(used & (self.measured.sigma > 0.0))
        columns = self.measured.columns
        rows = np.concatenate([column.rows for column in columns])
        return own, MeasuredErrors(
            names=tuple((column.table, column.column) for column in columns),
            columns=np.repeat(np.arange(len(columns)), [len(column.rows) for column in columns])[chosen],
            rows=rows[chosen],
            values=cells[chosen],
            sigma=self.measured.sigma[chosen],
            parts=every[:, chosen],
        )

    def corrected(self, numbers: Floats) -> tuple[CorrectedColumn, ...]:
        """The corrections of all uncertain values in use, column by column; NaN where none were found."""
        every = np.full(len(self.measured.sigma), np.nan)
        used = np.zeros(len(every), dtype=bool)
        for system, solved in zip(self.systems, self._solved(numbers), strict=True):
            found = np.where(solved.feet.found[:, None], solved.feet.corrections, np.nan)
            system.scaled(found, every)
            for part in system.parts:
                used[part.ids] = True
        used &= self.measured.sigma > 0.0
        return tuple(self._column(column, every, used) for column in self.measured.columns)

    def straight(self, groups: tuple[Group, ...]) -> tuple[Group, ...] | None:
        """`straight_groups` of the groups of all equations, made once; None to first order."""
        if self.rough:
            return None
        known = self._memory.straight
        if known is None or known[0] is not groups:
            known = self._memory.straight = (groups, straight_groups(groups, self.systems))
        return known[1]

    def _column(self, column: MeasuredColumn, corrections: Floats, used: Mask) -> CorrectedColumn:
        places = column.first + np.flatnonzero(used[column.first : column.first + len(column.rows)])
        rows = column.rows[places - column.first].tolist()
        return CorrectedColumn(
            table=column.table,
            column=column.column,
            rows=tuple(row if row > 0 else None for row in rows),
            keys=self.tables[column.table].keys_of_rows(rows),
            value=corrections[places],
            sigma=self.measured.sigma[places],
        )

    def _solved(self, numbers: Floats) -> tuple[_Solved, ...]:
        memory = self._memory
        if not _same(memory.point, numbers):
            memory.carried = bool(memory.solved)
            near = memory.solved or (None,) * len(self.systems)
            found = zip(self.systems, near, strict=True)
            memory.solved = tuple(_solved(s.at_numbers(numbers), last, rough=self.rough) for s, last in found)
            memory.point = numbers.copy()
        return memory.solved


def _same(point: Floats | None, numbers: Floats) -> bool:
    return point is not None and np.array_equal(point, numbers)


@np.errstate(all="ignore")
def _solved(conditions: Conditions, near: _Solved | None, *, rough: bool) -> _Solved:
    found = first_feet(conditions) if rough else feet(conditions, None if near is None else near.feet)
    whitening = root(found.slopes, conditions.noisy)
    residuals = whitening.apply(found.misclosures[:, :, None])[:, :, 0]
    return _Solved(found, whitening, np.where(found.found[:, None], residuals, np.nan))


def elimination(
    problem: Problem, tables: Mapping[str, Table], groups: tuple[Group, ...], cache: EvaluationCache
) -> Elimination | None:
    """The elimination for the groups whose equations have uncertain columns; None if there are none.

    Raises:
        MbmError: standard deviations that are none or do not agree, exact equations that no corrections can meet.

    """
    if all(group.kernel.corrections is None for group in groups):
        return None
    rows = rows_of_groups(groups)
    found = measured(problem, tables, rows)
    check_sharing(problem, tables, rows, found)
    systems = Builder(problem, groups, found, cache, None).systems()
    return Elimination(problem=problem, tables=tables, groups=groups, measured=found, cache=cache, systems=systems)
