"""Fits to measured contours: the lower minima around one, and those on the other side of a face seen nearly edge-on.

And the poses in which an object looks the same, of those that the search has not met: the motion from one such pose to
another is a symmetry of the object, wherever the two were found, and what it makes of the best looks the same as that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress, permutations

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.metric import minimum_norms, rounding_at
from mbm.equations.types import Floats, Mask, Minimum
from mbm.estimation.minimise.minimise import minima
from mbm.estimation.search.basins import equal_costs, same_minimum
from mbm.estimation.search.search import Found, Tally, other_minimum, search
from mbm.estimation.search.starting import Beginning
from mbm.estimation.search.twins import Agreement, separation
from mbm.estimation.search.valleys import Walks
from mbm.estimation.settings import Settings
from mbm.estimation.starts.closed_forms.motions import inverse, product
from mbm.estimation.starts.random_starts import costs
from mbm.estimation.starts.silhouettes.hulls import pictures_of
from mbm.expression.nodes import Outlined
from mbm.problem.manifold import Piece
from mbm.problem.types import Problem, UnknownKind
from mbm.solver.decisions import takes_over

TURN = np.radians(5.0)
"""Of a bracket that went astray, two in three turns by 2° to 10° about an axis led to the truth."""

ASTRAY = 0.2
"""Correlation of residuals along a contour from which they may be no noise: a hundred of these have ± 0.1."""

FAR = 2.2
"""Root mean square of residuals over the median of their sizes from which some may be no noise: of that it is 1.48."""

LEAST_ROWS = 3
"""Rows of a contour below which residuals have no neighbours that could be alike."""

ROUNDS = 3

MOST_TURNED = 12
"""Faces that are turned to their other side, those first whose images change the most: meshes have thousands."""


def with_turns(equations: Assembled, found: Found, settings: Settings, problem: Problem, agrees: Agreement) -> Found:
    """``found``, or the lowest of the minima that turned poses lead to."""
    for _ in range(ROUNDS):
        asked = settings.starts is not None or settings.robust is not None or settings.stopped()
        if asked or not _astray(equations, found.minimum):
            break
        alike = [each.minimum for each in found.alternatives if equal_costs(each.minimum.cost, found.minimum.cost)]
        points = np.concatenate([_turned(equations, each.point) for each in (found.minimum, *alike)])
        if not len(points):
            break
        starts = tuple(Beginning(point=point, origin=found.origin) for point in points)
        other = search(equations, starts, settings, problem, agrees)
        if not other.minimum.reason.converged:
            break
        lower = takes_over(found.minimum.cost, other.minimum.cost, rounding_at(equations, found.minimum))
        best = other if lower else found
        found = replace(
            best,
            tally=_together(found, other, best),
            iterations=found.iterations + other.iterations,
            evaluations=found.evaluations + other.evaluations,
        )
        if not lower:
            break
    return found


def _astray(equations: Assembled, minimum: Minimum) -> bool:
    """Whether residuals along a contour are no noise: neighbouring ones are alike, or some far beyond the others."""
    if not minimum.reason.converged or len(minimum.residuals) != equations.count:
        return False
    if np.sqrt(minimum.cost) <= rounding_at(equations, minimum):
        return False
    for own in _along_contours(equations, minimum.residuals):
        if len(own) < LEAST_ROWS:
            continue
        squares = np.square(own)
        alike = float(np.square(np.diff(own)).sum()) < 2 * (1 - ASTRAY) * float(squares.sum())
        if alike or float(squares.mean()) > FAR**2 * float(np.median(squares)):
            return True
    return False


def _along_contours(equations: Assembled, residuals: Floats) -> Iterator[Floats]:
    for group in equations.groups:
        calls = (call.external for call in group.kernel.calls)
        if any(isinstance(each, Outlined) and each.function == "contour-distance" for each in calls):
            yield residuals[group.first : group.first + group.count]


def _turned(equations: Assembled, point: Floats) -> Floats:
    """The point (N,) after turns both ways of each rotation about its axes, and of each angle (T, N)."""
    layout = equations.layout
    turning = layout.angle.copy()
    for curved in layout.curved:
        if curved.piece is Piece.QUATERNION:
            turning[curved.coordinates] = True
    free = np.zeros(len(turning), dtype=bool)
    free[equations.free] = True
    steps = np.eye(len(turning))[turning & free] * TURN
    steps = np.concatenate([steps, -steps])
    return layout.retract(np.tile(point, (len(steps), 1)), steps)


def _together(first: Found, second: Found, best: Found) -> Tally:
    """What was tried in both searches, and how many of them all reached the cost of the best."""
    tallies = [each.tally or Tally(tried=1, converged=1, best_found=1) for each in (first, second)]
    lowest = [equal_costs(each.minimum.cost, best.minimum.cost) for each in (first, second)]
    return Tally(
        tried=sum(each.tried for each in tallies),
        converged=sum(each.converged for each in tallies),
        best_found=sum(each.best_found for each, low in zip(tallies, lowest, strict=True) if low),
    )


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
    free = equations.is_free
    steps = np.diag(PROBE / np.maximum(minimum_norms(minimum), 1e-300))
    moved = equations.retract(np.tile(minimum.point, (2 * n + 1, 1)), np.vstack([np.zeros((1, n)), steps, -steps]))
    inverse = np.linalg.pinv(minimum.jacobian.T @ minimum.jacobian, hermitian=True)
    found = []
    for picture in pictures_of(equations, minimum.point, free, seed):
        areas = picture.stream.functions.areas_of_flats(picture.called, picture.numbers(moved))
        slopes = (areas[1 : n + 1] - areas[n + 1 :]) / (2.0 * np.diag(steps)[:, None])
        ways = inverse @ slopes
        spreads = np.sum(slopes * ways, axis=0)
        near = np.flatnonzero(areas[0] ** 2 < REACH**2 * _variance(equations, minimum) * spreads)
        for face in near[np.argsort(-spreads[near], kind="stable")][:MOST_TURNED].tolist():
            step = -2.0 * areas[0, face] / spreads[face] * ways[:, face]
            found.append(equations.retract(minimum.point, step))
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


MOST = 24
"""Rotations of a cube onto itself; beyond these an object is round, and its pose free."""

ALIKE = 1e-2
"""Of the cost: what a motion between two minima, each a little off its own, adds to that of a third."""

POSE = 7
"""Numbers of a pose of space."""


def with_symmetric_ones(equations: Assembled, found: Found, settings: Settings, problem: Problem) -> Found:
    """``found`` with those minima that look the same as the best and follow from the others."""
    walks, known = Walks(equations, settings.stopped), [found.minimum, *(each.minimum for each in found.alternatives)]
    added: list[Minimum] = []
    more = True
    while more and len(added) < MOST and not settings.stopped():
        more = False
        for point in _symmetric(equations, found.minimum, known):
            other = next(iter(minima(equations, point[None], settings, problem.span)))
            alike = other.reason.converged and equal_costs(other.cost, found.minimum.cost)
            if alike and not any(same_minimum(walks, each, other) for each in known):
                known.append(other)
                added.append(other)
                more = True
                break
    every = (*found.alternatives, *(other_minimum(equations, each, 1) for each in added))
    return replace(
        found,
        alternatives=tuple(sorted(every, key=lambda a: a.minimum.cost)),
        iterations=found.iterations + sum(each.iterations for each in added),
        evaluations=found.evaluations + sum(each.evaluations for each in added),
    )


def _symmetric(equations: Assembled, best: Minimum, known: Sequence[Minimum]) -> Iterator[Floats]:
    """The points (N,) to which motions between minima of one cost take the best one, if they cost hardly more."""
    pairs = [(a.point, b.point) for a, b in permutations(known, 2) if equal_costs(a.cost, b.cost)]
    if not pairs:
        return
    one, other = (np.stack(each) for each in zip(*pairs, strict=True))
    for entry in equations.layout.entries:
        if entry.unknown.kind is not UnknownKind.POSE or entry.unknown.size != POSE:
            continue
        for first in range(entry.offset, entry.offset + entry.count, POSE):
            own = slice(first, first + POSE)
            points = np.tile(best.point, (len(pairs), 1))
            between = product(entry, inverse(entry, one[:, own]), other[:, own])
            points[:, own] = product(entry, points[:, own], between)
            near = points[costs(equations, points) <= (1.0 + ALIKE) * best.cost]
            yield from (point for point in near if not any(_is(equations, each, point) for each in known))


def _is(equations: Assembled, minimum: Minimum, point: Floats) -> bool:
    """Whether a point is no farther from a minimum than a motion between two others may be off."""
    moved = separation(equations, minimum.point, point[None])[0] * minimum_norms(minimum)
    return float(moved @ moved) <= ALIKE * minimum.cost
