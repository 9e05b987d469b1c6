"""Times of two tables against one another: which rows belong together, and where a time falls between rows."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from mbm.problem.tables import Numbers
from mbm.values import dataclass

Positions = NDArray[np.int64]


def usual_tolerance(a: Numbers, b: Numbers) -> float:
    """Half the median distance of neighbouring times in the denser of two tables (n,), (m,).

    At this distance a time is as near to one row of the denser table as to the next. 0 where no table has two different
    times: only equal ones are then taken together.
    """
    medians = []
    for times in (a, b):
        steps = np.diff(np.unique(times))
        if steps.size:
            medians.append(float(np.median(steps)))
    return min(medians) / 2 if medians else 0.0


def associated(a: Numbers, b: Numbers, tolerance: float) -> tuple[Positions, Positions]:
    """Positions in ``a`` (n,) and ``b`` (m,) of rows that belong together, in the order of ``a``.

    The two times that are nearest to one another are taken first, then the nearest two of those left, as long as they
    differ by no more than ``tolerance``: each row is used once. This is the association of the TUM benchmark's tools
    (Sturm and others 2012); equal distances go to the earlier times.

    The nearest two always stand side by side among all times in order, so a queue of neighbours suffices.
    """
    times = np.concatenate([a, b])
    order = np.lexsort((np.arange(len(times)), times))
    sorted_times = times[order].tolist()
    first = (order < len(a)).tolist()
    before = list(range(-1, len(times) - 1))
    after = list(range(1, len(times) + 1))
    slack = 4 * np.finfo(np.float64).eps * float(np.abs(times).max(initial=0.0))

    def distance(left: int) -> tuple[float, int, int]:
        right = after[left]
        return (sorted_times[right] - sorted_times[left], left, right)

    queue = [distance(i) for i in range(len(times) - 1) if first[i] != first[i + 1]]
    heapq.heapify(queue)
    used = [False] * len(times)
    pairs = []
    while queue:
        gap, left, right = heapq.heappop(queue)
        if gap > tolerance + slack:
            break
        if used[left] or used[right]:
            continue
        used[left] = used[right] = True
        pairs.append((left, right) if first[left] else (right, left))
        outer, next_outer = before[left], after[right]
        if outer >= 0:
            after[outer] = next_outer
        if next_outer < len(times):
            before[next_outer] = outer
        if outer >= 0 and next_outer < len(times) and first[outer] != first[next_outer]:
            heapq.heappush(queue, distance(outer))
    found = np.array([(order[i], order[j] - len(a)) for i, j in pairs], dtype=np.int64).reshape(-1, 2)
    found = found[np.argsort(found[:, 0], kind="stable")]
    return found[:, 0], found[:, 1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Between:
    """Where times fall between nodes: ``inside`` (n,) says which do.

    For those ``earlier``, ``later`` (k,) are the positions of the nodes before and after in the table as it stands, and
    ``fraction`` (k,) how far on the way from one to the other.
    """

    inside: NDArray[np.bool_]
    earlier: Positions
    later: Positions
    fraction: Numbers


def between(times: Numbers, nodes: Numbers) -> Between:
    """Where ``times`` (n,) fall between ``nodes`` (m,), all different, in any order."""
    order = np.argsort(nodes, kind="stable")
    ordered = nodes[order]
    if len(ordered) == 0:
        none = np.empty(0, dtype=np.int64)
        return Between(inside=np.zeros(len(times), dtype=bool), earlier=none, later=none, fraction=np.empty(0))
    inside = (times >= ordered[0]) & (times <= ordered[-1])
    within = times[inside]
    place = np.clip(np.searchsorted(ordered, within, side="right") - 1, 0, max(len(ordered) - 2, 0))
    follows = np.minimum(place + 1, len(ordered) - 1)
    width = ordered[follows] - ordered[place]
    fraction = np.where(width > 0, (within - ordered[place]) / np.where(width > 0, width, 1.0), 0.0)
    return Between(inside=inside, earlier=order[place], later=order[follows], fraction=fraction)
