"""Images of known points, or bearings of landmarks: the pose of the eye, or of the object before it."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.native.code import AnyCode
from mbm.estimation.starts.closed_forms.cameras import outlook
from mbm.estimation.starts.closed_forms.intersection import directions
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.numerics.bearings import (
    plane_poses_from_bearings,
    poses_from_bearings,
    poses_from_three,
    poses_of_most,
)
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.values import dataclass

CENTRAL = 1e-7
"""Change of an image when its point moves along the line of sight, beside that when it moves across."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sights:
    """Rows that see ``points`` (n, d) along unit ``bearings`` (n, d)."""

    moved: MovedPoints
    bearings: Floats


@dataclass(frozen=True, slots=True)
class PoseFromPoints:
    """Three points: Grunert's P3P, up to four poses; more: least squares in object space, planar points or not.

    The camera is whatever the equations say: its lines of sight are found by probing, distortion undone by Newton.
    """

    name: str = "pose-from-points"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that depend on a moved point through its direction alone."""
        for dimension in (3, 2):
            moved = moved_points(candidate, candidate.rows(dimension - 1))
            if moved is None or moved.frame.dimension != dimension or moved.frame.scales or not is_central(moved):
                continue
            bearings = bearings_of(situation, moved, moved.points, moved.rows.member)
            seen = finite(bearings, 1)
            if int(seen.sum()) < 3:
                return None
            sights = Sights(moved=moved.picked(seen), bearings=bearings[seen])
            return Plan(form=self, candidate=candidate, rows=sights.moved.rows, minimal=3, data=sights)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """Up to four poses for each subset of three, two for more."""
        sights: Sights = plan.data
        points, bearings = sights.moved.points[subsets], sights.bearings[subsets]
        if points.shape[-1] == 2:
            R, t = plane_poses_from_bearings(points, bearings)
        elif subsets.shape[1] == 3:
            R, t = poses_from_three(plan.rows.code, points, bearings)
        else:
            R, t = _least_squares(plan.rows.code, points, bearings, plan.rows.weight[subsets])
        if sights.moved.inverse:
            R = np.swapaxes(R, -1, -2)
            t = -np.einsum("...ij,...j->...i", R, t)
        return sights.moved.frame.numbers(np.ones(t.shape[:-1]), R, t)


def _least_squares(code: AnyCode, points: Floats, bearings: Floats, weights: Floats) -> tuple[Floats, Floats]:
    R, t = np.full((len(points), 2, 3, 3), np.nan), np.full((len(points), 2, 3), np.nan)
    for i in range(len(points)):
        found, shift = poses_of_most(code, points[i], bearings[i], weights[i])
        R[i, : len(found)], t[i, : len(found)] = found, shift
    return R, t


def is_central(moved: MovedPoints) -> bool:
    """Whether the rows do not notice when the point moves along its line of sight."""
    generator = np.random.default_rng(0)
    for _ in range(3):
        place = generator.uniform(0.5, 1.5, size=moved.points.shape)
        slopes = moved.slopes(place)
        along = np.abs(np.einsum("nwd,nd->nw", slopes, place)).max(axis=1)
        across = np.abs(slopes).max(axis=(1, 2))
        if not bool((along <= CENTRAL * across).all()) or not bool((across > 0).all()):
            return False
    return True


def bearings_of(situation: Situation, moved: MovedPoints, points: Floats, view: Indices) -> Floats:
    """Lines of sight (n, d), NaN where none is found, of ``points`` (n, d) that are seen together in each ``view``.

    The search begins where the cameras look, then along z (OpenCV), x (the paper's axes), y. A pinhole does not tell
    front from back: its focal lengths say where it looks.
    """
    if moved.points.shape[1] == 2:
        return directions(moved.values, moved.slopes, len(moved.points), [*np.eye(2), *-np.eye(2)])
    ways = outlook(situation, moved.rows)
    known = finite(ways, 1)
    starts = [*np.unique(ways[known], axis=0), *np.eye(3)[[2, 0, 1]]]
    found = directions(moved.values, moved.slopes, len(moved.points), starts)
    found = np.where((np.einsum("ni,ni->n", found, ways) < 0)[:, None], -found, found)
    open_ones = ~known & finite(found, 1)
    if open_ones.any() and _faces_back(moved.picked(open_ones), points[open_ones], found[open_ones], view[open_ones]):
        found[open_ones] *= -1.0
    return found


def _faces_back(moved: MovedPoints, points: Floats, bearings: Floats, view: Indices) -> bool:
    """Whether equations that say nothing of a camera are those of one that looks along a negative axis, as BAL's do.

    Points in general position tell: only one side sees them unmirrored.
    """
    if not _turned_round(moved, bearings):
        return False
    first, misfits = view == view[0], list[float]()
    points, bearings = points[first], bearings[first]
    if np.linalg.matrix_rank(points - points[0], tol=AGREEMENT * np.ptp(points, axis=0).max()) < 3:
        return False
    for sign in (1.0, -1.0):
        R, t = poses_from_bearings(points, sign * bearings)
        if not len(R):
            misfits.append(np.inf)
            continue
        seen = points @ R[0].T + t[0]
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        misfits.append(float(np.median(np.linalg.norm(seen - sign * bearings, axis=1))))
    return misfits[1] < 0.1 * misfits[0]


def _turned_round(moved: MovedPoints, bearings: Floats) -> bool:
    """Whether both image coordinates fall where the lateral coordinates grow: a camera that looks the other way, or
    residuals of the other sign.
    """
    ahead = bearings.mean(axis=0)
    axis = int(np.argmax(np.abs(ahead)))
    lateral = [(axis + 1) % 3, (axis + 2) % 3]
    slopes = moved.slopes(ahead)[:, :, lateral]
    return bool((slopes[:, 0, 0] < 0).all() and (slopes[:, 1, 1] < 0).all())


POSE_FROM_POINTS = PoseFromPoints()
