"""Branch and bound: boxes are bisected and contracted until they are small, or cannot reach beyond what is attained."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals import extremes, points
from mbm.estimation.intervals.arithmetic import PI_HIGH, UNIT, Floats
from mbm.estimation.intervals.contraction import Boxes, contracted, joined
from mbm.estimation.intervals.extremes import Probe, Reach
from mbm.estimation.intervals.network import Network, Ranges
from mbm.values import dataclass

BISECTED_TOGETHER = 256
"""Boxes that are bisected together."""

APART = 1024
"""Boxes that are left, at least, before the search follows bounds only: parts of the set are told apart by then."""

MOST_PARTS = 8
"""Parts of the set whose bounds are followed one by one; of more, those of all together."""

SHRINK = 0.1
"""Sweeps of bisected boxes go on while one takes this part of a side: bisection does the rest."""

FINEST = 1 / 4096
"""Widths, as a part of those asked for, down to which boxes are bisected for the exact hull."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aims:
    """What is asked of a search: ``widths`` (N,) of boxes, ``tolerances`` (Q,) of bounds, ``limit`` of boxes.

    ``finest`` is the part of the widths down to which boxes are bisected whose bounds are not attained; tolerances are
    at most the ``part`` of what each scalar attains.
    """

    widths: Floats
    tolerances: Floats
    limit: int
    finest: float
    part: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Paving:
    """Boxes that cover the set; ``examined`` there were, ``reached`` says whether all are as was asked."""

    boxes: Boxes
    examined: int
    reached: bool


@np.errstate(all="ignore")  # infinite values and undefined slopes are results here
def paved(network: Network, first: Boxes, aims: Aims, stopped: Callable[[], bool]) -> Paving:
    """The set within the ``first`` box (1, N), which is contracted."""
    searching = _Search(network, first, aims, stopped)
    left, done = searching.spread(first)
    if len(left) and searching.examined < aims.limit:
        every = joined([left, done])
        labels = components(every, network.full_turn)
        parts = labels.max() + 1 if labels.max() < MOST_PARTS else 1
        ended = []
        for part in range(parts):
            own = labels == part if parts > 1 else np.ones(len(every), dtype=bool)
            ended.append(searching.followed(every.at(own), parts - part))
        return Paving(boxes=joined(ended), examined=searching.examined, reached=searching.reached)
    return Paving(boxes=joined([left, done]), examined=searching.examined, reached=not len(left))


