"""What is measured of an outline, and how it varies: area, centroid, perimeter, and the outermost points."""

from __future__ import annotations

import numpy as np

from mbm.kernels.outlines.outline import PARALLEL, Indices, Outline, Spots
from mbm.kernels.types import Floats

ORDER = 6
"""Gauss points of a chord."""

Measured = tuple[Floats, Floats]
"""Values (n,), and derivatives (n, size)."""


def area(outline: Outline) -> Measured:
    """∮ x dy."""
    _, spots, weights = outline.stations(ORDER)
    value = np.sum(weights * _cross(spots.x - spots.x[0], spots.way)) / 2
    return np.array([value]), outline.motion(spots, _outward(spots, weights))[None]


def centroid(outline: Outline) -> Measured:
    """The mean of x and y over the area; about the first point, to lose no digits far from the origin."""
    _, spots, weights = outline.stations(ORDER)
    own = spots.x - spots.x[0]
    value = np.sum(weights * _cross(own, spots.way)) / 2
    moments = (
        np.array(
            [np.sum(weights * own[:, 0] ** 2 * spots.way[:, 1]), -np.sum(weights * own[:, 1] ** 2 * spots.way[:, 0])]
        )
        / 2
    )
    center = moments / value
    outward = _outward(spots, weights)
    slopes = [outline.motion(spots, (own[:, k] - center[k])[:, None] * outward) / value for k in range(2)]
    return center + spots.x[0], np.array(slopes)


def perimeter(outline: Outline) -> Measured:
    """∮ ds, holes included."""
    _, spots, weights = outline.stations(ORDER)
    speed = np.linalg.norm(spots.way, axis=1)
    slopes = outline.motion(spots, _curvatures(outline, spots)[:, None] * _outward(spots, weights))
    before, corner = outline.ends()[1], corners(outline)
    after = outline.ends()[0]
    unit = [s.way / np.linalg.norm(s.way, axis=1, keepdims=True) for s in (before, after)]
    bend = unit[0] - unit[1][outline.following]
    return np.array([np.sum(weights * speed)]), (slopes + np.einsum("ni,nij->j", bend, corner))[None]


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _outward(spots: Spots, weights: Floats) -> Floats:
    """n ds."""
    return np.stack([spots.way[:, 1] * weights, -spots.way[:, 0] * weights], axis=1)


def corners(outline: Outline) -> Floats:
    """How the end of each piece moves with the numbers (pieces, 2, size); zero where there is no corner."""
    begin, end = outline.ends()
    after = outline.following
    ways = [end.normals(), begin.normals()[after]]
    moved = [outline.spread(end), outline.spread(begin)[after]]
    speeds = [np.einsum("ni,nij->nj", n, v) for n, v in zip(ways, moved, strict=True)]
    turn = _cross(*ways)
    found = np.zeros_like(moved[0])
    own = np.abs(turn) > PARALLEL
    (n, m), (v, w) = (each[own] for each in ways), (each[own] for each in speeds)
    found[own, 0] = (v * m[:, 1:] - w * n[:, 1:]) / turn[own, None]
    found[own, 1] = (w * n[:, :1] - v * m[:, :1]) / turn[own, None]
    return found


def _curvatures(outline: Outline, spots: Spots) -> Floats:
    """κ at spots, positive where the outline turns left."""
    found = np.zeros(len(spots.arc))
    for sheet, own in outline.by_sheet(spots.arc):
        if outline.surveyor.sheets[sheet].straight:
            continue
        inputs = outline.numbers[outline.places(sheet, spots.arc[own])]
        bends = outline.surveyor.table(sheet, "bending", spots.at[own], inputs)
        geometry = outline.surveyor.table(sheet, "geometry", spots.at[own], inputs)
        if outline.surveyor.sheets[sheet].parameters == 1:
            first, second = geometry[:, 3:5], bends
        else:
            fold = outline.arcs.fold[spots.arc[own]]
            first, second = _turning(outline, spots, own, geometry, bends, fold)
        along = np.sign(np.einsum("ij,ij->i", first, spots.way[own]))
        found[own] = along * _cross(first, second) / np.linalg.norm(first, axis=1) ** 3
    return found


