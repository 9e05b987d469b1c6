"""A fit to contours in which a flat face is seen nearly edge-on → the minima on the other side of edge-on.

There the contour has a kink, and each of its sides a minimum of its own, often with another covariance: a face that is
seen tells how it is turned, one that is hidden hardly does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import minimum_norms
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.minimise.minimise import minima
from mbm.estimation.search.agreement import Agreement
from mbm.estimation.search.basins import equal_costs
from mbm.estimation.search.search import Found, search
from mbm.estimation.search.starting import Beginning
from mbm.estimation.settings import Settings
from mbm.estimation.starts.silhouettes.hulls import pictures_of
from mbm.problem.manifold import Piece
from mbm.problem.types import Problem

REACH = 10.0
"""Standard deviations within which a face is edge-on where the other side of that is looked at."""

PROBE = 1e-3
"""Standard deviations, about, by which poses are varied for derivatives of areas."""

SAME = 1.0
"""Standard deviations of a minimum up to which another one on the other side of a kink is nothing else to anybody."""


def with_faces_turned(
    equations: Assembled, found: Found, settings: Settings, problem: Problem, agrees: Agreement
) -> Found:
    """``found`` with the minima beyond edge-on; the lowest of all is the best."""
    known = (found.minimum, *(each.minimum for each in found.alternatives))
    alike = (each for each in known if equal_costs(each.cost, found.minimum.cost))
    points = np.concatenate([_beyond(equations, each, settings.seed) for each in alike])
    if not len(points) or settings.stopped():
        return found
    starts = tuple(Beginning(point=point, origin=found.origin) for point in (*(each.point for each in known), *points))
    other = search(equations, starts, settings, problem, agrees)
    if not other.minimum.reason.converged:
        return found
    differ = _differ(equations, other.minimum, [each.minimum for each in other.alternatives])
    return replace(
        other,
        alternatives=tuple(compress(other.alternatives, differ)),
        tally=found.tally,
        iterations=found.iterations + other.iterations,
        evaluations=found.evaluations + other.evaluations,
    )


def minima_beyond(equations: Assembled, minimum: Minimum, settings: Settings, problem: Problem) -> Iterator[Minimum]:
    """Where descents from beyond edge-on end, if it is elsewhere."""
    ends = tuple(minima(equations, _beyond(equations, minimum, settings.seed), settings, problem.span))
    return compress(ends, _differ(equations, minimum, ends))


def _beyond(equations: Assembled, minimum: Minimum, seed: int) -> Floats:
    """Points (T, N) at which faces that are nearly edge-on are seen from the other side, at the least cost."""
    if not minimum.reason.converged or minimum.blocks is not None:
        return np.empty((0, len(minimum.point)))
    n = equations.dimension
    free = np.zeros(len(equations.layout.number), dtype=bool)
    free[equations.free] = True
    steps = np.diag(PROBE / np.maximum(minimum_norms(minimum), 1e-300))
    moved = equations.retract(np.tile(minimum.point, (2 * n + 1, 1)), np.vstack([np.zeros((1, n)), steps, -steps]))
    inverse = np.linalg.pinv(minimum.jacobian.T @ minimum.jacobian, hermitian=True)
    found = []
    for picture in pictures_of(equations, minimum.point, free, seed):
        areas = picture.stream.functions.areas_of_flats(picture.called, picture.numbers(moved))
        slopes = (areas[1 : n + 1] - areas[n + 1 :]) / (2.0 * np.diag(steps)[:, None])
        for area, slope in zip(areas[0], slopes.T, strict=True):
            step = inverse @ slope
            spread = float(slope @ step)
            if area**2 < REACH**2 * _variance(equations, minimum) * spread:
                found.append(equations.retract(minimum.point, -2.0 * area / spread * step))
    return np.array(found).reshape(-1, len(minimum.point))


def _differ(equations: Assembled, minimum: Minimum, others: Sequence[Minimum]) -> Mask:
    """Which minima lie more than `SAME` standard deviations of one from it."""
    points = np.array([each.point for each in others]).reshape(-1, len(minimum.point))
    moves = steps_to(equations, minimum.point, points) @ minimum.jacobian.T
    return np.asarray(np.square(moves).sum(axis=1) > SAME**2 * _variance(equations, minimum))


def _variance(equations: Assembled, minimum: Minimum) -> float:
    return minimum.cost / max(equations.count - equations.dimension, 1)


def steps_to(equations: Assembled, point: Floats, others: Floats) -> Floats:
    """The steps (k, n) from a point (N,) to others (k, N); of rotations by large angles only roughly."""
    n = equations.dimension
    aligned = others.copy()
    for curved in equations.layout.curved:
        if curved.piece is Piece.QUATERNION:  # q and -q are one rotation
            here, there = point[curved.numbers], others[:, curved.numbers]
            aligned[:, curved.numbers] = np.where(np.sum(here * there, axis=2, keepdims=True) < 0.0, -there, there)
    moves = equations.retract(np.tile(point, (n, 1)), np.eye(n) * SMALL) - point
    return np.asarray(np.linalg.lstsq(moves.T / SMALL, (aligned - point).T, rcond=None)[0].T)


SMALL = 1e-4
"""Of a unit: how far coordinates move for the derivatives of numbers by them, which are constant to its square."""
