"""Sparse Cholesky by fronts: factor, solve, and the inverse on the pattern (`mbm.sparse.blocks.frontal`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.blocks import frontal as of
from mbm.sparse.blocks.parts import Graph
from mbm.sparse.fronts import Fronts
from mbm.sparse.routines import Routines
from mbm.values import dataclass

ROOM = 4
"""Room for cliques that an ordering is given at first, and again whenever it is too little, in sizes of the graph."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontSolver:
    """The fronts as routines take them: ``tree`` refers to the arrays ``held``."""

    routines: Routines
    order: Indices
    tree: Any
    held: tuple[Floats | Indices, ...]
    count: int
    numbers: int
    path: int

    def factorise(self, entries: Floats) -> FrontFactor | None:
        """The factor of the matrix with these entries; None: not positive."""
        panels = np.empty(self.numbers)
        bad = self.routines.call("factorise_fronts", self.tree, np.ascontiguousarray(entries), panels)
        return None if bad else FrontFactor(fronts=self, panels=panels)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrontFactor:
    """``P A Pᵀ = Rᵀ R``; the panels of ``R`` one after the other."""

    fronts: FrontSolver
    panels: Floats

    def solve(self, right: Floats) -> Floats:
        """``A⁻¹ right`` for a right side (n, k)."""
        own = self.fronts
        x = np.ascontiguousarray(right[own.order])
        own.routines.call("solve_fronts", own.tree, self.panels, x.shape[1], x)
        result = np.empty_like(x)
        result[own.order] = x
        return result

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix."""
        own, result = self.fronts, np.empty(entries)
        own.routines.call("inverse_fronts", own.tree, self.panels, np.empty(own.path), result)
        return result


def minimum_degree(made: Routines, left: Indices, right: Indices, sizes: Indices) -> Indices:
    """The elimination order of a graph (`mbm.sparse.blocks.ordering`), as `fronts.Ordering` has it."""
    count, columns = len(sizes), int(sizes.sum())
    codes = np.unique(np.concatenate([left * count + right, right * count + left]))
    row, column = np.divmod(codes, count)
    apart = row != column
    row, column = row[apart], column[apart]
    counts = np.bincount(row, minlength=count)
    order = np.empty(count, dtype=np.int64)
    room = len(column)
    while True:
        room += ROOM * (len(column) + count)
        lists = np.empty(room, dtype=np.int64)
        lists[: len(column)] = column
        held = {
            "sizes": np.ascontiguousarray(sizes),
            "places": _begins(counts),
            "counts": counts.copy(),
            "lists": lists,
            "work": np.zeros(8 * count + columns + 1, dtype=np.int64),
        }
        if not made.call("order_nodes", made.filled(Graph, count=count, columns=columns, room=room, **held), order):
            return order


def front_solver(tree: Fronts, routines: Routines) -> FrontSolver:
    """The fronts of ``tree`` as the routines take them."""
    fronts = tree.fronts
    widths = np.array([front.width for front in fronts])
    sizes = np.array([len(front.rows) for front in fronts])
    parents = np.array([front.parent for front in fronts])
    table = np.zeros((len(fronts), of.FRONT), dtype=np.int64)
    table[:, of.Front.width], table[:, of.Front.size], table[:, of.Front.parent] = widths, sizes, parents
    table[:, of.Front.rows_at] = _begins(sizes)
    table[:, of.Front.entries] = [len(front.source) for front in fronts]
    table[:, of.Front.entries_at] = _begins(table[:, of.Front.entries])
    table[:, of.Front.panel_at] = _begins(widths * sizes)
    table[:, of.Front.part_at] = _part_places(sizes, parents)
    high = np.repeat(sizes, table[:, of.Front.entries])
    row, column = np.divmod(np.concatenate([front.target for front in fronts]), high)
    held = {
        "fronts": table,
        "rows": np.concatenate([front.rows for front in fronts]),
        "into": np.concatenate([np.concatenate([front.rows[: front.width], front.into]) for front in fronts]),
        "source": np.concatenate([front.source for front in fronts]),
        "target": column * high + row,
        "updates": np.empty(_stack_room(sizes - widths, parents)),
        "whole": np.empty(int(sizes.max()) ** 2),
        "waiting": np.empty(2 * len(fronts), dtype=np.int64),
    }
    return FrontSolver(
        routines=routines,
        order=tree.order,
        tree=routines.filled(of.Fronts, count=len(fronts), **held),
        held=tuple(held.values()),
        count=len(fronts),
        numbers=int((widths * sizes).sum()),
        path=int((table[:, of.Front.part_at] + sizes**2).max()),
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
