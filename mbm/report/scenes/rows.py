"""Expressions at the estimates, for the rows of a group of equations; some unknowns may be put elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbm.equations.binding import Group
from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, Member, leaves
from mbm.problem.naming import key_text
from mbm.problem.rows import member_cells
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem, UnknownKind
from mbm.report.root_means import rows_of
from mbm.report.types import Floats


class RowsOf:
    """The rows (R,) of a group, at the estimates of a solution."""

    def __init__(self, problem: Problem, solution: Solution, group: Group) -> None:
        self.problem, self.solution, self.group = problem, solution, group
        self.rows = rows_of(problem, solution, group)

    def values(self, roots: Sequence[Expression], instead: Mapping[str, Sequence[float]] | None = None) -> Floats:
        """The values (R, k) of expressions; unknowns named in ``instead`` have those numbers in all rows."""
        return self.rows.values(roots, instead)

    def unknowns(self, roots: tuple[Expression, ...], kind: UnknownKind, size: int) -> dict[str, Member | None]:
        """The unknowns of a kind and size that expressions use, with the members that they pick, in their order."""
        used = {leaf.unknown: leaf.member for leaf in leaves(roots) if isinstance(leaf, Component)}
        wanted = [u.name for u in self.problem.unknowns if u.kind is kind and u.size == size]
        return {name: used[name] for name in wanted if name in used}

    def member_table(self, leaf: Component | Column) -> Table | None:
        """The table that has a row for each of the members among which a leaf picks, by its key."""
        if isinstance(leaf, Column):
            return self.solution.tables.get(leaf.table)
        family = self.solution.layout.entry(leaf.unknown).unknown.family
        return None if family is None else self.solution.tables.get(family.rows)

    def keys(self, member: Member | None) -> list[CellKey]:
        """The keys (R,) of the members that are picked; one text for all where there is no family."""
        if member is None:
            return [""] * self.group.rows
        if isinstance(member, ColumnMember):
            cells = member_cells(member, self.rows.table, self.group.positions, self.solution.tables)
            return cells if len(cells) == self.group.rows else cells * self.group.rows
        return [member.key] * self.group.rows

    def key_texts(self, members: Sequence[Member | None]) -> list[str]:
        """The keys of several members (R,), one behind the other."""
        columns = [[shown_key(key) for key in self.keys(member)] for member in members if member is not None]
        return ["-".join(parts) for parts in zip(*columns, strict=True)] if columns else [""] * self.group.rows


def shown_key(key: CellKey) -> str:
    """A key as a name."""
    return key if isinstance(key, str) else key_text(key)