class _Search:
    """Counts boxes. Local to one search."""

    def __init__(self, network: Network, first: Boxes, aims: Aims, stopped: Callable[[], bool]) -> None:
        self.network, self.aims, self._stopped = network, aims, stopped
        self.examined = 1
        self.reached = True
        self._probe = Probe.of(network, first)
        self._moving = np.isfinite(aims.widths) & (aims.widths > 0.0)

    def spread(self, first: Boxes) -> tuple[Boxes, Boxes]:
        """The set in boxes bisected evenly: those to go on with, and those that are done."""
        left, fine, done = first, [first.at(np.zeros(1, dtype=bool))], [first.at(np.zeros(1, dtype=bool))]
        while len(left):
            small = self._small(left, 1.0)
            certain = points.values(self.network, left.low, left.high).sure
            fine.append(left.at(small & ~certain))
            done.append(left.at(certain))
            left = left.at(~small & ~certain)
            examined = self.examined + 2 * len(left)
            if not len(left) or 2 * len(left) + sum(map(len, fine)) > APART or examined > self.aims.limit:
                break
            left = self._halves(left)
        if self.aims.finest == 1.0:
            return left, joined([*fine, *done])
        return joined([left, *fine]), joined(done)

    def followed(self, boxes: Boxes, parts: int) -> Boxes:
        """A part of the set: boxes that may reach beyond what is attained are bisected, those that may most first."""
        aims, network = self.aims, self.network
        until = self.examined + max((aims.limit - self.examined) // parts, 0)
        reach = Reach.nowhere(len(aims.tolerances), len(network.low))
        reach = extremes.probed(self._probe, reach, _middles(boxes))
        low, high = boxes.low.min(axis=0), boxes.high.max(axis=0)
        reach = extremes.extended(self._probe, reach, low, high, aims.tolerances)
        tolerances = aims.tolerances
        if reach.known and np.isfinite(aims.part):
            extent = np.maximum(aims.part * (reach.high - reach.low), aims.finest * tolerances)
            tolerances = np.minimum(tolerances, extent)
        done: list[Boxes] = []
        while len(boxes):
            beyond = self._beyond(boxes, reach, tolerances)
            open_ = (beyond > 1.0) & ~self._small(boxes, aims.finest)
            if not bool(open_.all()):
                done.append(boxes.at(~open_))
                boxes, beyond = boxes.at(open_), beyond[open_]
            if not len(boxes):
                break
            if self.examined + 2 * min(BISECTED_TOGETHER, len(boxes)) > until or self._stopped():
                self.reached = False
                done.append(boxes)
                break
            order = np.argsort(-beyond, kind="stable")
            halves = self._halves(boxes.at(np.sort(order[:BISECTED_TOGETHER])))
            reach = extremes.probed(self._probe, reach, _middles(halves))
            boxes = joined([boxes.at(np.sort(order[BISECTED_TOGETHER:])), halves])
        return joined(done) if done else boxes

    def _beyond(self, boxes: Boxes, reach: Reach, tolerances: Floats) -> Floats:
        """By how many tolerances a box may reach beyond what is attained (n,); its size where nothing is."""
        sizes = ((boxes.high - boxes.low)[:, self._moving] / self.aims.widths[self._moving]).max(axis=1, initial=0.0)
        if not reach.known:
            return np.asarray(sizes + 1.0)
        low, high = extremes.scalars_of(self.network, boxes.low, boxes.high, (boxes.derived_low, boxes.derived_high))
        counting = np.isfinite(tolerances) & (tolerances > 0.0)
        below = (reach.low[counting] - low[:, counting]) / tolerances[counting]
        above = (high[:, counting] - reach.high[counting]) / tolerances[counting]
        return np.asarray(np.maximum(below, above).max(axis=1, initial=0.0))

    def _small(self, boxes: Boxes, part: float) -> Mask:
        widths = self.aims.widths[self._moving] * part
        sides = (boxes.high - boxes.low)[:, self._moving]
        middle = (boxes.low + boxes.high)[:, self._moving] / 2
        point = (middle <= boxes.low[:, self._moving]) | (middle >= boxes.high[:, self._moving])
        return np.asarray(((sides <= widths) | point).all(axis=1))

    def _halves(self, boxes: Boxes) -> Boxes:
        """The halves of boxes, across the side that is widest beside what is asked, contracted."""
        sizes = np.where(self._moving, (boxes.high - boxes.low) / np.where(self._moving, self.aims.widths, 1.0), -1.0)
        side: Indices = np.argmax(sizes, axis=1)
        every = np.arange(len(boxes))
        middle = boxes.low[every, side] / 2 + boxes.high[every, side] / 2
        low, high = np.concatenate([boxes.low, boxes.low]), np.concatenate([boxes.high, boxes.high])
        high[every, side] = middle
        low[len(boxes) + every, side] = middle
        self.examined += len(low)
        return contracted(self.network, low, high, shrink=SHRINK)


def _middles(boxes: Boxes) -> Floats:
    return np.clip(boxes.low / 2 + boxes.high / 2, boxes.low, boxes.high)


TURN = 2 * np.pi

ROUNDED = 64 * UNIT
"""What adding whole turns, a few, may be off by."""

TOGETHER_COMPARED = 64
"""Boxes whose neighbours are looked for together; those found are not looked for again."""

TOUCHING = 1e-12
"""Gaps, as a part of all boxes' extent, that bisection cannot have made: contraction leaves them by rounding."""


def components(boxes: Boxes, full_turn: Mask) -> Indices:
    """The number of the part (n,) that each box belongs to: boxes that touch are one. ``full_turn`` (N,) wrap."""
    count = len(boxes)
    labels = np.full(count, -1, dtype=np.int64)
    size = boxes.high.max(axis=0) - boxes.low.min(axis=0)
    slack = np.where(np.isfinite(size), TOUCHING * size, 0.0)
    moving = np.flatnonzero((size > 0.0) | full_turn)
    low, high = (boxes.low - slack)[:, moving], (boxes.high + slack)[:, moving]
    turning = np.flatnonzero(full_turn[moving])
    rest, label = np.arange(count), 0
    while len(rest):
        labels[rest[0]] = label
        frontier, rest = rest[:1], rest[1:]
        while len(frontier):
            some, frontier = frontier[:TOGETHER_COMPARED], frontier[TOGETHER_COMPARED:]
            touched = _touching(low, high, turning, some, rest)
            labels[rest[touched]] = label
            frontier, rest = np.concatenate([frontier, rest[touched]]), rest[~touched]
        label += 1
    return labels


def _touching(low: Floats, high: Floats, turning: Indices, some: Indices, rest: Indices) -> Mask:
    """Which of the ``rest`` (n,) touch one of ``some``."""
    meet = np.ones((len(some), len(rest)), dtype=bool)
    for column in range(low.shape[1]):
        a = low[some, column][:, None], high[some, column][:, None]
        b = low[rest, column][None], high[rest, column][None]
        turns = (-TURN, 0.0, TURN) if column in turning else (0.0,)
        each = [(a[0] <= b[1] + turn) & (a[1] >= b[0] + turn) for turn in turns]
        meet &= np.logical_or.reduce(each)
    return np.asarray(meet.any(axis=0))


def ranges(boxes: Boxes, full_turn: Mask, turning: Mask) -> Ranges:
    """The bounds of boxes; ``turning`` (Q,) are derived angles, which are reported in one turn as full ones are."""
    low, high = boxes.low.min(axis=0), boxes.high.max(axis=0)
    derived_low, derived_high = boxes.derived_low.min(axis=0), boxes.derived_high.max(axis=0)
    for place in np.flatnonzero(full_turn):
        low[place], high[place] = arc(boxes.low[:, place], boxes.high[:, place])
    for place in np.flatnonzero(turning):
        derived_low[place], derived_high[place] = arc(boxes.derived_low[:, place], boxes.derived_high[:, place])
    return Ranges(low=low, high=high, derived_low=derived_low, derived_high=derived_high)


def arc(low: Floats, high: Floats) -> tuple[float, float]:
    """The shortest arc that holds intervals (n,) of angles, its middle in (−π, π]; one turn where they cover it."""
    first, last = float(low.min()), float(high.max())
    if not float((high - low).max()) < TURN:
        return (first, last) if last - first < 2 * TURN else (-PI_HIGH, PI_HIGH)
    begin = np.mod(low, TURN)
    order = np.argsort(begin, kind="stable")
    begin, end = begin[order], (begin + (high - low))[order]
    reached = np.maximum.accumulate(end)
    gaps = np.append(begin[1:], begin[0] + TURN) - np.maximum(reached, reached[-1] - TURN)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= 0.0:
        return (first, last) if last - first < TURN else (-PI_HIGH, PI_HIGH)
    if last - first > TURN - gaps[widest] + TOUCHING:  # over the cut the arc is shorter
        first = float(begin[(widest + 1) % len(begin)]) - ROUNDED
        last = first + TURN - float(gaps[widest]) + 2 * ROUNDED
    turns = float(np.ceil((first / 2 + last / 2 - np.pi) / TURN))
    error = abs(turns) * ROUNDED
    return first - turns * TURN - error, last - turns * TURN + error
