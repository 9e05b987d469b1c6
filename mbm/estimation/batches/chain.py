"""Windows one after the other: each begins where the one before ended, if that is better than its own start.

All are solved from their own starts first, then from where those before them ended; only those behind a window whose
end this changed are solved again, until nothing changes. The answers are those of a solve of one window after the
other, though each round is one batch.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from mbm.equations.losses import rooted_residuals
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Ends, Solver
from mbm.estimation.search.multistart import DEVIATIONS
from mbm.estimation.settings import Settings
from mbm.values import dataclass

CHAIN_ROUNDS = 20
"""Rounds until windows whose ends still change are left to the general path."""

SAME_ENDS = 1e-6
"""Relative difference of two ends, in numbers and cost, that roundings and the tolerance of the offset explain."""

NOT_SOLVED = -2
"""In the place of the window before, for windows that are not solved."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Windows in their order.

    ``own`` (T, N) are their own starts, NaN where there is none; ``before`` (T,) is the number of the window before
    each that is solved at all, -1 where there is none, `NOT_SOLVED` for windows that are not solved. ``known``: no
    noise is estimated. ``blocks`` are the columns of `Ends.factors` (None: ends have none). ``places`` as
    `places_before` has them.
    """

    stack: Stack
    solve: Solver
    own: Floats
    before: Indices
    known: bool
    blocks: int | None
    places: Indices | None
    settings: Settings

    def ends(self) -> tuple[Ends, Floats]:
        """Where all windows end, and where they began (T, N); those for the general path have no reason."""
        live = np.flatnonzero(self.before != NOT_SOLVED)
        startable = np.asarray(np.isfinite(self.own).all(axis=1))
        first = live[startable[live]]
        alone = self._empty(self.stack.solves)
        _put(alone, first, self._solved(first, self.own[first]))
        found = _copied(alone)
        own_costs = np.full(self.stack.solves, np.inf)
        own_costs[first] = costs(self.stack, first, self.own[first])
        after = np.full(self.stack.solves, -1, dtype=np.int64)
        behind = live[self.before[live] >= 0]
        after[self.before[behind]] = behind
        carried = np.zeros(self.stack.solves, dtype=bool)
        began = self.own.copy()
        todo = behind
        for _ in range(CHAIN_ROUNDS):
            if not len(todo) or self.settings.stopped():
                break
            carried[todo], lost, points = self._carried(todo, found, own_costs)
            new = _some(alone, todo)
            mine = np.flatnonzero(carried[todo])
            _put(new, mine, self._solved(todo[mine], points[mine]))
            began[todo] = np.where(carried[todo, None], points, self.own[todo])
            new.reason[lost] = -1
            changed = ~_same(new, _some(found, todo))
            _put(found, todo, new)
            todo = after[todo[changed]]
            todo = todo[todo >= 0]
        found.reason[todo] = -1
        found.reason[behind[found.reason[self.before[behind]] < 0]] = -1
        return replace(found, given=carried), began

    def _carried(self, todo: Indices, found: Ends, own_costs: Floats) -> tuple[Mask, Mask, Floats]:
        """Which windows (K,) begin where the one before ended, which have no start at all, and those ends (K, N)."""
        before = self.before[todo]
        moving = self.stack.equations.moving()
        handed_on = found.points[before]
        if self.places is not None:
            places = self.places[todo]
            same = np.take_along_axis(handed_on, np.maximum(places, 0), axis=1)
            handed_on = np.where(places >= 0, same, self.own[todo])
        points = np.where(moving, handed_on, self.own[todo])
        usable = np.isfinite(found.cost[before]) & np.isfinite(points).all(axis=1)
        there = np.full(len(todo), np.inf)
        there[usable] = costs(self.stack, todo[usable], points[usable])
        freedom = self.stack.residuals[todo] - self.stack.equations.dimension
        most = freedom + DEVIATIONS * np.sqrt(2.0 * np.maximum(freedom, 0))
        expected = usable & self.known & (freedom > 0) & (found.reason[before] >= 0) & (there <= most)
        startable = np.isfinite(self.own[todo]).all(axis=1)
        lost = ~startable
        if self.stack.errors is not None:  # it takes a search to say what they cost
            lost |= np.isinf(there) | np.isinf(own_costs[todo])
        return expected | (usable & startable & (there < own_costs[todo])), ~expected & lost, points

    def _solved(self, which: Indices, points: Floats) -> Ends:
        """The ends of some windows, slice by slice, by several threads; those that were not made have no reason."""
        found = self._empty(len(which))

        def work(part: slice) -> None:
            if not self.settings.stopped():
                _put(found, part, self.solve(which[part], points[part]))

        parts = self.stack.slices(which)
        threads = min(self.settings.workers or os.cpu_count() or 1, len(parts))
        if threads <= 1:
            for part in parts:
                work(part)
            return found
        with ThreadPoolExecutor(max_workers=threads) as pool:
            list(pool.map(work, parts))
        return found

    def _empty(self, count: int) -> Ends:
        none = np.zeros(count, dtype=np.int64)
        limits = int(self.stack.limits.max(initial=0))
        return Ends(
            points=np.full((count, self.own.shape[1]), np.nan),
            cost=np.full(count, np.inf),
            reason=np.full(count, -1, dtype=np.int64),
            iterations=none,
            evaluations=none.copy(),
            held=np.zeros(count, dtype=bool),
            multipliers=np.zeros((count, limits)) if limits else None,
            factors=None if self.blocks is None else np.ones((count, self.blocks)),
        )


def places_before(stack: Stack, before: Indices) -> Indices | None:
    """Where the numbers of each window (T, N) stand in the point of the window before: members by their keys.

    -1 for members that are new. None where all stand at the same places.
    """
    if not stack.arranged.families:
        return None
    layout = stack.equations.layout
    found = np.tile(np.arange(len(layout.start)), (stack.solves, 1))
    for entry in layout.entries:
        family, size = entry.unknown.family, entry.unknown.size
        own = None if family is None else stack.arranged.families.get(family.rows)
        if own is not None:
            members = own.numbers(np.repeat(np.maximum(before, 0), entry.members), own.codes(own.keys))[:, None]
            places = np.where(members >= 0, entry.offset + members * size + np.arange(size), -1)
            found[:, entry.range] = places.reshape(stack.solves, entry.count)
    return found


@np.errstate(all="ignore")
def costs(stack: Stack, which: Indices, points: Floats) -> Floats:
    """``Σ r²`` (with losses ``Σ ρ``) of solves (K,) at points (K, N); infinite where it is not finite."""
    found = np.empty(len(which))
    for part in stack.slices(which):
        portion = Portion(stack, which[part])
        found[part] = np.square(rooted_residuals(portion.acting(), portion.residuals(points[part]))).sum(axis=1)
    return np.where(np.isfinite(found), found, np.inf)


FIELDS = ("points", "cost", "reason", "iterations", "evaluations", "held", "multipliers", "factors")
"""What is known of ends here; what consensus keeps is found again."""


def _fields(ends: Ends) -> dict[str, np.ndarray]:
    known = {name: getattr(ends, name) for name in FIELDS}
    return {name: each for name, each in known.items() if each is not None}


def _put(target: Ends, places: Indices | slice, found: Ends) -> None:
    other = _fields(found)
    for name, mine in _fields(target).items():
        mine[places] = other[name]


def _some(ends: Ends, places: Indices) -> Ends:
    """The ends at some places, as arrays of their own."""
    known: dict[str, Any] = {name: part[places] for name, part in _fields(ends).items()}
    return Ends(**known)


def _copied(ends: Ends) -> Ends:
    return _some(ends, np.arange(len(ends.cost)))


@np.errstate(all="ignore")
def _same(first: Ends, second: Ends) -> Mask:
    """Whether ends (K,) are the same but for roundings."""
    size = np.maximum(np.abs(first.points), np.abs(second.points))
    size += SAME_ENDS * size.max(axis=1, keepdims=True, initial=0.0)  # what is zero has no size of its own
    near = (np.abs(first.points - second.points) <= SAME_ENDS * size).all(axis=1)
    near &= np.abs(first.cost - second.cost) <= SAME_ENDS * (1.0 + first.cost)
    return np.asarray(near & ((first.reason >= 0) == (second.reason >= 0)))
