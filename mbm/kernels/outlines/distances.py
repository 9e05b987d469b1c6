"""Signed distances of points from an outline, positive outside, for many points at once.

The nearest place on a polynomial of each span begins a search along its arc (Newton's method on (x − p)·dx = 0, which
at a fold is enough: off the fold the image moves along the outline only, at first order). What the nearest point's
normal velocity is to the outline is the derivative of the distance, with its sign; at a corner that of the corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.kernels.outlines.measures import corners
from mbm.kernels.outlines.outline import PARALLEL, Indices, Outline, Spots
from mbm.kernels.types import Floats
from mbm.values import dataclass

CHORDS = 2
"""Parts that a span of a curved arc is cut into for the search."""

FEW_CHORDS = 64
"""Chords of which all are looked at; of more it takes less time to choose."""

SQUARES = 32
"""Cells of points along the extent of an outline."""

DEARER = 8
"""Times as long as with all chords a distance takes from one that was chosen."""

TOGETHER = 500_000
"""Distances of points from chords that are computed together."""

FOOT_STEPS, POLYNOMIAL_STEPS = 12, 4

BEYOND = 1.25
"""Half spans from the middle: feet a little beyond the end of a span are found from it as well."""

AT_REST = 1e-9
"""Step, in chords, that a foot is left by: what that does to its distance is a rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feet:
    """The nearest points, at ``spots``; ``corner`` is the piece that ends there, or −1 beside corners."""

    spots: Spots
    corner: Indices
    distances: Floats
    normals: Floats


def feet_of(outline: Outline, points: Floats) -> Feet:
    """The nearest points of the outline to ``points`` (n, 2)."""
    piece, place = _nearest_places(outline, points)
    place, spots = _refined(outline, points, piece, place)
    smooth_end = _smooth(outline)
    before = np.argsort(outline.following)
    for at_end in (True, False):  # where a piece goes on smoothly, the foot may lie on the next one
        edge = (outline.last if at_end else outline.first)[piece]
        beyond = outline.following[piece] if at_end else before[piece]
        stuck = np.flatnonzero((place == edge) & smooth_end[piece if at_end else beyond])
        if len(stuck):
            other = beyond[stuck]
            begin = (outline.first if at_end else outline.last)[other]
            begin, found = _refined(outline, points[stuck], other, begin)
            better = _length(points[stuck] - found.x) < _length(points[stuck] - spots.x[stuck])
            moved = stuck[better]
            piece[moved], place[moved] = other[better], begin[better]
            spots.enter(moved, found, better)
    return _signed(outline, points, piece, place, spots, smooth_end, before)


def _length(ways: Floats) -> Floats:
    return np.asarray(np.hypot(*ways.T))


def _smooth(outline: Outline) -> NDArray[np.bool_]:
    """Whether each piece goes on into the next one without a corner."""
    begin, end = outline.ends()
    a, b = end.normals(), begin.normals()[outline.following]
    return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) <= PARALLEL)


def _nearest_places(outline: Outline, points: Floats) -> tuple[Indices, Floats]:
    """The piece and the place on it that are nearest to each point, but for what powers above the fifth tell of a span.

    The nearest chord begins Newton's method on the polynomial of degree five that has the ends of the span and its
    middle, and the derivatives there.
    """
    spans = outline.spans
    bent = ~outline.arcs.straight[outline.arc[spans.piece]]
    parts = np.where(bent, CHORDS, 1)
    own = np.repeat(np.arange(len(parts)), parts + 1)
    node = np.cumsum(parts + 1) - parts - 1
    number = np.arange(len(own)) - node[own]
    width = (spans.last - spans.first) / parts
    places, inner = spans.first[own] + number * width[own], number < parts[own]
    places[~inner] = np.nextafter(spans.last, spans.first)  # the next chord goes on at another pace
    nodes = outline.spots(outline.arc[spans.piece[own]], places)
    begin = np.flatnonzero(inner)
    starts, ways = nodes.x[begin], nodes.x[begin + 1] - nodes.x[begin]
    best = _nearest(points, starts, ways)
    share = _shares(points, starts[best], ways[best]) + number[begin][best]
    span = own[begin][best]
    curved = np.flatnonzero(bent[span])
    if len(curved):
        three = node[bent] + np.arange(CHORDS + 1)[:, None]
        coefficients = _polynomials(nodes.x.T[:, three], nodes.way.T[:, three] * width[bent])
        here = (np.cumsum(bent) - 1)[span[curved]]
        share[curved] = 1 + _on_polynomials(points[curved].T, coefficients[:, :, here], share[curved] - 1)
    piece = spans.piece[span]
    return piece, np.clip(spans.first[span] + share * width[span], outline.first[piece], outline.last[piece])


