"""The tables of one solve among many: rows are taken when a table is asked for, because most are never asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from mbm.problem.joining import distinct, stacked
from mbm.problem.rows import Positions
from mbm.problem.sequence.tables import transitions_table
from mbm.problem.sequence.types import Sequence
from mbm.problem.tables import Table
from mbm.problem.types import Family, Problem


class SelectedTables(Mapping[str, Table]):
    """Tables of which each holds only the rows at some positions; those without positions enter whole."""

    def __init__(
        self,
        whole: Mapping[str, Table],
        positions: Mapping[str, Positions],
        families: Mapping[str, Family],
        sequence: Sequence | None = None,
    ) -> None:
        self._whole = whole
        self._positions = positions
        self._families = families
        self._sequence = sequence
        self._taken: dict[str, Table] = {}

    def __getitem__(self, name: str) -> Table:
        found = self._taken.get(name)
        if found is None:
            found = self._taken[name] = self._make(name)
        return found

    def _make(self, name: str) -> Table:
        if self._sequence is not None and name == self._sequence.reached:
            return transitions_table(replace(self._sequence, divided=False), self)
        stack = next((f for f in self._families.values() if f.ordered and f.sources and f.table == name), None)
        if stack is not None:
            return stacked(self, stack.sources, name)
        family = self._families.get(name)
        if family is not None and family.column is not None:
            return distinct(self[family.table], family, name)
        positions = self._positions.get(name)
        return self._whole[name] if positions is None else self._whole[name].take(positions)

    def __iter__(self) -> Iterator[str]:
        yield from self._whole
        yield from (name for name in self._families if name not in self._whole)

    def __len__(self) -> int:
        return len({*self._whole, *self._families})


def column_families(problem: Problem) -> dict[str, Family]:
    """The families over a column, by the name of the table that is made of its distinct values."""
    families = (u.family for u in problem.unknowns if u.family is not None and u.family.column is not None)
    return {family.rows: family for family in families}
