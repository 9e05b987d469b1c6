"""Trees that span the members of a family along measured edges."""

from __future__ import annotations

from collections import deque

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask


def behind_one_another(entry: Entry, first: Indices, second: Indices) -> Mask:
    """Which edges (m,) join members that are neighbours in the order of their keys; none where keys are texts."""
    keys = entry.keys or ()
    if not keys or any(isinstance(key, str) for key in keys):
        return np.zeros(len(first), dtype=bool)
    rank = np.empty(len(keys), dtype=np.int64)
    rank[np.argsort(np.asarray(keys, dtype=np.float64), kind="stable")] = np.arange(len(keys))
    return np.asarray(np.abs(rank[first] - rank[second]) == 1)


def foremost_edges(members: int, first: Indices, second: Indices, later: Floats) -> Indices:
    """Edges of a spanning forest (Kruskal 1956), those with the least ``later`` (m,) before all others."""
    above = list(range(members))

    def top(number: int) -> int:
        while above[number] != number:
            above[number] = above[above[number]]
            number = above[number]
        return number

    kept = []
    for k in np.argsort(later, kind="stable").tolist():
        a, b = top(int(first[k])), top(int(second[k]))
        if a != b:
            above[b] = a
            kept.append(k)
    return np.array(sorted(kept), dtype=np.int64)


def shortest_ways(members: int, first: Indices, second: Indices, known: Indices) -> tuple[Indices, Indices]:
    """Along edges, k from ``first`` to ``second`` and n + k back, to all members that are reached from those known.

    For each member the one before it (-1: it is known, or not reached) and the edge from there, the shortest ways.
    """
    neighbours: list[list[tuple[int, int]]] = [[] for _ in range(members)]
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        neighbours[a].append((b, k))
        neighbours[b].append((a, len(first) + k))
    parent = [-1] * members
    edge = [-1] * members
    met = [False] * members
    waiting = deque(known.tolist())
    for here in waiting:
        met[here] = True
    while waiting:
        here = waiting.popleft()
        for there, k in neighbours[here]:
            if not met[there]:
                met[there], parent[there], edge[there] = True, here, k
                waiting.append(there)
    return np.array(parent, dtype=np.int64), np.array(edge, dtype=np.int64)