def _polynomials(images: Floats, slopes: Floats) -> Floats:
    """Coefficients (6, 2, spans) by rising powers, from values and derivatives (2, 3, spans) at −1, 0, 1."""
    (low, middle, high), (below, even, above) = np.moveaxis(images, 1, 0), np.moveaxis(slopes, 1, 0)
    rise, odd = (high + low) / 2 - middle, (high - low) / 2 - even
    bend, tilt = (above - below) / 2, (above + below) / 2 - even
    return np.stack([middle, even, 2 * rise - bend / 2, (5 * odd - tilt) / 2, bend / 2 - rise, (tilt - 3 * odd) / 2])


def _on_polynomials(points: Floats, coefficients: Floats, share: Floats) -> Floats:
    """The feet of points (2, n) on polynomials (6, 2, n), a little beyond −1 and 1 at most, by Newton's method."""
    constant, *others = coefficients
    constant = constant - points
    for _ in range(POLYNOMIAL_STEPS):
        gap = way = bend = np.zeros_like(constant)
        for each in reversed(others):
            bend = bend * share + way
            way = way * share + gap
            gap = gap * share + each
        bend, way, gap = 2 * (bend * share + way), way * share + gap, gap * share + constant
        squared = _dot(way.T, way.T)
        slope = squared + _dot(gap.T, bend.T)
        step = -_dot(gap.T, way.T) / np.where(slope > 0.05 * squared, slope, squared)
        share = np.clip(share + step, -BEYOND, BEYOND)
        if np.abs(step).max(initial=0.0) < AT_REST:
            break
    return np.asarray(share)


def _nearest(points: Floats, starts: Floats, ways: Floats) -> Indices:
    """Which chord is nearest to each point.

    Points are taken cell by cell. Of many chords, those are looked at that may be nearest to one of a cell: no farther
    from the points' middle than the one nearest to it and twice the distance of the farthest of them.
    """
    if len(starts) <= FEW_CHORDS:
        return _nearest_of_all(points, starts, ways)
    points = np.where(np.isfinite(points), points, starts[0])  # to what is not finite any is
    low, size = starts.min(axis=0), max(float(np.ptp(starts, axis=0).max()) / SQUARES, 1e-300)
    column, row = np.clip((points - low) / size, -SQUARES, 2 * SQUARES).astype(np.int64).T
    number = column * (4 * SQUARES) + row
    order = np.argsort(number, kind="stable")
    first = np.flatnonzero(np.diff(number[order], prepend=number.min() - 1))
    count = np.diff(first, append=len(points))
    middles = np.add.reduceat(points[order], first) / count[:, None]
    away = np.square(points[order] - np.repeat(middles, count, axis=0)).sum(axis=1)
    gaps = np.sqrt(_squared_gaps(middles, starts, ways)).T
    most = gaps.min(axis=1) + 2 * np.sqrt(np.maximum.reduceat(away, first))
    cell, chord = np.nonzero(gaps <= most[:, None] * (1 + 1e-12))
    many = np.bincount(cell)
    pairs = np.repeat(many, count)
    if DEARER * pairs.sum() > len(points) * len(starts):
        return _nearest_of_all(points, starts, ways)
    begin = np.repeat(np.cumsum(many) - many, count)
    best, ends = np.empty(len(points), dtype=np.int64), np.cumsum(pairs)
    for some in np.split(np.arange(len(points)), np.searchsorted(ends, np.arange(TOGETHER, ends[-1], TOGETHER))):
        if len(some):
            best[order[some]] = _nearest_of(points[order[some]], starts, ways, chord, (begin[some], pairs[some]))
    return best


