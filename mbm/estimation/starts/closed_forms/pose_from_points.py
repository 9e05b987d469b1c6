"""Images of known points, or bearings of landmarks: the pose of the eye, or of the object before it."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.cameras import outlook
from mbm.estimation.starts.closed_forms.intersection import Rays, directions, origins_of
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
    """Rows that see ``points`` (n, d) along unit ``bearings`` (n, d) from ``origins`` (n, d), or all from 0 (None)."""

    moved: MovedPoints
    bearings: Floats
    origins: Floats | None = None


@dataclass(frozen=True, slots=True)
class PoseFromPoints:
    """Three points: Grunert's P3P, up to four poses; more: least squares in object space, planar points or not.

    The camera is whatever the equations say: its lines of sight are found by probing, distortion undone by Newton. So
    are several at known places of one body, from four points on.
    """

    name: str = "pose-from-points"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that depend on a moved point through its direction alone, from places of their own."""
        for dimension in (3, 2):
            moved = moved_points(candidate, candidate.rows(dimension - 1))
            if moved is None or moved.frame.dimension != dimension or moved.frame.scales:
                continue
            rays = rays_of(situation, moved, moved.points, moved.rows.member)
            if rays is None:
                continue
            seen = finite(rays.directions, 1)
            if int(seen.sum()) < 3:
                return None
            origins = rays.origins[seen] if rays.origins.any() else None
            sights = Sights(moved=moved.picked(seen), bearings=rays.directions[seen], origins=origins)
            least = 3 if origins is None else 4
            return Plan(form=self, candidate=candidate, rows=sights.moved.rows, minimal=least, data=sights)
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
            R, t = _least_squares(plan, subsets)
        return sights.moved.numbers(R, t)


def _least_squares(plan: Plan, subsets: Indices) -> tuple[Floats, Floats]:
    sights: Sights = plan.data
    R, t = np.full((len(subsets), 2, 3, 3), np.nan), np.full((len(subsets), 2, 3), np.nan)
    for i, mine in enumerate(subsets):
        origins = None if sights.origins is None else sights.origins[mine]
        seen = sights.moved.points[mine], sights.bearings[mine], plan.rows.weight[mine], origins
        found, shift = poses_of_most(plan.rows.code, *seen)
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


def rays_of(situation: Situation, moved: MovedPoints, points: Floats, view: Indices) -> Rays | None:
    """The lines of sight of ``points`` (n, d) that are seen together in each ``view``; directions NaN: none is found.

    The search begins where the cameras look, then along z (OpenCV), x (the paper's axes), y. A pinhole does not tell
    front from back: its focal lengths say where it looks. None if the rows see no points along lines.
    """
    count, d = moved.points.shape
    origins: Floats | None = np.zeros((count, d))
    if not is_central(moved):
        origins = origins_of(moved.slopes, count, d) if d == 3 else None
    if origins is None:
        return None
    ways = outlook(situation, moved) if d == 3 else np.full((count, d), np.nan)
    known = finite(ways, 1)
    usual_ones = [*np.eye(3)[[2, 0, 1]]] if d == 3 else [*np.eye(2), *-np.eye(2)]
    starts = [*np.unique(ways[known], axis=0), *usual_ones]
    found = directions(lambda x: moved.values(origins + x), lambda x: moved.slopes(origins + x), count, starts)
    found = np.where((np.einsum("ni,ni->n", found, ways) < 0)[:, None], -found, found)
    open_ones = ~known & finite(found, 1)
    if d == 3 and open_ones.any():
        seen = Rays(origins=origins[open_ones], directions=found[open_ones])
        if _faces_back(moved.picked(open_ones), points[open_ones], seen, view[open_ones]):
            found[open_ones] *= -1.0
    return Rays(origins=origins, directions=found)


def _faces_back(moved: MovedPoints, points: Floats, rays: Rays, view: Indices) -> bool:
    """Whether equations that say nothing of a camera are those of one that looks along a negative axis, as BAL's do.

    Points in general position tell: only one side sees them unmirrored.
    """
    if not _turned_round(moved, rays):
        return False
    first, misfits = view == view[0], list[float]()
    points, bearings, origins = points[first], rays.directions[first], rays.origins[first]
    if np.linalg.matrix_rank(points - points[0], tol=AGREEMENT * np.ptp(points, axis=0).max()) < 3:
        return False
    for sign in (1.0, -1.0):
        R, t = poses_from_bearings(points, sign * bearings, None, origins)
        if not len(R):
            misfits.append(np.inf)
            continue
        seen = points @ R[0].T + t[0] - origins
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        misfits.append(float(np.median(np.linalg.norm(seen - sign * bearings, axis=1))))
    return misfits[1] < 0.1 * misfits[0]


def _turned_round(moved: MovedPoints, rays: Rays) -> bool:
    """Whether both image coordinates fall where the lateral coordinates grow: a camera that looks the other way, or
    residuals of the other sign.
    """
    ahead = rays.directions.mean(axis=0)
    axis = int(np.argmax(np.abs(ahead)))
    lateral = [(axis + 1) % 3, (axis + 2) % 3]
    slopes = moved.slopes(rays.origins + ahead)[:, :, lateral]
    return bool((slopes[:, 0, 0] < 0).all() and (slopes[:, 1, 1] < 0).all())


POSE_FROM_POINTS = PoseFromPoints()
