"""Photographs of points whose places are not known → where they were taken from and the points, but for the scale.

Two photographs give each other's pose by their rays (the epipolar equation); the points are where the rays meet, and
further photographs follow from these, which have more points meet. Hartley and Zisserman, Multiple View Geometry, 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.intersection import meeting_points
from mbm.estimation.starts.closed_forms.numerics.bearings import poses_from_bearings, some_rotations
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.rotations import cross_matrix, exponential
from mbm.values import dataclass

LEAST_RAYS = 5
"""Rays to common points that tell how two photographs lie to each other, up to ten ways."""

LEAST_KNOWN = 4
"""Points that tell a photograph's pose, mostly but one."""

DESCENT_STEPS = 30
"""Steps of Levenberg and Marquardt on a relative pose: it converges quadratically from most starts."""

LEAST_DAMPING = 1e-10
"""Beside the trace of the normal matrix: the length of t is free, and must not make it singular."""

SAME = 1e-3
"""Difference of essential matrices of length 1 below which they are one."""

MUCH_WORSE = 100.0
"""Beside the best, the squares of a relative pose, or of all photographs, that is left out; that of few may be 0."""

SMALLEST = 1e-10
"""Mean square of a ray, rad², below which rounding and the start's own coarseness decide: 10⁻⁵ rad."""

MOST_WAYS = 4
"""Relative poses that are followed: of a plane there are two, of five points some more."""

WIDE = 0.2
"""Sine of the angle between two rays beyond which a pair of photographs is no better for it."""

MOST_PAIRS = 45
"""Pairs of photographs that are tried for the first: all of ten."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class View:
    """A photograph's unit ``bearings`` (n, 3), in its own frame, of the ``points`` (n,) by number, ascending."""

    points: Indices
    bearings: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Structure:
    """``R`` (V, 3, 3), ``t`` (V, 3) of photographs and ``points`` (P, 3), NaN where nothing tells.

    A point that one photograph alone sees lies on its ray, as far away as the others of that photograph do on average.
    """

    R: Floats
    t: Floats
    points: Floats


def relative_poses(first: Floats, second: Floats) -> list[tuple[Floats, Floats]]:
    """R (3, 3), t (3,) of length 1 with ``second ~ R (s first) + t``, s > 0, for unit bearings (n, 3); best first.

    Minimises Sampson's distances of ``t · (R a × b) = 0`` (Kneip and Lynen, ICCV 2013, begin alike), which planes and
    few points suffer too, from rotations all over; those that see most points ahead are given. n ≥ 5.
    """
    R, t, cost = _epipolar(first, second)
    E = cross_matrix(t) @ R
    kept: list[int] = []
    for k in np.argsort(cost, kind="stable").tolist():
        if not cost[k] <= MUCH_WORSE * cost[kept[0] if kept else k] + SMALLEST * len(first):
            break
        if all(min(np.abs(E[k] - E[j]).max(), np.abs(E[k] + E[j]).max()) > SAME for j in kept):
            kept.append(k)
    ways = []
    for k in kept:
        turned = (2.0 * np.outer(t[k], t[k]) - np.eye(3)) @ R[k]
        four = [(rotation, sign * t[k]) for rotation in (R[k], turned) for sign in (1.0, -1.0)]
        ways.append(max((_ahead(*way, first, second), n, way) for n, way in enumerate(four)))
    most = max(ahead for ahead, _, _ in ways)
    return [way for ahead, _, way in ways if ahead == most][:MOST_WAYS]


def _ahead(R: Floats, t: Floats, first: Floats, second: Floats) -> int:
    """How many rays meet before both photographs."""
    turned = first @ R.T
    across = np.cross(turned, second)
    return int(
        (
            (np.einsum("ni,ni->n", np.cross(t, second), across) < 0)
            & (np.einsum("ni,ni->n", np.cross(t, turned), across) < 0)
        ).sum()
    )


def _epipolar(first: Floats, second: Floats) -> tuple[Floats, Floats, Floats]:
    """Minima (k, 3, 3), (k, 3) of Sampson's distances, and their sums of squares (k,)."""
    R = some_rotations()
    across = np.cross(np.einsum("kij,nj->kni", R, first), second)
    t = np.linalg.eigh(np.einsum("kni,knj->kij", across, across))[1][:, :, 0]
    values, J = _sampson(R, t, first, second)
    cost, damping = np.square(values).sum(axis=1), np.full(len(R), 1e-3)
    for _ in range(DESCENT_STEPS):
        normal = np.einsum("kna,knb->kab", J, J)
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        damped = normal + np.eye(6) * (damping[:, None, None] * size + 1e-300)
        step = -np.linalg.solve(damped, np.einsum("kna,kn->ka", J, values)[:, :, None])[:, :, 0]
        turned, shifted = exponential(step[:, :3]) @ R, t + step[:, 3:]
        shifted = shifted / np.linalg.norm(shifted, axis=1, keepdims=True)
        there, slopes = _sampson(turned, shifted, first, second)
        after = np.square(there).sum(axis=1)
        better = after < cost
        R, t = np.where(better[:, None, None], turned, R), np.where(better[:, None], shifted, t)
        values, J = np.where(better[:, None], there, values), np.where(better[:, None, None], slopes, J)
        cost = np.where(better, after, cost)
        damping = np.where(better, np.maximum(damping * 0.1, LEAST_DAMPING), damping * 10)
    return R, t, cost