def _nearest_of_all(points: Floats, starts: Floats, ways: Floats) -> Indices:
    parts = np.array_split(points, len(points) * len(starts) // TOGETHER + 1)
    return np.concatenate([np.argmin(_squared_gaps(each, starts, ways), axis=0) for each in parts])


def _nearest_of(
    points: Floats, starts: Floats, ways: Floats, chord: Indices, of_each: tuple[Indices, Indices]
) -> Indices:
    """Which chord is nearest to each point, of those that stand in ``chord`` from a place on, so many of each point."""
    begin, pairs = of_each
    place = np.cumsum(pairs) - pairs
    line = np.repeat(np.arange(len(points)), pairs)
    own = chord[np.arange(len(line)) + np.repeat(begin - place, pairs)]
    (x, y), (u, v) = (points[line] - starts[own]).T, ways[own].T
    share = np.clip((x * u + y * v) / np.maximum(u * u + v * v, 1e-300), 0, 1)
    squared = np.square(x - share * u) + np.square(y - share * v)
    found = np.flatnonzero(squared == np.minimum.reduceat(squared, place)[line])
    best = np.empty(len(points), dtype=np.int64)
    best[line[found]] = own[found]
    return best


def _squared_gaps(points: Floats, starts: Floats, ways: Floats) -> Floats:
    """Squared distances (chords, points): along each chord beyond its ends, and across it."""
    lengths = np.maximum(np.hypot(*ways.T), 1e-300)
    unit = ways / lengths[:, None]
    normals = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    along, across = (n @ points.T - _dot(n, starts)[:, None] for n in (unit, normals))
    along -= np.clip(along, 0, lengths[:, None])
    along *= along
    across *= across
    along += across
    return np.asarray(along)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1])


def _shares(points: Floats, starts: Floats, ways: Floats) -> Floats:
    return np.clip(_dot(points - starts, ways) / np.maximum(_dot(ways, ways), 1e-300), 0, 1)


def _refined(outline: Outline, points: Floats, piece: Indices, place: Floats) -> tuple[Floats, Spots]:
    """The feet on the pieces themselves, near ``place``: their places, and the spots there."""
    place, arc = place.copy(), outline.arc[piece]
    spots = outline.spots(arc, place)
    bent = np.flatnonzero(~outline.arcs.straight[arc])
    first, last = outline.first[piece], outline.last[piece]
    way = spots.way[bent]
    gap, squared = _dot(spots.x[bent] - points[bent], way), _dot(way, way)
    slope = squared  # the distance is small beside the radius of curvature, mostly
    for _ in range(FOOT_STEPS if len(bent) else 0):
        step = -gap / np.where(slope > 0.05 * squared, slope, squared)
        moved = np.clip(place[bent] + np.clip(step, -1, 1), first[bent], last[bent])
        change = moved - place[bent]
        place[bent] = moved
        moving = np.abs(change) >= AT_REST
        bent, change, before = bent[moving], change[moving], gap[moving]
        if not len(bent):
            break
        here = outline.spots(arc[bent], place[bent])
        spots.enter(bent, here)
        gap, squared = _dot(here.x - points[bent], here.way), _dot(here.way, here.way)
        slope = (gap - before) / change  # the secant's: next to the foot as good as Newton's, by half the points
    return place, spots


def _signed(
    outline: Outline,
    points: Floats,
    piece: Indices,
    place: Floats,
    spots: Spots,
    smooth_end: NDArray[np.bool_],
    before: Indices,
) -> Feet:
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
    lengths = np.hypot(*gaps.T)
    sign = np.where(_dot(gaps, normals) >= 0, 1.0, -1.0)
    # at a corner the distance grows along the gap; elsewhere the gap is along the normal but for rounding
    far = (corner >= 0) & (lengths > 1e-12 * np.abs(points).max(initial=1.0))
    normals[far] = sign[far, None] * gaps[far] / lengths[far, None]
    beside = _dot(gaps, normals)
    return Feet(
        spots=spots,
        corner=corner,
        distances=np.where(corner >= 0, sign * lengths, beside),
        normals=normals,
    )


def slopes_of(outline: Outline, feet: Feet) -> Floats:
    """Derivatives (n, size + 2) of the distances by the numbers of the figure, and by the points."""
    size, count = outline.size, len(feet.distances)
    cells, parts = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for own, places, slopes in outline.velocities(feet.spots):
        x, y = feet.normals[own].T
        cells.append((own[:, None] * (size + 2) + places).ravel())
        parts.append((-slopes[:, 0] * x[:, None] - slopes[:, 1] * y[:, None]).ravel())
    sums = np.bincount(np.concatenate(cells), weights=np.concatenate(parts), minlength=count * (size + 2))
    found = np.asarray(sums.reshape(count, size + 2), dtype=np.float64)
    found[:, size:] = feet.normals
    tips = np.flatnonzero(feet.corner >= 0)
    if len(tips):
        moved = corners(outline)[feet.corner[tips]]
        found[tips, :size] = -np.einsum("nij,ni->nj", moved, feet.normals[tips])
    return found
