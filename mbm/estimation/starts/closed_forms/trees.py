"""Members of a family that rows relate, and trees that span them along measured edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices, Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def behind_one_another(entry: Entry, first: Indices, second: Indices) -> Mask:
    """Which edges (m,) join members that are neighbours in the order of their keys; none where keys are texts."""
    rank = ranks(entry)
    return np.zeros(len(first), dtype=bool) if rank is None else np.asarray(np.abs(rank[first] - rank[second]) == 1)


def ranks(entry: Entry) -> Indices | None:
    """The places (members,) of the members in the order of their keys; None where keys are texts."""
    keys = entry.keys or ()
    if not keys or any(isinstance(key, str) for key in keys):
        return None
    rank = np.empty(len(keys), dtype=np.int64)
    rank[np.argsort(np.asarray(keys, dtype=np.float64), kind="stable")] = np.arange(len(keys))
    return rank


def foremost_edges(members: int, first: Indices, second: Indices, later: Floats) -> Indices:
    """Edges of a spanning forest (Kruskal 1956), those with the least ``later`` (m,) before all others."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    order = np.argsort(later, kind="stable")
    order = order[(first != second)[order]]
    low, high = np.minimum(first, second)[order], np.maximum(first, second)[order]
    codes, foremost = np.unique(low * members + high, return_index=True)
    tree = minimum_spanning_tree(_graph(members, codes, 1.0 + foremost.astype(np.float64)))
    return np.sort(order[tree.data.astype(np.int64) - 1])


def shortest_ways(members: int, first: Indices, second: Indices, known: Indices) -> tuple[Indices, Indices]:
    """Along edges, k from ``first`` to ``second`` and n + k back, to all members that are reached from those known.

    For each member the one before it (-1: it is known, or not reached) and the edge from there, the shortest ways.
    """
    from scipy.sparse.csgraph import breadth_first_order

    size, begins = members + 1, np.full(len(known), members)  # one more member, from which those known are reached
    tails, heads = np.concatenate([first, second, begins]), np.concatenate([second, first, known])
    codes, foremost = np.unique(tails * size + heads, return_index=True)
    before = breadth_first_order(_graph(size, codes, np.ones(len(codes))), members)[1][:members].astype(np.int64)
    reached = (before >= 0) & (before < members)
    edge = foremost[np.searchsorted(codes, before * size + np.arange(members)) * reached]
    return np.where(reached, before, -1), np.where(reached, edge, -1)


def _graph(members: int, codes: Indices, weights: Floats) -> csr_array:
    """Edges from one member to another by their ascending ``codes``."""
    from scipy.sparse import csr_array

    return csr_array((weights, np.divmod(codes, members)), shape=(members, members))


def related(group: Group, entry: Entry) -> tuple[Indices, Indices]:
    """The two members (rows,) that each row of a group relates."""
    first: dict[object, int] = {}
    for j, slot in enumerate(group.kernel.variables):
        if slot.unknown == entry.unknown.name:
            first.setdefault(slot.member, j)
    one, other = ((group.index[:, j] - entry.offset) // entry.unknown.size for j in first.values())
    return one, other