def _turning(
    outline: Outline, spots: Spots, own: Indices, geometry: Floats, bends: Floats, fold: np.ndarray
) -> tuple[Floats, Floats]:
    """First and second derivatives of x along a line of the parameters: straight, or, on a fold, along D = 0."""
    slopes = geometry[:, 3:7].reshape(-1, 2, 2)
    begin = outline.arcs.begin[spots.arc[own]]
    chords = outline.arcs.nodes[begin + 1] - outline.arcs.nodes[begin]
    tilt = geometry[:, 7:9]
    w = np.where(fold[:, None], np.stack([-tilt[:, 1], tilt[:, 0]], axis=1), chords)
    ss, st, tt = (bends[:, [k, k + 3]] for k in range(3))
    d_ss, d_st, d_tt = bends[:, 6:9].T
    drift = np.stack([-(d_st * w[:, 0] + d_tt * w[:, 1]), d_ss * w[:, 0] + d_st * w[:, 1]], axis=1) * fold[:, None]
    second = ss * w[:, :1] ** 2 + 2 * st * w[:, :1] * w[:, 1:] + tt * w[:, 1:] ** 2
    second = second + np.einsum("nij,nj->ni", slopes, drift)
    return np.einsum("nij,nj->ni", slopes, w), second


SIDES = {"left": (0, -1.0), "right": (0, 1.0), "least v": (1, -1.0), "greatest v": (1, 1.0)}
"""The coordinate, and whether it is the least or the greatest."""

MARGIN = 1e-2
"""Of the size: Gauss points within it of the best one may lie beside the true extreme."""

SLACK = 1e-6
"""Of a chord: a stationary point no farther beyond the end of its piece is taken to be there."""

_STEPS = 12


def extreme(outline: Outline, side: str) -> Measured:
    """The outermost point [u v] (2,) on one of `SIDES`, with derivatives (2, size)."""
    coordinate, sign = SIDES[side]
    _, end = outline.ends()
    piece, spots, _ = outline.stations(ORDER)
    reach = sign * spots.x[:, coordinate]
    tips = sign * end.x[:, coordinate]
    size = max(np.ptp(spots.x, axis=0).max(), 1e-300)
    best = max(reach.max(), tips.max())
    found: list[tuple[float, int, Spots | None]] = [(float(tips.max()), int(np.argmax(tips)), None)]
    for k in _peaks(piece, reach, best - MARGIN * size):
        if not outline.arcs.straight[outline.arc[piece[k]]]:
            refined = _refined(outline, spots, k, coordinate)
            if refined is not None and _is_on(outline, int(piece[k]), refined.at[0]):
                found.append((float(sign * refined.x[0, coordinate]), int(piece[k]), refined))
    _, own, spot = max(found, key=lambda each: each[0] + (1e-13 * size if each[2] is not None else 0.0))
    if spot is None:
        return end.x[own], corners(outline)[own]
    return spot.x[0], _moved(outline, spot, coordinate)


def extent(outline: Outline) -> Measured:
    """Width and height (2,)."""
    (left, a), (right, b) = (extreme(outline, side) for side in ("left", "right"))
    (low, c), (high, d) = (extreme(outline, side) for side in ("least v", "greatest v"))
    return np.array([right[0] - left[0], high[1] - low[1]]), np.array([b[0] - a[0], d[1] - c[1]])


def _peaks(piece: Indices, reach: Floats, least: float) -> list[int]:
    """Gauss points that no neighbour on their piece surpasses."""
    before = np.where(piece == np.roll(piece, 1), np.roll(reach, 1), -np.inf)
    after = np.where(piece == np.roll(piece, -1), np.roll(reach, -1), -np.inf)
    return np.flatnonzero((reach >= before) & (reach >= after) & (reach >= least)).tolist()


