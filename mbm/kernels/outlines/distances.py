"""Signed distances of points from an outline, positive outside, for many points at once.

The nearest chord begins a search along its arc (Newton's method on (x − p)·dx = 0, which at a fold is enough: off the
fold the image moves along the outline only, at first order). What the nearest point's normal velocity is to the outline
is the derivative of the distance, with its sign; at a corner that of the corner itself.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from mbm.kernels.outlines.measures import corners
from mbm.kernels.outlines.outline import PARALLEL, Indices, Outline, Spots
from mbm.kernels.types import Floats
from mbm.values import dataclass

CHORDS = 4
"""Parts that a span of a curved arc is cut into for the search."""

_STEPS = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feet:
    """The nearest points: on pieces at ``places``; ``corner`` is the piece that ends there, or −1 beside corners."""

    piece: Indices
    spots: Spots
    corner: Indices
    distances: Floats
    normals: Floats


def feet_of(outline: Outline, points: Floats) -> Feet:
    """The nearest points of the outline to ``points`` (n, 2)."""
    piece, place = _nearest_chords(outline, points)
    piece, place = _refined(outline, points, piece, place)
    smooth_end = _smooth(outline)
    before = np.argsort(outline.following)
    for at_end in (True, False):  # where a piece goes on smoothly, the foot may lie on the next one
        edge = (outline.last if at_end else outline.first)[piece]
        beyond = outline.following[piece] if at_end else before[piece]
        stuck = np.flatnonzero((place == edge) & smooth_end[piece if at_end else beyond])
        if len(stuck):
            other = beyond[stuck]
            begin = (outline.first if at_end else outline.last)[other]
            other, begin = _refined(outline, points[stuck], other, begin)
            far = _lengths(outline, points[stuck], piece[stuck], place[stuck])
            better = _lengths(outline, points[stuck], other, begin) < far
            piece[stuck[better]], place[stuck[better]] = other[better], begin[better]
    return _signed(outline, points, piece, place, smooth_end, before)


def _lengths(outline: Outline, points: Floats, piece: Indices, place: Floats) -> Floats:
    return np.asarray(np.linalg.norm(points - outline.spots(outline.arc[piece], place).x, axis=1))


def _smooth(outline: Outline) -> NDArray[np.bool_]:
    """Whether each piece goes on into the next one without a corner."""
    begin, end = outline.ends()
    a, b = end.normals(), begin.normals()[outline.following]
    return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) <= PARALLEL)


def _nearest_chords(outline: Outline, points: Floats) -> tuple[Indices, Floats]:
    """The piece and the place on it whose chord is nearest to each point."""
    spans = outline.spans
    parts = np.where(outline.arcs.straight[outline.arc[spans.piece]], 1, CHORDS)
    own = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(own)) - np.repeat(np.cumsum(parts) - parts, parts)
    length = (spans.last - spans.first) / parts
    piece, first = spans.piece[own], spans.first[own] + number * length[own]
    last = first + length[own]
    starts = outline.spots(outline.arc[piece], first).x
    ways = outline.spots(outline.arc[piece], last).x - starts
    if len(piece) <= 16:
        best = np.argmin(_squared_gaps(points, starts, ways), axis=1)
    else:
        tree = shapely.STRtree(shapely.linestrings(np.stack([starts, starts + ways], axis=1)))
        best = tree.query_nearest(shapely.points(points), all_matches=False)[1]
    share = _shares(points, starts[best], ways[best])
    return piece[best], first[best] + share * (last - first)[best]


def _squared_gaps(points: Floats, starts: Floats, ways: Floats) -> Floats:
    """Squared distances (points, chords)."""
    dx, dy = points[:, :1] - starts[:, 0], points[:, 1:] - starts[:, 1]
    share = (dx * ways[:, 0] + dy * ways[:, 1]) / np.maximum(np.sum(ways**2, axis=1), 1e-300)
    np.clip(share, 0, 1, out=share)
    dx -= share * ways[:, 0]
    dy -= share * ways[:, 1]
    return np.asarray(dx * dx + dy * dy)


def _shares(points: Floats, starts: Floats, ways: Floats) -> Floats:
    squared = np.maximum(np.sum(ways**2, axis=-1), 1e-300)
    return np.asarray(np.clip(np.sum((points - starts) * ways, axis=-1) / squared, 0, 1))


def _refined(outline: Outline, points: Floats, piece: Indices, place: Floats) -> tuple[Indices, Floats]:
    """The feet on the pieces themselves, near ``place``."""
    piece, place = piece.copy(), place.copy()
    arc = outline.arc[piece]
    bent = np.flatnonzero(~outline.arcs.straight[arc])
    first, last = outline.first[piece], outline.last[piece]
    step = np.full(len(place), 0.01)
    for _ in range(_STEPS if len(bent) else 0):
        own = arc[bent]
        here = outline.spots(own, place[bent])
        gap = np.einsum("ij,ij->i", here.x - points[bent], here.way)
        beside = np.clip(place[bent] + np.where(place[bent] + 1e-5 > last[bent], -1e-5, 1e-5), first[bent], last[bent])
        near = outline.spots(own, beside)
        slope = (np.einsum("ij,ij->i", near.x - points[bent], near.way) - gap) / (beside - place[bent])
        squared = np.sum(here.way**2, axis=1)
        step = -gap / np.where(slope > 0.05 * squared, slope, squared)
        moved = np.clip(place[bent] + np.clip(step, -1, 1), first[bent], last[bent])
        still = np.abs(moved - place[bent]) < 1e-9
        place[bent] = moved
        bent = bent[~still]
        if not len(bent):
            break
    return piece, place


def _signed(
    outline: Outline, points: Floats, piece: Indices, place: Floats, smooth_end: NDArray[np.bool_], before: Indices
) -> Feet:
    spots = outline.spots(outline.arc[piece], place)
    normals = spots.normals()
    corner = np.full(len(piece), -1)
    at_end, at_begin = place == outline.last[piece], place == outline.first[piece]
    corner[at_end & ~smooth_end[piece]] = piece[at_end & ~smooth_end[piece]]
    turned = at_begin & ~smooth_end[before[piece]]
    corner[turned] = before[piece[turned]]
    tips = np.flatnonzero(corner >= 0)
    if len(tips):
        begin, end = outline.ends()
        both = end.normals()[corner[tips]] + begin.normals()[outline.following[corner[tips]]]
        normals[tips] = both / np.linalg.norm(both, axis=1, keepdims=True)
    gaps = points - spots.x
    lengths = np.linalg.norm(gaps, axis=1)
    sign = np.where(np.einsum("ij,ij->i", gaps, normals) >= 0, 1.0, -1.0)
    # at a corner the distance grows along the gap; elsewhere the gap is along the normal but for rounding
    far = (corner >= 0) & (lengths > 1e-12 * np.abs(points).max(initial=1.0))
    normals[far] = sign[far, None] * gaps[far] / lengths[far, None]
    beside = np.einsum("ij,ij->i", gaps, normals)
    return Feet(
        piece=piece,
        spots=spots,
        corner=corner,
        distances=np.where(corner >= 0, sign * lengths, beside),
        normals=normals,
    )


def slopes_of(outline: Outline, feet: Feet) -> Floats:
    """Derivatives (n, size + 2) of the distances by the numbers of the figure, and by the points."""
    size = len(outline.numbers)
    found = np.zeros((len(feet.distances), size + 2))
    found[:, size:] = feet.normals
    for own, places, slopes in outline.velocities(feet.spots):
        np.add.at(found, (own[:, None], places), -np.einsum("nij,ni->nj", slopes, feet.normals[own]))
    tips = np.flatnonzero(feet.corner >= 0)
    if len(tips):
        moved = corners(outline)[feet.corner[tips]]
        found[tips, :size] = -np.einsum("nij,ni->nj", moved, feet.normals[tips])
    return found
