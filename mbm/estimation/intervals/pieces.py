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

MOST_PAIRS = 4_000_000
"""Pairs of boxes that are compared at a time."""

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
    label = 0
    for first in range(count):
        if labels[first] >= 0:
            continue
        labels[first] = label
        frontier = np.array([first])
        while len(frontier):
            rest = np.flatnonzero(labels < 0)
            found = _touching(low, high, turning, frontier, rest)
            labels[found] = label
            frontier = found
        label += 1
    return labels


def _touching(low: Floats, high: Floats, turning: Indices, frontier: Indices, rest: Indices) -> Indices:
    """Those of the ``rest`` that touch one of the ``frontier``."""
    touched = np.zeros(len(rest), dtype=bool)
    step = max(MOST_PAIRS // max(len(rest) * low.shape[1], 1), 1)
    plain = np.ones(low.shape[1], dtype=bool)
    plain[turning] = False
    for first in range(0, len(frontier), step):
        some = frontier[first : first + step, None]
        meet = (low[some][:, :, plain] <= high[rest][None][:, :, plain]).all(axis=2)
        meet &= (high[some][:, :, plain] >= low[rest][None][:, :, plain]).all(axis=2)
        for column in turning:
            a, b = (low[some, column], high[some, column]), (low[rest, column][None], high[rest, column][None])
            each = [(a[0] <= b[1] + turn) & (a[1] >= b[0] + turn) for turn in (-TURN, 0.0, TURN)]
            meet &= each[0] | each[1] | each[2]
        touched |= meet.any(axis=0)
    return rest[touched]


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
