"""Which stretches of arcs are the outline: by the arrangement of their chords (shapely)."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from mbm.kernels.outlines.arcs import Arc, doubled_area
from mbm.kernels.types import Floats
from mbm.values import dataclass

Indices = NDArray[np.int64]

GRID = 1e-9
"""Of the image's size: what lies closer together is one point."""

LEAST = 1e-12
"""Of the squared size: smaller regions are gaps between lines that are one but for rounding."""


STRAIGHT = 1e-9
"""Angle in rad up to which a line that turns is straight but for rounding."""

THIN = 1e-6
"""Of the squared size: what covers less may be seen edge-on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Arc ``arc`` from ``first`` to ``last``: the number of a chord and a fraction of it, in one number."""

    arc: int
    first: float
    last: float


def rings_of(arcs: tuple[Arc, ...]) -> list[list[Stretch]]:
    """The closed lines that bound what is covered, each once around, with it on the left."""
    convex = _convex_ring(arcs)
    if convex is not None:
        return [convex]
    every = _joined_ends([arc.points for arc in arcs])
    starts = np.concatenate([points[:-1] for points in every])
    ends = np.concatenate([points[1:] for points in every])
    owners = np.repeat(np.arange(len(arcs)), [len(arc.points) - 1 for arc in arcs])
    numbers = np.concatenate([np.arange(len(arc.points) - 1) for arc in arcs])
    weights = np.array([arc.weight for arc in arcs], dtype=float)[owners]
    size = float(np.ptp(starts, axis=0).max())
    if not size > 0:
        return []
    owner = np.repeat(np.arange(len(arcs)), [len(points) for points in every])
    lines = shapely.linestrings(np.concatenate(every), indices=owner)
    noded = shapely.union_all(lines, grid_size=GRID * size)
    cells = shapely.get_parts(shapely.polygonize([noded]))
    cells = cells[shapely.area(cells) > LEAST * size**2]
    if not len(cells):
        return []
    inside = shapely.get_coordinates(shapely.point_on_surface(cells))
    chords = _Chords(starts, ends, owners, numbers, size)
    covered = cells[chords.windings(inside, weights) > 0.5]
    found = []
    for polygon in shapely.get_parts(shapely.coverage_union_all(covered)):
        for number, ring in enumerate(shapely.get_rings(polygon)):
            points = shapely.get_coordinates(ring)
            turn = doubled_area(points[:-1])
            if abs(turn) > LEAST * size**2:
                stretches = chords.stretches(points if (turn > 0) == (number == 0) else points[::-1])
                if stretches:
                    found.append(stretches)
    return found


def _convex_ring(arcs: tuple[Arc, ...]) -> list[Stretch] | None:
    """The arcs one after the other, if each begins where one ends and they turn left all the way round, once.

    Such a line is simple, and bounds what is covered; it needs no arrangement.
    """
    if len(arcs) < 2:
        return None
    begins, ends = (np.array([arc.points[k] for arc in arcs]) for k in (0, -1))
    size = float(np.ptp(begins, axis=0).max())
    one, other = _pairs(ends, begins, GRID * size)
    if not all(np.array_equal(np.sort(each), np.arange(len(arcs))) for each in (one, other)):
        return None
    after = other[np.argsort(one)].tolist()
    order = [0]
    while after[order[-1]] != 0:
        order.append(after[order[-1]])
    if len(order) < len(arcs):
        return None
    points = np.concatenate([arcs[k].points[:-1] for k in order])
    x, y = (np.concatenate([points[1:], points[:2]]) - np.concatenate([points, points[:1]])).T
    turns = np.arctan2(x[:-1] * y[1:] - x[1:] * y[:-1], x[:-1] * x[1:] + y[:-1] * y[1:])
    if turns.min() < -STRAIGHT or abs(turns.sum() - 2 * np.pi) > STRAIGHT or doubled_area(points) < THIN * size**2:
        return None
    return [Stretch(arc=k, first=0.0, last=float(len(arcs[k].points) - 1)) for k in order]


