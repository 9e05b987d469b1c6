"""Jacobian → the factors of its normal equations without forming them: orthogonal triangularisation by fronts.

``JᵀJ`` has the square of the Jacobian's condition: what J knows a hundred million times less well than the rest is lost
in its rounding. The triangle of J has all of it (multifrontal QR: Matstoms 1994). It takes the fronts of the Cholesky
factor, and tens of times as long: it is for equations whose normal ones are no good.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.sparse.frontal import FrontFactor
from mbm.sparse.structure import Values
from mbm.sparse.system import Factorised, Plan
from mbm.values import dataclass

PART = 512
"""Rows that are triangularised together: they stay in the cache, where tall matrices do not."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Node:
    """The first ``width`` of its ``columns`` (places in the order of elimination) are eliminated here."""

    columns: Indices
    width: int


def triangularised(found: Plan, values: Values, added: Floats, rows: Any = None) -> Factorised | None:
    """Factors of ``JᵀJ`` with ``added`` (columns,) on its diagonal; None where a pivot is nothing at all.

    ``rows`` (SciPy's sparse array, k × columns) stand below those of J.
    """
    from scipy.sparse import csr_array, diags_array, vstack

    place, nodes = _order(found)
    held = np.flatnonzero(added > 0.0)
    pinned = csr_array(diags_array(np.sqrt(added)))[held]
    below = [pinned] if rows is None else [pinned, rows]
    whole = csr_array(vstack([found.structure.matrix(values), *below]))
    panels = _panels(nodes, place[whole.indices], whole.data, np.diff(whole.indptr))
    if panels is None:
        return None
    gone = found.elimination
    members = 0 if gone is None else len(gone.links.lengths)
    rest: FrontFactor | Floats | None = None
    if found.fronts is not None:
        rest = FrontFactor(fronts=found.fronts, panels=np.concatenate([p.reshape(-1) for p in panels[members:]]))
    elif found.width:
        rest = np.ascontiguousarray(panels[members].T)
    else:
        rest = np.zeros((0, 0))
    if gone is None:
        return Factorised(plan=found, roots=None, y=None, rest=rest)
    own = np.stack([panel[:, : gone.size] for panel in panels[:members]])
    roots = np.linalg.inv(own.transpose(0, 2, 1))
    y = np.concatenate([panel[:, gone.size :].reshape(-1) for panel in panels[:members]])
    return Factorised(plan=found, roots=np.ascontiguousarray(roots), y=y, rest=rest)


def _order(found: Plan) -> tuple[Indices, list[_Node]]:
    """The place of each padded column in the order of elimination, and the nodes in that order."""
    gone, solver = found.elimination, found.fronts
    place = np.empty(found.structure.columns, dtype=np.int64)
    nodes, first = [], 0
    order = np.arange(found.width) if solver is None else solver.order
    inner = np.empty(found.width, dtype=np.int64)
    inner[order] = np.arange(found.width)
    if gone is not None:
        links, family = gone.links, found.structure.families[gone.family]
        first = family.members * family.size
        place[family.columns] = np.arange(first)
        for m in range(family.members):
            span = slice(links.begins[m], links.begins[m + 1])
            steps = [np.arange(c, c + w) for c, w in zip(links.columns[span], links.wides[span], strict=True)]
            below = first + inner[np.concatenate(steps)] if steps else np.empty(0, dtype=np.int64)
            own = m * gone.size + np.arange(gone.size)
            nodes.append(_Node(columns=np.concatenate([own, below]), width=gone.size))
    place[found.columns] = first + inner
    if solver is not None:
        nodes += [_Node(columns=first + rows, width=width) for rows, width in solver.spans()]
    elif found.width:
        nodes.append(_Node(columns=first + order, width=found.width))
    return place, nodes


def _panels(nodes: list[_Node], columns: Indices, data: Floats, counts: Indices) -> list[Floats] | None:
    """The rows of the triangle at each node, from the rows of a matrix with ``counts`` entries each."""
    counts = counts[counts > 0]
    starts = np.cumsum(counts) - counts
    begins = np.cumsum([0, *(node.width for node in nodes)])
    owners = np.searchsorted(begins, np.minimum.reduceat(columns, starts), side="right") - 1
    waiting: list[list[tuple[Indices, Floats]]] = [[] for _ in nodes]
    order = np.argsort(owners, kind="stable")
    cuts = np.searchsorted(owners[order], np.arange(len(nodes) + 1))
    where = np.zeros(begins[-1], dtype=np.int64)
    found = []
    for k, node in enumerate(nodes):
        where[node.columns] = np.arange(len(node.columns))
        triangle = np.concatenate([np.zeros((0, len(node.columns))), *_laid(waiting[k], where, len(node.columns))])
        step = max(PART, 2 * len(node.columns))
        for first in range(cuts[k], max(cuts[k + 1], cuts[k] + 1), step):
            chosen = order[first : min(first + step, cuts[k + 1])]
            entries = np.repeat(starts[chosen] - np.cumsum(counts[chosen]) + counts[chosen], counts[chosen])
            entries += np.arange(len(entries))
            own = np.zeros((len(chosen), len(node.columns)))
            np.add.at(own, (np.repeat(np.arange(len(chosen)), counts[chosen]), where[columns[entries]]), data[entries])
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, own]), mode="r"), dtype=np.float64)
        waiting[k] = []
        pivots = np.diagonal(triangle)[: node.width]
        if len(pivots) < node.width or not bool((np.isfinite(pivots) & (pivots != 0.0)).all()):
            return None
        found.append(triangle[: node.width] * np.sign(pivots)[:, None])
        below, rest = node.columns[node.width :], triangle[node.width :, node.width :]
        if len(below) and len(rest):
            waiting[int(np.searchsorted(begins, below.min(), side="right")) - 1].append((below, rest))
    return found


def _laid(waiting: list[tuple[Indices, Floats]], where: Indices, width: int) -> Iterator[Floats]:
    """What is left over from nodes before, in the columns of this one."""
    for columns, rest in waiting:
        own = np.zeros((len(rest), width))
        own[:, where[columns]] = rest
        yield own
