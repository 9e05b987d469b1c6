"""Sparse Cholesky by fronts: factor, solve, and the inverse on the pattern (`mbm.sparse.blocks.frontal`).

The symbolic half of sparse Cholesky: an elimination order, and the dense fronts it leads to.

Columns come in blocks (members of families), which are ordered and eliminated whole. Fronts and their tree: Duff and
Reid (1983), Liu (1992); small ones are joined to their parents, because a front costs the same whether it is 3 or 30
columns wide.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.blocks import frontal as of
from mbm.sparse.blocks.parts import Graph
from mbm.sparse.routines import Routines
from mbm.sparse.structure import distinct
from mbm.values import dataclass

RELAXED = ((32, 0.8), (96, 0.3), (1 << 40, 0.05))
"""Share of zeros that a front may hold after joining its child, by its number of columns (as CHOLMOD does)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front:
    """``width`` columns of the permuted matrix and the ``rows`` (their own ones first, ascending).

    ``parent`` is the front that takes over the rest of the rows (-1: none is left), at its rows ``into``. Entries
    ``source`` of the matrix go to the flat places ``target`` in the front's lower triangle.
    """

    width: int
    rows: Indices
    parent: int
    into: Indices
    source: Indices
    target: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fronts:
    """``order`` (n,): the column that stands at each place of the permuted matrix; ``fronts`` are in postorder."""

    order: Indices
    fronts: tuple[Front, ...]


Ordering: TypeAlias = Callable[[Indices, Indices, Indices], Indices]
"""From the entries of a graph, each pair of nodes once, and the sizes of its nodes to an elimination order."""


def fronts(rows: Indices, columns: Indices, sizes: Indices, ordering: Ordering) -> Fronts:
    """The fronts of a symmetric matrix with entries at ``(rows, columns)``, each pair once (in either triangle).

    ``sizes`` (blocks,) are the numbers of columns in each block; every diagonal element must be among the entries.
    """
    first = np.concatenate([[0], np.cumsum(sizes)])
    block_of = np.repeat(np.arange(len(sizes)), sizes)
    order = ordering(block_of[rows], block_of[columns], sizes)
    below, parents = _eliminated(block_of[rows], block_of[columns], order)
    tops, owner = _joined(below, parents, sizes[order])
    tops = _postordered(tops, [owner[parents[top]] if parents[top] >= 0 else -1 for top in tops])
    owned: list[list[int]] = [[] for _ in sizes]
    for place, top in enumerate(owner):
        owned[top].append(place)
    sequence = np.array([place for top in tops for place in owned[top]], dtype=np.int64)
    scalar = _strung(first[order[sequence]], sizes[order[sequence]])
    place_of = np.empty(len(scalar), dtype=np.int64)
    place_of[scalar] = np.arange(len(scalar))
    start = np.empty(len(sizes), dtype=np.int64)
    start[sequence] = np.concatenate([[0], np.cumsum(sizes[order[sequence]])[:-1]])
    counts = sizes[order]
    spans = []
    for top in tops:
        inside, outside = np.array(owned[top]), np.array([*below[top]], dtype=np.int64)
        own = _strung(start[inside], counts[inside])
        spans.append((len(own), np.concatenate([own, np.sort(_strung(start[outside], counts[outside]))])))
    number = {top: k for k, top in enumerate(tops)}
    above = [number[owner[parents[top]]] if parents[top] >= 0 else -1 for top in tops]
    return Fronts(order=scalar, fronts=_placed(spans, above, place_of[rows], place_of[columns]))


def _strung(starts: Indices, counts: Indices) -> Indices:
    """The ranges of ``counts`` numbers from ``starts``, one after the other."""
    ends = np.cumsum(counts)
    return np.arange(counts.sum()) + np.repeat(starts - ends + counts, counts)


def _eliminated(left: Indices, right: Indices, order: Indices) -> tuple[list[set[int]], list[int]]:
    """For each place in the order the places below it in the factor, and the first of them (-1: none)."""
    count = len(order)
    place = np.empty(count, dtype=np.int64)
    place[order] = np.arange(count)
    low, high = np.minimum(place[left], place[right]), np.maximum(place[left], place[right])
    codes = distinct(low[low != high] * count + high[low != high])
    low, high = np.divmod(codes, count)
    cuts = np.searchsorted(low, np.arange(count + 1))
    targets = high.tolist()
    below: list[set[int]] = []
    parents = [-1] * count
    children: list[list[int]] = [[] for _ in range(count)]
    for j in range(count):
        found = set(targets[cuts[j] : cuts[j + 1]])
        for child in children[j]:
            found |= below[child]
        found.discard(j)
        below.append(found)
        if found:
            parents[j] = min(found)
            children[parents[j]].append(j)
    return below, parents


