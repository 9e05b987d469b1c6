"""Axes of pictures of space: three edges of the box around a model, with marks at round numbers. Where names and
numbers go in a picture, so that none covers another: each takes the first free place around it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from mbm.report.figures import round_step
from mbm.report.types import Floats
from mbm.report.view.viewpoint import View
from mbm.values import dataclass

WIDTH, HEIGHT = 0.62, 1.15
"""Of a character and of a line of text, in font sizes; taken a little large."""

_TURNS = np.deg2rad([45.0, 135.0, -45.0, -135.0, 90.0, -90.0, 0.0, 180.0])
_REACHES = (1.0, 1.6, 2.4)
"""How far the middle of a text may be from its place, in font sizes beside half of its own extent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wanted:
    """A text that belongs to ``at`` (2,), in points of the picture; ``away`` (2,) is the side it would best be on.

    ``centred``: the place itself is the best.
    """

    text: str
    at: Floats
    size: float
    away: Floats | None = None
    centred: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placed:
    """A text with its middle (2,), in points of the picture; ``number`` is its place among those that were wanted."""

    number: int
    at: Floats


def placed(wanted: Sequence[Wanted], frame: tuple[Floats, Floats], taken: Iterable[Floats] = ()) -> tuple[Placed, ...]:
    """The texts that have room, in their order: the first are the most important.

    Args:
        wanted: what is to be written.
        frame: the least and greatest coordinates, each (2,).
        taken: rectangles (4,) of left, bottom, right, top that nothing may cover.

    """
    boxes = np.array([*taken]).reshape(-1, 4)
    found = []
    for number, each in enumerate(wanted):
        half = np.array([WIDTH * len(each.text), HEIGHT]) * each.size / 2
        for middle in _places(each, half):
            box = np.concatenate([middle - half, middle + half])
            if (box[:2] < frame[0]).any() or (box[2:] > frame[1]).any():
                continue
            clash = (boxes[:, :2] < box[2:]).all(axis=1) & (boxes[:, 2:] > box[:2]).all(axis=1)
            if not clash.any():
                boxes = np.vstack([boxes, box])
                found.append(Placed(number=number, at=middle))
                break
    return tuple(found)


def _places(each: Wanted, half: Floats) -> Iterable[Floats]:
    """Middles that a text may have, the best first."""
    if each.centred:
        yield each.at
    turns = _TURNS
    if each.away is not None and bool(np.any(each.away)):
        best = np.arctan2(each.away[1], each.away[0])
        turns = turns[np.argsort(-np.cos(turns - best), kind="stable")]
    for reach in _REACHES:
        for turn in turns:
            way = np.array([np.cos(turn), np.sin(turn)])
            yield each.at + way * (half + (reach - 0.5) * each.size)


MARKS = 4
"""Marks on the longest axis, about."""

GAP = 0.1
"""From the box to its axes, as a share of its greatest extent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ruler:
    """An axis in space: from ``start`` to ``end`` (3,), with ``marks`` (position (3,), text), called ``name``.

    ``upright``: it is seen upright.
    """

    name: str
    start: Floats
    end: Floats
    marks: tuple[tuple[Floats, str], ...]
    upright: bool


def rulers(lo: Floats, hi: Floats, view: View, unit: str) -> tuple[Ruler, ...]:
    """The axes beside the box from ``lo`` to ``hi`` (3,), where they cover none of it; flat ones are left out."""
    extent = hi - lo
    size = float(extent.max())
    if size <= 0.0:
        return ()
    step = round_step(size / MARKS)
    scale, shown = (1e-3, "mm") if unit == "m" and size < 0.2 else (1.0, unit)
    gap = GAP * size
    found = []
    for axis, name in enumerate("xyz"):
        if extent[axis] < 1e-9 * size:
            continue
        start = _beside(axis, lo, hi, view, gap)
        end = start.copy()
        start[axis], end[axis] = lo[axis], hi[axis]
        ticks = np.arange(math.ceil(lo[axis] / step - 1e-9), math.floor(hi[axis] / step + 1e-9) + 1) * step
        marks = []
        for tick in ticks.tolist():
            at = start.copy()
            at[axis] = tick
            marks.append((at, f"{tick / scale + 0.0:.6g}"))
        called = f"{name} ({shown})" if shown else name
        found.append(Ruler(name=called, start=start, end=end, marks=tuple(marks), upright=axis == view.upright))
    return tuple(found)


def _beside(axis: int, lo: Floats, hi: Floats, view: View, gap: float) -> Floats:
    """A point of the edge that an axis runs along: level ones in front on the ground, the upright one at the left."""
    upright = view.upright
    ground = lo[upright] if view.axes[1, upright] > 0 else hi[upright]
    level = [k for k in range(3) if k != upright]
    if axis == upright:
        corners = []
        for first in (lo[level[0]] - gap, hi[level[0]] + gap):
            for second in (lo[level[1]] - gap, hi[level[1]] + gap):
                corner = np.empty(3)
                corner[level], corner[upright] = (first, second), ground
                corners.append(corner)
        return np.asarray(min(corners, key=lambda p: float(view.of(p)[0])))
    near = view.axes[2] > 0
    at = np.where(near, hi, lo)
    at[upright] = ground
    other = level[1] if axis == level[0] else level[0]
    at[other] += gap if near[other] else -gap
    return np.asarray(at)
