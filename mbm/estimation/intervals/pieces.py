"""Boxes → the separate parts of the set that they cover, and the bounds of each."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Indices, Mask
from mbm.estimation.intervals.arithmetic import PI_HIGH, UNIT, Floats
from mbm.estimation.intervals.contraction import Boxes
from mbm.estimation.intervals.types import Ranges

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
