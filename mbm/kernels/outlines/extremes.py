"""The outermost points of an outline, and how they move.

On a fold, u is extreme where u_s = u_t = 0: the outline is upright there, and its direction is the range of ∂x/∂(s, t).
Along a line, it is where u_s = 0. Both give the point and, by the implicit function theorem, its derivatives.
"""

from __future__ import annotations

import numpy as np

from mbm.kernels.outlines.measures import ORDER, Measured, corners
from mbm.kernels.outlines.outline import Indices, Outline, Spots
from mbm.kernels.types import Floats

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
    """Whether parameters lie on a piece, not beyond its ends: by the nearest chord of its arc."""
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
    for k in range(2):
        np.add.at(found[k], outline.places(sheet, spot.arc)[0], inner[k])
    return np.asarray(found)
