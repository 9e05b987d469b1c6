"""Equations solved for their measured columns, row by row: Newton's method with differences, all rows at once. Numbers
for the leaves of an equation in the rows of its table, unknowns at their true values included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Lookup, Values
from mbm.expression.nodes import Column, ColumnMember, Component, Leaf, LiteralMember
from mbm.expression.rows import RowChoice, chosen_place
from mbm.problem import faults as problem_faults
from mbm.problem.rows import Positions, lookup, sampled_column
from mbm.problem.tables import ROW, CellKey, Table
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """The rows at ``positions`` (from 0) of ``table`` (both None: once), with the true values ``numbers`` (N,)."""

    table: Table | None
    positions: Positions | None
    tables: Mapping[str, Table]
    layout: Layout
    numbers: Floats

    @property
    def count(self) -> int:
        """Number of rows."""
        return 1 if self.positions is None else len(self.positions)

    def lookup(self, replaced: Mapping[str, Values]) -> Lookup:
        """Values of leaves; columns of the rows at hand that ``replaced`` names have those numbers instead."""
        given = lookup(self.table, self.positions, self.tables)

        def value(leaf: Leaf) -> Values:
            if isinstance(leaf, Component):
                return self._component(leaf)
            if isinstance(leaf, Column) and leaf.sampling is not None:
                return sampled_column(leaf, leaf.sampling, value, self.tables, (self.table, self.positions))
            if isinstance(leaf, Column) and leaf.name in replaced and self.own(leaf):
                return replaced[leaf.name]
            return given(leaf)

        return value

    def own(self, column: Column) -> bool:
        """Whether a column is read from the row at hand."""
        return column.row is RowChoice.EACH and self.table is not None and column.table == self.table.name

    def column(self, name: str) -> Floats:
        """A column of numbers of the rows at hand, shape (rows,)."""
        if self.table is None:
            raise KeyError(name)
        return self.table.numbers(name)[self.positions]

    def _component(self, leaf: Component) -> Values:
        entry = self.layout.entry(leaf.unknown)
        place = entry.offset + entry.unknown.indices().index(leaf.index)
        if leaf.member is None:
            return float(self.numbers[place])
        if isinstance(leaf.member, LiteralMember):
            member = entry.index.get(leaf.member.key)
            if member is None:
                raise _stranger(entry, leaf.member.key)
            return float(self.numbers[place + member * entry.unknown.size])
        return np.asarray(self.numbers[place + self._members(entry, leaf.member) * entry.unknown.size])

    def _members(self, entry: Entry, member: ColumnMember) -> Indices:
        found = []
        for cell in self._cells(member):
            position = entry.index.get(cell)
            if position is None:
                raise _stranger(entry, cell)
            found.append(position)
        return np.array(found, dtype=np.int64)

    def _cells(self, member: ColumnMember) -> list[CellKey]:
        if member.row is not RowChoice.EACH:
            keys = self.tables[member.table].keys(member.column)
            return [keys[chosen_place(member.row, len(keys))]]
        if self.table is None or self.positions is None:
            raise TypeError(member)
        if member.column == ROW and ROW not in self.table.columns:
            return [float(row) for row in self.table.rows[self.positions]]
        cells = self.table.keys(member.column)
        return [cells[i] for i in self.positions]


def _stranger(entry: Entry, key: CellKey) -> MbmError:
    where = f"the family `{entry.unknown.name}`"
    return MbmError(problem_faults.dangling_key(entry.unknown.span, key, where, None, None))


Function = Callable[[Floats], Floats]
"""The components of an equation, shape (rows, k), for columns of shape (rows, p)."""

NEWTON_STEPS = 60
STEP_HALVINGS = 12
STEP = 6e-6
"""Relative step of a central difference: the cube root of the rounding, where both of its errors are smallest."""

ENOUGH = 1e-9
"""Distance from the wanted value, in standard deviations, that no estimate can notice."""

ACCEPTED = 1e-6
"""Distance up to which a row counts as solved where rounding stops the iteration: large coordinates, small noise."""


LENGTH = 1e-4
"""Share of a column in the free direction above which it counts; below are the roundings of differences."""


@np.errstate(all="ignore")
def solved_rows(
    function: Function, start: Floats, wanted: Floats, scale: Floats, metric: Floats
) -> tuple[Floats, Mask]:
    """Columns (rows, p) near ``start`` at which ``function`` is ``wanted`` (rows, k), and which rows were solved.

    Steps have minimum norm in the ``metric`` (rows, p), the size of a natural change of each column: with more columns
    than components (quaternions, errors in the variables) the others stay where they are. ``scale`` (rows, k) is the
    standard deviation of each component.
    """
    x = start.copy()
    typical = np.maximum(np.abs(start).max(axis=0, initial=0.0), metric)
    gap = function(x) - wanted
    for _ in range(NEWTON_STEPS):
        open_rows = ~(_distance(gap, scale) <= ENOUGH)
        if not bool(open_rows.any()):
            break
        step = _newton(_differences(function, x, typical), gap, metric)
        step[~open_rows] = 0.0
        x, gap, moved = _searched(function, x, gap, step, wanted, scale)
        if not moved:
            break
    solved = np.asarray(_distance(gap, scale) <= ACCEPTED, dtype=bool)
    if x.shape[1] == wanted.shape[1] + 1 and bool(solved.all()):
        x = _as_long_as_before(function, x, start, (wanted, scale))
    return x, solved


def _as_long_as_before(function: Function, x: Floats, start: Floats, goal: tuple[Floats, Floats]) -> Floats:
    """Columns whose common length the function does not notice (quaternions) get back the length that they had."""
    jacobian = _differences(function, x, np.abs(x))
    if not bool(np.isfinite(jacobian).all()):
        return x
    free = np.linalg.svd(jacobian)[2][:, -1]
    held = (np.abs(free) > LENGTH * np.abs(free).max(axis=1, keepdims=True)).any(axis=0)
    before, now = (np.linalg.norm(each[:, held], axis=1) for each in (start, x))
    if not bool((before > 0).all()) or not bool((now > 0).all()):
        return x
    scaled = x.copy()
    scaled[:, held] *= (before / now)[:, None]
    wanted, scale = goal
    same = bool((_distance(function(scaled) - wanted, scale) <= ACCEPTED).all())
    return scaled if same else x


@np.errstate(all="ignore")
def spread_of(function: Function, x: Floats, metric: Floats) -> Floats:
    """How much each component (rows, k) changes when the columns do, each by its ``metric`` (rows, p); 1 if not at all.

    This is the root diagonal of H_y Σ_y H_yᵀ.
    """
    jacobian = _differences(function, x, np.maximum(np.abs(x).max(axis=0, initial=0.0), metric))
    found = np.sqrt(np.square(jacobian * metric[:, None, :]).sum(axis=2))
    return np.where(np.isfinite(found) & (found > 0), found, 1.0)


def _distance(gap: Floats, scale: Floats) -> Floats:
    found = np.abs(gap / scale).max(axis=1, initial=0.0)
    return np.asarray(np.where(np.isfinite(found), found, np.inf), dtype=np.float64)


def _differences(function: Function, x: Floats, typical: Floats) -> Floats:
    """The derivatives (rows, k, p) of the components with respect to the columns."""
    columns = []
    for j in range(x.shape[1]):
        step = STEP * np.maximum(np.abs(x[:, j]), typical[:, j])
        ahead, behind = x.copy(), x.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        width = ahead[:, j] - behind[:, j]
        columns.append((function(ahead) - function(behind)) / width[:, None])
    return np.stack(columns, axis=2)


def _newton(jacobian: Floats, gap: Floats, metric: Floats) -> Floats:
    """The step (rows, p) of minimum norm in the metric that closes the gap to first order; 0 where there is none."""
    scaled = jacobian * metric[:, None, :]
    usable = np.isfinite(scaled).all(axis=(1, 2)) & np.isfinite(gap).all(axis=1)
    step = np.zeros(metric.shape)
    if bool(usable.any()):
        inverse = np.linalg.pinv(scaled[usable], rcond=1e-12)
        step[usable] = -np.einsum("rpk,rk->rp", inverse, gap[usable]) * metric[usable]
    return step


def _searched(
    function: Function, x: Floats, gap: Floats, step: Floats, wanted: Floats, scale: Floats
) -> tuple[Floats, Floats, bool]:
    """The columns after the step, halved in each row until the row comes closer; whether any row did."""
    before = _distance(gap, scale)
    best, best_gap = x, gap
    share = np.ones(len(x))
    better = np.zeros(len(x), dtype=bool)
    moving = np.abs(step).max(axis=1, initial=0.0) > 0.0
    for _ in range(STEP_HALVINGS):
        waiting = moving & ~better
        if not bool(waiting.any()):
            break
        trial = x + share[:, None] * step
        trial_gap = function(trial) - wanted
        closer = waiting & (_distance(trial_gap, scale) < before)
        best = np.where(closer[:, None], trial, best)
        best_gap = np.where(closer[:, None], trial_gap, best_gap)
        better |= closer
        share[~better] /= 2
    return best, best_gap, bool(better.any())