def _joined_ends(lines: list[Floats]) -> list[Floats]:
    """The same with ends that differ by rounding made one: the grid would part what lies on both sides of its edge."""
    ends = np.array([points[k] for points in lines for k in (0, -1)])
    near = 10 * GRID * max(float(np.ptp(ends, axis=0).max()), 1e-300)
    one, other = _pairs(ends, ends, near)
    first = np.arange(len(ends))
    np.minimum.at(first, one, other)
    found = [points.copy() for points in lines]
    for k in np.flatnonzero(first != np.arange(len(ends))).tolist():
        found[k // 2][-(k % 2)] = ends[first[k]]
    return found


_SLANT = np.array([np.cos(1.0), np.sin(1.0)])
"""A direction along which the corners of shapes seldom lie one beside the other."""


def _pairs(points: Floats, others: Floats, near: float) -> tuple[Indices, Indices]:
    """Positions of ``points`` (n, 2) and of ``others`` (m, 2) that are no farther than ``near`` apart in u and in v."""
    order = np.argsort(others @ _SLANT)
    along, reach = (others @ _SLANT)[order], 2 * near
    here = points @ _SLANT
    begin, end = np.searchsorted(along, here - reach, "left"), np.searchsorted(along, here + reach, "right")
    count = end - begin
    one = np.repeat(np.arange(len(points)), count)
    other = order[np.arange(len(one)) + np.repeat(begin - np.cumsum(count) + count, count)]
    close = np.abs(points[one] - others[other]).max(axis=1) <= near
    return one[close], other[close]


class _Chords:
    """The chords of all arcs, to be found again from pieces of them. Local to one outline."""

    def __init__(self, starts: Floats, ends: Floats, owners: Indices, numbers: Indices, size: float) -> None:
        self._starts, self._ways = starts, ends - starts
        self._lengths = np.maximum(np.linalg.norm(self._ways, axis=1), 1e-300)
        self._owners, self._numbers, self._size = owners, numbers, size
        self._tree = shapely.STRtree(shapely.linestrings(np.stack([starts, ends], axis=1)))

    def windings(self, points: Floats, weights: Floats) -> Floats:
        """How often chords run around points (n, 2), counter-clockwise ones positive."""
        beyond = np.stack(
            [np.full(len(points), max(self._starts[:, 0].max(), points[:, 0].max())), points[:, 1]], axis=1
        )
        own, chord = self._tree.query(shapely.linestrings(np.stack([points, beyond], axis=1)))
        (x, y), (u, v) = (points[own] - self._starts[chord]).T, self._ways[chord].T
        up, down = (y >= 0) & (v > y), (y < 0) & (v <= y)
        left = u * y - v * x
        turns = np.where(up & (left > 0), 1.0, np.where(down & (left < 0), -1.0, 0.0)) * weights[chord]
        return np.asarray(np.bincount(own, weights=turns, minlength=len(points)), dtype=np.float64)

    def stretches(self, ring: Floats) -> list[Stretch]:
        """The stretches along a ring of chords' pieces (n + 1, 2), whose inside lies left."""
        middles, ways = (ring[1:] + ring[:-1]) / 2, np.diff(ring, axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        pairs = self._tree.query(shapely.points(middles), predicate="dwithin", distance=20 * GRID * self._size)
        piece, chord = pairs
        along = np.einsum("ij,ij->i", ways[piece], self._ways[chord]) / (lengths[piece] * self._lengths[chord])
        best = np.full(len(middles), -1)
        order = np.lexsort((chord, along))  # the most parallel one is the last, of equal ones always the same
        order = order[along[order] > 0.5]
        best[piece[order]] = chord[order]
        kept = np.flatnonzero(best >= 0)
        chords = best[kept]
        return _joined(self._owners[chords], *(self._shares(chords, ring[kept + i]) for i in (0, 1)))

    def _shares(self, chords: Indices, points: Floats) -> Floats:
        """The number of the chord and the fraction of it for each point."""
        ways, lengths = self._ways[chords], self._lengths[chords]
        share = np.einsum("ij,ij->i", points - self._starts[chords], ways) / lengths**2
        slack = 4 * GRID * self._size / lengths
        share = np.where(share < slack, 0.0, np.where(share > 1 - slack, 1.0, share))
        return np.asarray(self._numbers[chords] + share)


def _joined(arcs: Indices, first: Floats, last: Floats) -> list[Stretch]:
    """Neighbours around a ring that go on along one arc as one stretch."""
    if not len(arcs):
        return []
    after = (arcs == np.roll(arcs, -1)) & (np.abs(last - np.roll(first, -1)) < 1e-6) & (np.roll(last, -1) > first)
    ends = np.flatnonzero(~after)
    begins = (np.roll(ends, 1) + 1) % len(arcs)
    stretches = zip(arcs[ends].tolist(), first[begins].tolist(), last[ends].tolist(), strict=True)
    return [Stretch(arc=arc, first=begin, last=end) for arc, begin, end in stretches]
