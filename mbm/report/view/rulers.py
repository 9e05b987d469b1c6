"""Axes of pictures of space: three edges of the box around a model, with marks at round numbers."""

from __future__ import annotations

import math

import numpy as np

from mbm.report.figures import round_step
from mbm.report.types import Floats
from mbm.report.view.viewpoint import View
from mbm.values import dataclass

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
