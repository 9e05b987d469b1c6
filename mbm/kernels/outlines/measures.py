"""Area, centroid, perimeter and extremes of an outline, and their derivatives by the numbers of its figure.

With n the normal away from what is covered, v = n·dx the normal velocity (points held on the surface: where a surface
folds, they move along it at first order only along the outline), κ the curvature and T the unit tangent:

    dA = ∮ v ds,   d∫x dA = ∮ x v ds,   dL = ∮ κ v ds + Σ (T before − T after)·dx at corners

(Zolésio's shape derivatives). A corner moves so that both of its pieces keep their normal velocities.
"""

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
