"""The symbolic half of sparse Cholesky: an elimination order, and the dense fronts it leads to.

Columns come in blocks (members of families), which are ordered and eliminated whole. Fronts and their tree: Duff and
Reid (1983), Liu (1992); small ones are joined to their parents, because a front costs the same whether it is 3 or 30
columns wide.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from mbm.equations.types import Indices
from mbm.values import dataclass

RELAXED = ((32, 0.8), (96, 0.3), (1 << 40, 0.05))
"""Share of zeros that a front may hold after joining its child, by its number of columns (as CHOLMOD does)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front:
    """Columns ``first … first + width`` of the permuted matrix and the ``rows`` (their own ones first, ascending).

    ``parent`` is the front that takes over the rest of the rows (-1: none is left), at its rows ``into``. Entries
    ``source`` of the matrix go to the flat places ``target`` in the front's lower triangle.
    """

    first: int
    width: int
    rows: Indices
    parent: int
    into: Indices
    source: Indices
    target: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fronts:
    """``order`` (n,): the column that stands at each place of the permuted matrix; ``fronts`` are in postorder."""

    size: int
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
    scalar = np.concatenate([np.arange(first[b], first[b + 1]) for b in order[sequence]])
    place_of = np.empty(len(scalar), dtype=np.int64)
    place_of[scalar] = np.arange(len(scalar))
    start = np.empty(len(sizes), dtype=np.int64)
    start[sequence] = np.concatenate([[0], np.cumsum(sizes[order[sequence]])[:-1]])
    counts = sizes[order]
    spans = []
    for top in tops:
        inside = [np.arange(start[p], start[p] + counts[p]) for p in owned[top]]
        outside = [np.arange(start[p], start[p] + counts[p]) for p in below[top]]
        own = np.concatenate(inside)
        rest = np.sort(np.concatenate(outside)) if outside else np.empty(0, dtype=np.int64)
        spans.append((len(own), np.concatenate([own, rest])))
    number = {top: k for k, top in enumerate(tops)}
    above = [number[owner[parents[top]]] if parents[top] >= 0 else -1 for top in tops]
    return Fronts(size=len(scalar), order=scalar, fronts=_placed(spans, above, place_of[rows], place_of[columns]))


def _eliminated(left: Indices, right: Indices, order: Indices) -> tuple[list[set[int]], list[int]]:
    """For each place in the order the places below it in the factor, and the first of them (-1: none)."""
    count = len(order)
    place = np.empty(count, dtype=np.int64)
    place[order] = np.arange(count)
    low, high = np.minimum(place[left], place[right]), np.maximum(place[left], place[right])
    codes = np.unique(low[low != high] * count + high[low != high])
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
    rest = [float(sum(size[p] for p in each)) for each in below]
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
        front = Front(
            first=int(span[0]), width=width, rows=span, parent=parent, into=into, source=source, target=target
        )
        found.append(front)
    return tuple(found)