def _sampson(R: Floats, t: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Distances (k, n), and their slopes (k, n, 6) by ω in ``Exp(ω) R`` and by t, the weights held."""
    turned = np.einsum("kij,nj->kni", R, first)
    across = np.cross(turned, second)
    aside = np.cross(t[:, None], second)
    size = np.square(np.cross(t[:, None], turned)).sum(axis=2) + np.square(aside).sum(axis=2)
    weight = 1.0 / np.sqrt(np.maximum(size, 1e-12))
    values = weight * np.einsum("kni,ki->kn", across, t)
    along = np.einsum("kni,ki,kj->knj", across, t, t)
    slopes = np.concatenate([-np.cross(turned, aside), across - along], axis=2)
    return values, weight[:, :, None] * slopes


def structures(views: Sequence[View], count: int) -> list[Structure]:
    """The ways in which ``count`` points may lie and photographs look at them, the first of a pair at rest.

    Two photographs may leave several, of which the others fit one.
    """
    pairs = sorted(combinations(range(len(views)), 2), key=lambda p: -len(_common(views, *p)[0]))[:MOST_PAIRS]
    best, ways = 0.0, list[tuple[Floats, Floats]]()
    chosen = (0, 0)
    for pair in pairs:
        one, other = _common(views, *pair)
        if len(one) < LEAST_RAYS or len(one) * WIDE <= best:
            break
        first, second = views[pair[0]].bearings[one], views[pair[1]].bearings[other]
        found = relative_poses(first, second)
        angle = np.median(np.linalg.norm(np.cross(first @ found[0][0].T, second), axis=1))
        suits = len(one) * min(float(angle), WIDE)
        if suits > best:
            best, ways, chosen = suits, found, pair
    grown = [_grown(views, count, chosen, way) for way in ways]
    misfits = [_misfit(views, each) for each in grown]
    return [each for each, own in zip(grown, misfits, strict=True) if own <= MUCH_WORSE * min(misfits) + SMALLEST]


def _misfit(views: Sequence[View], found: Structure) -> float:
    """The mean square by which unit bearings differ from those of a structure, of all whose points are known."""
    squares = []
    for view, R, t in zip(views, found.R, found.t, strict=True):
        seen = found.points[view.points] @ R.T + t
        with np.errstate(all="ignore"):
            squares.append(np.square(seen / np.linalg.norm(seen, axis=1, keepdims=True) - view.bearings).sum(axis=1))
    every = np.concatenate(squares)
    return float(every[np.isfinite(every)].mean())


def _common(views: Sequence[View], one: int, other: int) -> tuple[Indices, Indices]:
    """Which bearings of two photographs are of common points."""
    _, first, second = np.intersect1d(views[one].points, views[other].points, return_indices=True)
    return first, second


def _grown(views: Sequence[View], count: int, pair: tuple[int, int], way: tuple[Floats, Floats]) -> Structure:
    """From two photographs, by the one that sees most of what is known next, until none sees enough."""
    R, t = np.full((len(views), 3, 3), np.nan), np.full((len(views), 3), np.nan)
    R[pair[0]], t[pair[0]] = np.eye(3), 0.0
    R[pair[1]], t[pair[1]] = way
    left = set(range(len(views))) - set(pair)
    while True:
        points = _met(views, count, R, t)
        known = finite(points, 1)
        seen = {k: known[views[k].points] for k in left}
        following = max(left, key=lambda k: int(seen[k].sum()), default=None)
        if following is None or seen[following].sum() < LEAST_KNOWN:
            return Structure(R=R, t=t, points=_with_single_rays(views, R, t, points))
        left.remove(following)
        mine = seen[following]
        turns, shifts = poses_from_bearings(points[views[following].points[mine]], views[following].bearings[mine])
        if len(turns):
            R[following], t[following] = turns[0], shifts[0]


def _with_single_rays(views: Sequence[View], R: Floats, t: Floats, points: Floats) -> Floats:
    """The points (P, 3) with those that one photograph of known pose alone sees, on their rays."""
    found = points.copy()
    for k in np.flatnonzero(finite(t, 1)).tolist():
        mine = points[views[k].points]
        known = finite(mine, 1)
        far = np.median(np.linalg.norm(mine[known] @ R[k].T + t[k], axis=1)) if known.any() else np.nan
        found[views[k].points[~known]] = (far * views[k].bearings[~known] - t[k]) @ R[k]
    return found


def _met(views: Sequence[View], count: int, R: Floats, t: Floats) -> Floats:
    """Where the rays of photographs whose pose is known meet, (count, 3); NaN where less than two do."""
    placed = np.flatnonzero(finite(t, 1)).tolist()
    which = np.concatenate([views[k].points for k in placed])
    rays = np.concatenate([views[k].bearings @ R[k] for k in placed])
    origins = np.concatenate([np.tile(-t[k] @ R[k], (len(views[k].points), 1)) for k in placed])
    order = np.argsort(which, kind="stable")
    times = np.bincount(which, minlength=count)
    first = np.cumsum(times) - times
    found = np.full((count, 3), np.nan)
    for many in np.unique(times[times > 1]):
        mine = np.flatnonzero(times == many)
        rows = order[first[mine][:, None] + np.arange(many)]
        found[mine] = meeting_points(origins[rows], rays[rows])
    return found
