"""Sparse Cholesky by compiled routines (`mbm.target.blocks.frontal`), of the same fronts as `cholesky`."""

from __future__ import annotations

import numpy as np

from mbm.solution.sparse.fronts import Fronts
from mbm.solution.sparse.routines import Routines
from mbm.solution.types import Floats, Indices
from mbm.target.blocks import frontal as of
from mbm.values import dataclass

ROOM = 4
"""Room for cliques that an ordering is given at first, and again whenever it is too little, in sizes of the graph."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledFronts:
    """The fronts as routines take them; ``updates``, ``whole`` and ``waiting`` are their scratch."""

    routines: Routines
    order: Indices
    table: Indices
    rows: Indices
    into: Indices
    source: Indices
    target: Indices
    numbers: int
    path: int
    updates: Floats
    whole: Floats
    waiting: Indices

    @property
    def count(self) -> int:
        """Number of fronts."""
        return len(self.table)

    def factorise(self, entries: Floats) -> CompiledFactor | None:
        """The factor of the matrix with these entries; None: not positive."""
        panels = np.empty(self.numbers)
        given = (self.source, self.target, np.ascontiguousarray(entries), panels)
        scratch = (self.updates, self.whole, self.waiting)
        bad = self.routines.call("factorise_fronts", self.count, self.table, self.into, *given, *scratch)
        return None if bad else CompiledFactor(fronts=self, panels=panels)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledFactor:
    """``P A Pᵀ = Rᵀ R``; the panels of ``R`` one after the other."""

    fronts: CompiledFronts
    panels: Floats

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        own = self.fronts
        x = np.ascontiguousarray(right[own.order])
        given = (own.table, own.rows, self.panels, x.shape[1], own.whole, x)
        own.routines.call("solve_fronts", own.count, *given)
        result = np.empty_like(x)
        result[own.order] = x
        return result

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix."""
        own, result = self.fronts, np.empty(entries)
        parts = np.empty(own.path)
        given = (own.table, own.into, own.source, own.target, self.panels, parts, result)
        own.routines.call("inverse_fronts", own.count, *given)
        return result


def minimum_degree(made: Routines, left: Indices, right: Indices, sizes: Indices) -> Indices:
    """The elimination order of a graph (`mbm.target.blocks.ordering`), as `fronts.Ordering` has it."""
    count, columns = len(sizes), int(sizes.sum())
    codes = np.unique(np.concatenate([left * count + right, right * count + left]))
    row, column = np.divmod(codes, count)
    apart = row != column
    row, column = row[apart], column[apart]
    counts = np.bincount(row, minlength=count)
    order = np.empty(count, dtype=np.int64)
    room = len(column)
    while True:
        work = np.zeros(8 * count + columns + 1, dtype=np.int64)
        room += ROOM * (len(column) + count)
        lists = np.empty(room, dtype=np.int64)
        lists[: len(column)] = column
        given = (np.ascontiguousarray(sizes), room, _begins(counts), counts.copy(), lists, work, order)
        if not made.call("order_nodes", count, columns, *given):
            return order


def compiled_fronts(tree: Fronts, routines: Routines) -> CompiledFronts:
    """The fronts of ``tree`` for compiled routines."""
    fronts = tree.fronts
    widths = np.array([front.width for front in fronts])
    sizes = np.array([len(front.rows) for front in fronts])
    parents = np.array([front.parent for front in fronts])
    table = np.zeros((len(fronts), of.FRONT), dtype=np.int64)
    table[:, of.WIDTH], table[:, of.SIZE], table[:, of.PARENT] = widths, sizes, parents
    table[:, of.ROWS_AT] = _begins(sizes)
    table[:, of.ENTRIES] = [len(front.source) for front in fronts]
    table[:, of.ENTRIES_AT] = _begins(table[:, of.ENTRIES])
    table[:, of.PANEL_AT] = _begins(widths * sizes)
    into = np.concatenate([np.concatenate([front.rows[: front.width], front.into]) for front in fronts])
    high = np.repeat(sizes, table[:, of.ENTRIES])
    row, column = np.divmod(np.concatenate([front.target for front in fronts]), high)
    table[:, of.PART_AT] = _part_places(sizes, parents)
    return CompiledFronts(
        routines=routines,
        order=tree.order,
        table=table,
        rows=np.concatenate([front.rows for front in fronts]),
        into=into,
        source=np.concatenate([front.source for front in fronts]),
        target=column * high + row,
        numbers=int((widths * sizes).sum()),
        path=int((table[:, of.PART_AT] + sizes**2).max()),
        updates=np.empty(_stack_room(sizes - widths, parents)),
        whole=np.empty(int(sizes.max()) ** 2),
        waiting=np.empty(2 * len(fronts), dtype=np.int64),
    )


def _begins(counts: Indices) -> Indices:
    return np.cumsum(counts) - counts


def _part_places(sizes: Indices, parents: Indices) -> Indices:
    """Where the parts of the inverse stand: each behind that of its parent, which stays until all below it are done."""
    found = np.zeros(len(sizes), dtype=np.int64)
    for k in range(len(sizes) - 1, -1, -1):
        if parents[k] >= 0:
            found[k] = found[parents[k]] + sizes[parents[k]] ** 2
    return found


def _stack_room(below: Indices, parents: Indices) -> int:
    """Numbers on the stack of updates at most, in the order of the fronts."""
    top = most = 0
    waiting: list[tuple[int, int]] = []
    for k, (count, parent) in enumerate(zip(below.tolist(), parents.tolist(), strict=True)):
        while waiting and parents[waiting[-1][0]] == k:
            top = waiting.pop()[1]
        if parent >= 0:
            waiting.append((k, top))
            top += count**2
            most = max(most, top)
    return most
