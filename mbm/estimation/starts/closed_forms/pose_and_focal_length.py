"""Images of known points by a camera whose focal length is unknown, and a pose in plain numbers: angles or a vector."""

from __future__ import annotations

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.cameras import LEAST_POINTS, usual
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.numerics.bearings import poses_from_bearings
from mbm.estimation.starts.closed_forms.pose_from_points import rays_of
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Plan, Situation
from mbm.values import dataclass

LENGTHS = np.geomspace(0.3, 30.0, 24)
"""Focal lengths that are tried, beside the extent of the image: from 118° to 2° across; each fifth more is one."""

NUMBERS = 7
"""Three of a rotation, three of a position, the focal length."""

PLACE = np.array([0.3, -0.2, 1.7])
"""Where points are put to see what the focal length does."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trials:
    """``moved`` points with each of the focal lengths (F, K) of the members of ``owner``, and bearings (F, n, 3)."""

    owner: Entry
    moved: MovedPoints
    lengths: Floats
    bearings: Floats


@dataclass(frozen=True, slots=True)
class PoseAndFocalLength:
    """The pose for each of some focal lengths, and the one of these that suits the image best."""

    name: str = "pose-and-focal-length"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that move a point and show it in proportion to one more number."""
        if not candidate.flat or candidate.coupled or candidate.paired or candidate.places.shape[1] != NUMBERS:
            return None
        for owner in candidate.entries:
            if owner.unknown.size == 1 and not situation.layout.angle[owner.first]:
                found = _trials(situation, candidate, owner)
                if found is not None:
                    rows = found.moved.rows
                    return Plan(form=self, candidate=candidate, rows=rows, minimal=LEAST_POINTS, data=found)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution of all members for each subset, (T, 1, K·s); NaN where nothing fits."""
        return np.stack([_solved(plan, subset) for subset in subsets])[:, None, :]


def _trials(situation: Situation, candidate: Candidate, owner: Entry) -> Trials | None:
    """The rows as images with a focal length, which is that unknown; None if they are none."""
    column = _column(candidate, owner)
    places = candidate.places[:, column]
    ones = usual(situation, places, candidate.coordinates[:, column])
    first, second = (_moved(situation, candidate, owner, size * ones) for size in (1.0, 2.0))
    if first is None or second is None:
        return None
    steep, twice = first[1].slopes(PLACE), second[1].slopes(PLACE)
    if not bool((np.abs(twice - 2.0 * steep) <= AGREEMENT * np.abs(steep).max()).all()):
        return None
    image, member = first[1].values(PLACE), first[1].rows.member
    extents = [np.ptp(image[member == k], axis=0).max(initial=0.0) for k in range(candidate.members)]
    lengths = LENGTHS[:, None] * np.where(np.array(extents) > 0.0, extents, 1.0) * ones
    bearings = []
    for each in lengths:
        made = _moved(situation, candidate, owner, each)
        rays = None if made is None else rays_of(made[0], made[1], made[1].points, made[1].rows.member)
        if rays is None or rays.origins.any():
            return None
        bearings.append(rays.directions)
    return Trials(owner=owner, moved=first[1], lengths=lengths, bearings=np.stack(bearings))


def _moved(
    situation: Situation, candidate: Candidate, owner: Entry, lengths: Floats
) -> tuple[Situation, MovedPoints] | None:
    """The points that the rest of a candidate moves, with focal lengths (K,) given."""
    numbers = situation.numbers.copy()
    numbers[candidate.places[:, _column(candidate, owner)]] = lengths
    others = [(e, entry) for e, entry in zip(candidate.support.entries, candidate.entries, strict=True)]
    others = [(e, entry) for e, entry in others if entry is not owner]
    members = [(candidate.places[:, _column(candidate, e)] - e.offset) // e.unknown.size for _, e in others]
    given = situation.with_numbers(numbers)
    poses = given.candidate(tuple(e for e, _ in others), np.stack(members, axis=1))
    moved = None if poses is None else moved_points(poses, poses.rows(2))
    if moved is None or moved.frame.dimension != 3 or moved.frame.scales:
        return None
    return given, moved


def _column(candidate: Candidate, entry: Entry) -> int:
    """The first of a candidate's numbers that is of an unknown."""
    inside = (candidate.places[0] >= entry.range.start) & (candidate.places[0] < entry.range.stop)
    return int(np.flatnonzero(inside)[0])


def _solved(plan: Plan, subset: Indices) -> Floats:
    seen: Trials = plan.data
    places = plan.candidate.places
    column = _column(plan.candidate, seen.owner)
    found = np.full(places.shape, np.nan)
    for k in range(len(places)):
        mine = subset[plan.rows.member[subset] == k]
        best = np.inf
        for length, bearings in zip(seen.lengths[:, k], seen.bearings[:, mine], strict=True):
            usable = finite(bearings, 1)
            points, rays = seen.moved.points[mine][usable], bearings[usable]
            if len(points) < LEAST_POINTS:
                continue
            R, t = poses_from_bearings(points, rays)
            if not len(R):
                continue
            towards = points @ R[0].T + t[0]
            towards /= np.linalg.norm(towards, axis=1, keepdims=True)
            misfit = float(np.square(length * (towards - rays)).sum(axis=1).mean())
            if misfit < best:
                best = misfit
                found[k] = np.insert(seen.moved.numbers(R[0], t[0]), column, length)
    return found.ravel()


POSE_AND_FOCAL_LENGTH = PoseAndFocalLength()