def _joined(below: list[set[int]], parents: list[int], sizes: Indices) -> tuple[list[int], list[int]]:
    """The places that stay as tops of fronts, ascending, and for each place the top of the front that it is in."""
    count = len(parents)
    width = sizes.astype(np.float64).tolist()
    size = sizes.tolist()
    rest = [float(sum(map(size.__getitem__, each))) for each in below]
    zeros = [0.0] * count
    into = list(range(count))
    children: list[list[int]] = [[] for _ in range(count)]
    for j in range(count):
        for child in sorted(children[j], key=lambda c: -rest[c]):
            wide = width[j] + width[child]
            holes = zeros[j] + zeros[child] + width[child] * (width[j] + rest[j] - rest[child])
            allowed = next(share for limit, share in RELAXED if wide <= limit)
            if holes <= allowed * wide * ((wide + 1) / 2 + rest[j]):
                into[child] = j
                width[j], zeros[j] = wide, holes
        if parents[j] >= 0:
            children[parents[j]].append(j)
    owner = list(range(count))
    for j in range(count - 1, -1, -1):
        owner[j] = j if into[j] == j else owner[into[j]]
    return [j for j in range(count) if into[j] == j], owner


def _postordered(tops: list[int], above: list[int]) -> list[int]:
    """The tops so that each stands behind all below it in the tree, and these stand together; ``above`` them: -1."""
    children: dict[int, list[int]] = {top: [] for top in (-1, *tops)}
    for top, parent in zip(tops, above, strict=True):
        children[parent].append(top)
    found: list[int] = []
    open_ones = list(children[-1])
    while open_ones:
        found.append(open_ones.pop())
        open_ones.extend(children[found[-1]])
    return found[::-1]


def _placed(spans: list[tuple[int, Indices]], above: list[int], rows: Indices, columns: Indices) -> tuple[Front, ...]:
    """The fronts with the places of the matrix's entries in them."""
    low, high = np.minimum(rows, columns), np.maximum(rows, columns)
    firsts = np.array([span[0] for _, span in spans])
    owner = np.searchsorted(firsts, low, side="right") - 1
    order = np.argsort(owner, kind="stable")
    cuts = np.searchsorted(owner[order], np.arange(len(spans) + 1))
    found = []
    for k, (width, span) in enumerate(spans):
        source = order[cuts[k] : cuts[k + 1]]
        target = np.searchsorted(span, high[source]) * len(span) + low[source] - span[0]
        parent = above[k]
        into = np.searchsorted(spans[parent][1], span[width:]) if parent >= 0 else np.empty(0, dtype=np.int64)
        front = Front(width=width, rows=span, parent=parent, into=into, source=source, target=target)
        found.append(front)
    return tuple(found)


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

    def spans(self) -> list[tuple[Indices, int]]:
        """The rows of each front, its own ones first, and how many these are."""
        table, rows = (np.asarray(each, dtype=np.int64) for each in self.held[:2])
        begins, sizes, widths = table[:, of.Front.rows_at], table[:, of.Front.size], table[:, of.Front.width]
        return [(rows[b : b + s], int(w)) for b, s, w in zip(begins, sizes, widths, strict=True)]


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

    def pivots(self) -> Floats:
        """The diagonal of ``R`` by the matrix's columns (n,)."""
        table = np.asarray(self.fronts.held[0], dtype=np.int64)
        begins, sizes, widths = table[:, of.Front.panel_at], table[:, of.Front.size], table[:, of.Front.width]
        steps = np.arange(int(widths.sum())) - np.repeat(np.cumsum(widths) - widths, widths)
        result = np.empty(len(steps))
        result[self.fronts.order] = self.panels[np.repeat(begins, widths) + steps * (np.repeat(sizes, widths) + 1)]
        return result

    def inverse(self, entries: int) -> Floats:
        """The elements of the inverse at the ``entries`` entries of the matrix."""
        own, result = self.fronts, np.empty(entries)
        own.routines.call("inverse_fronts", own.tree, self.panels, np.empty(own.path), result)
        return result


def minimum_degree(made: Routines, left: Indices, right: Indices, sizes: Indices) -> Indices:
    """The elimination order of a graph (`mbm.sparse.blocks.ordering`), as `fronts.Ordering` has it."""
    count, columns = len(sizes), int(sizes.sum())
    codes = distinct(np.concatenate([left * count + right, right * count + left]))
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
