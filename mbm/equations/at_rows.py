"""Expressions at rows of a table and numbers of the unknowns, without a kernel: for what is asked for once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.gathering import MemberPicker, picked_members
from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Component, Expression, Leaf, externals
from mbm.expression.projection import Projection
from mbm.problem.rows import Positions, lookup, sampled_column
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.symbolic.types import Slot
from mbm.values import dataclass

DIVIDES_BY_DEPTH = "pinhole"
"""The model of cameras that shows points behind it, turned upside down."""


def pinholes(group: Group) -> list[Projection]:
    """By which cameras that divide by the depth the equations of a group see their points."""
    seen = (equation.projection for equation in group.equations)
    return [each for each in seen if each is not None and each.model == DIVIDES_BY_DEPTH]


def looks_back(first: Values, second: Values) -> Mask:
    """Whether a camera with these focal lengths looks along −z: both are negative."""
    return np.asarray((np.asarray(first) < 0) & (np.asarray(second) < 0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AtRows:
    """The R rows ``lines`` of a group, at ``positions`` of ``table`` (one without a table).

    ``numbers`` gives those of the unknowns at places (R,) of the ``layout``, or at one for all rows.
    """

    count: int
    group: Group
    lines: Indices | slice
    layout: Layout
    table: Table | None
    positions: Positions | None
    tables: Mapping[str, Table]
    numbers: Callable[[Indices | int], Values]
    pick: MemberPicker = picked_members

    def values(self, roots: Sequence[Expression], instead: Mapping[str, Sequence[float]] | None = None) -> Floats:
        """The values (R, k) of expressions that call no Python; unknowns named in ``instead`` have those numbers."""
        data = lookup(self.table, self.positions, self.tables)

        def value(leaf: Leaf) -> Values:
            if isinstance(leaf, Column) and leaf.sampling is not None:
                return sampled_column(leaf, leaf.sampling, value, self.tables, (self.table, self.positions))
            if not isinstance(leaf, Component):
                return data(leaf)
            entry = self.layout.entry(leaf.unknown)
            component = entry.unknown.indices().index(leaf.index)
            if instead is not None and leaf.unknown in instead:
                return instead[leaf.unknown][component]
            return self.numbers(self._place(Slot(leaf.unknown, component, leaf.member), entry))

        found = np.empty((self.count, len(roots)))
        for place, column in enumerate(evaluate(tuple(roots), value)):
            found[:, place] = column
        return found

    def _place(self, slot: Slot, entry: Entry) -> Indices | int:
        """Where a number stands: as the kernel has it, if it takes that one."""
        if slot in self.group.kernel.variables:
            return np.asarray(self.group.index[self.lines, self.group.kernel.variables.index(slot)])
        member: Indices | int = 0
        if slot.member is not None:
            member = self.pick(entry, slot.member, self.table, self.positions, self.tables)
        return entry.offset + member * entry.unknown.size + slot.component

    def behind(self) -> Mask | None:
        """Which rows (R,) see a point that is behind its camera, or beside it; None where no equation can tell."""
        wanted = [each for seen in pinholes(self.group) for each in (seen.depth, *seen.focal)]
        if not wanted or any(externals(tuple(wanted))):
            return None
        depth, *focal = np.moveaxis(self.values(wanted).reshape(self.count, -1, 3), 2, 0)
        ahead = np.where(looks_back(*focal), -depth, depth)
        return np.asarray((ahead <= 0).any(axis=1))


def rows_at(problem: Problem, group: Group, layout: Layout, tables: Mapping[str, Table], numbers: Floats) -> AtRows:
    """The rows of a group at any ``numbers`` (N,) of the unknowns."""
    block = problem.blocks[group.kernel.owner]

    def chosen(places: Indices | int) -> Values:
        return np.asarray(numbers[places])

    return AtRows(
        count=group.rows,
        group=group,
        lines=slice(None),
        layout=layout,
        table=None if block.table is None else tables[block.table],
        positions=group.positions,
        tables=tables,
        numbers=chosen,
    )