def _refined(outline: Outline, spots: Spots, k: int, coordinate: int) -> Spots | None:
    """The stationary point beside a Gauss point; None if Newton's method leaves the neighbourhood."""
    arc, one = int(spots.arc[k]), spots.arc[k : k + 1]
    way, at = _way(outline, arc), spots.at[k : k + 1].copy()
    for _ in range(_STEPS):
        slope, bend = _slopes(outline, arc, way, at, coordinate)
        try:
            step = -np.linalg.solve(bend, slope)
        except np.linalg.LinAlgError:
            return None
        at = at + (step if outline.arcs.fold[arc] else step[0] * way)
        if np.abs(step).max() < 1e-14:
            break
    if not np.abs(at - spots.at[k]).max() < 0.1:
        return None
    x = _row(outline, arc, "geometry", at)[None, :2]
    return Spots(arc=one, at=at, x=x, way=spots.way[k : k + 1])


def _is_on(outline: Outline, piece: int, at: Floats) -> bool:
    """Whether parameters are those of the sheet and lie on a piece, not beyond its ends: by its arc's nearest chord."""
    if not (np.all(at >= -SLACK) and np.all(at <= 1 + SLACK)):
        return False
    arc = outline.arc[piece]
    begin = outline.arcs.begin[arc]
    nodes = outline.arcs.nodes[begin : begin + outline.arcs.chords[arc] + 1]
    ways = np.diff(nodes, axis=0)
    share = np.clip(np.sum((at - nodes[:-1]) * ways, axis=1) / np.sum(ways**2, axis=1), 0, 1)
    nearest = int(np.argmin(np.linalg.norm(nodes[:-1] + share[:, None] * ways - at, axis=1)))
    return bool(outline.first[piece] - SLACK <= nearest + share[nearest] <= outline.last[piece] + SLACK)


def _way(outline: Outline, arc: int) -> Floats:
    """The direction of a line in the parameters."""
    begin = outline.arcs.begin[arc]
    chord = outline.arcs.nodes[begin + 1] - outline.arcs.nodes[begin]
    return np.asarray(chord / np.linalg.norm(chord))


def _row(outline: Outline, arc: int, what: str, at: Floats) -> Floats:
    """What a program of the arc's sheet gives at one point."""
    sheet = int(outline.arcs.sheet[arc])
    inputs = outline.numbers[outline.places(sheet, np.array([arc]))]
    return np.asarray(outline.surveyor.table(sheet, what, at, inputs)[0])


def _slopes(outline: Outline, arc: int, way: Floats, at: Floats, coordinate: int) -> tuple[Floats, Floats]:
    """Gradient and second derivatives of u or v by both parameters, or along ``way`` alone."""
    geometry, bending = (_row(outline, arc, what, at) for what in ("geometry", "bending"))
    if outline.surveyor.sheets[outline.arcs.sheet[arc]].parameters == 1:
        slope, bend = geometry[3 + coordinate] * way[0], bending[coordinate] * way[0] ** 2
        return np.array([slope]), np.array([[bend]])
    slope = geometry[3 + 2 * coordinate : 5 + 2 * coordinate]
    ss, st, tt = bending[3 * coordinate : 3 * coordinate + 3]
    bend = np.array([[ss, st], [st, tt]])
    if outline.arcs.fold[arc]:
        return np.asarray(slope), np.asarray(bend)
    return np.array([slope @ way]), np.array([[way @ bend @ way]])


def _moved(outline: Outline, spot: Spots, coordinate: int) -> Floats:
    """Derivatives (2, size) of a stationary point: x_a + x_s ds/da."""
    arc = int(spot.arc[0])
    sheet, way = int(outline.arcs.sheet[arc]), _way(outline, arc)
    _, bend = _slopes(outline, arc, way, spot.at, coordinate)
    count = outline.surveyor.sheets[sheet].parameters
    slant = _row(outline, arc, "slant", spot.at).reshape(2, count, -1)
    slopes = _row(outline, arc, "geometry", spot.at)[3 : 3 + 2 * count].reshape(2, count)
    lean = slant[coordinate]
    if not outline.arcs.fold[arc]:
        lean, slopes = (way[:count] @ lean)[None], (slopes @ way[:count])[:, None]
    inner = -slopes @ np.linalg.solve(bend, lean)
    found = outline.spread(spot)[0]
    places, inner = outline.surveyor.by_numbers(
        int(outline.arcs.net[arc]), outline.places(sheet, spot.arc), inner[None], outline.numbers
    )
    for k in range(2):
        np.add.at(found[k], places[0], inner[0, k])
    return np.asarray(found)
