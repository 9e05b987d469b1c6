"""Points of a figure's surfaces, and their images for many sets of its numbers at once: its convex hull, about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Figure
from mbm.kernels.outlines.arcs import BENT
from mbm.kernels.outlines.surveyor import Surveyor
from mbm.kernels.types import Floats
from mbm.values import dataclass

Indices = NDArray[np.int64]

ACROSS = 12
"""Cells of a patch in each direction: chords of a full turn leave out 1 - cos 15°, 3 % of its radius."""

INPUTS_TOGETHER = 1_000_000
"""Numbers that a sheet takes for many points at a time."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marks:
    """Points of one sheet: its number, the places (k, inputs) of their inputs, and parameters (k, 2).

    ``points`` (k, 0 or 3) are inputs before these.
    """

    sheet: int
    places: Indices
    at: Floats
    points: Floats

    def __len__(self) -> int:
        """k."""
        return len(self.at)


def marks_of(figure: Figure) -> tuple[Marks, ...]:
    """Points of all lines and patches, of a straight line its ends; of a net those of its convex hull."""
    cells = np.linspace(0, 1, ACROSS + 1)
    grid = np.stack(np.meshgrid(cells, cells, indexing="ij"), axis=-1).reshape(-1, 2)
    found = []
    for number, sheet in enumerate(figure.sheets):
        if sheet.parameters == 1:
            share = np.linspace(0, 1, 2 if sheet.straight else BENT + 1)
            at, owners = np.stack([share, np.zeros_like(share)], axis=1), figure.lines
        elif sheet.parameters == 2:
            at, owners = grid, figure.patches
        else:
            continue
        own = np.array([places for k, places in owners if k == number], dtype=np.int64)
        own = own.reshape(-1, sheet.inputs)
        if len(own):
            places = np.repeat(own, len(at), axis=0)
            found.append(
                Marks(sheet=number, places=places, at=np.tile(at, (len(own), 1)), points=np.empty((len(places), 0)))
            )
    for seen in figure.nets:
        points = _outermost(seen.net.points)
        places = np.tile(np.array(seen.of_point, dtype=np.int64), (len(points), 1))
        found.append(Marks(sheet=seen.point, places=places, at=np.zeros((len(points), 2)), points=points))
    return tuple(found)


def _outermost(points: Floats) -> Floats:
    """The points that a convex hull has for corners; all of a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points


def kept(marks: tuple[Marks, ...], mask: NDArray[np.bool_]) -> tuple[Marks, ...]:
    """Those that ``mask`` (all marks,) picks."""
    ends = np.cumsum([len(each) for each in marks])
    parts = zip(marks, np.split(mask, ends[:-1]), strict=True)
    return tuple(
        replace(each, places=each.places[own], at=each.at[own], points=each.points[own])
        for each, own in parts
        if own.any()
    )


def places_of(marks: tuple[Marks, ...], surveyor: Surveyor, numbers: Floats) -> Floats:
    """u, v and depth (S, marks, 3) for sets of the figure's numbers (S, size)."""
    found = np.empty((len(numbers), sum(len(each) for each in marks), 3))
    first = 0
    for each in marks:
        step = max(INPUTS_TOGETHER // max(each.places.size + each.points.size, 1), 1)
        for some in (slice(k, k + step) for k in range(0, len(numbers), step)):
            others = numbers[some][:, each.places].reshape(-1, each.places.shape[1])
            inputs = np.concatenate([np.tile(each.points, (len(numbers[some]), 1)), others], axis=1)
            images = surveyor.table(each.sheet, "places", np.tile(each.at, (len(numbers[some]), 1)), inputs)
            found[some, first : first + len(each)] = images.reshape(-1, len(each), 3)
        first += len(each)
    return found
