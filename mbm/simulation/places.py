"""Numbers for the leaves of an equation in the rows of its table, unknowns at their true values included."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Floats, Indices
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
