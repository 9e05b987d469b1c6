"""Photographs of points whose places are not known, from poses that are not known: both, and their scale."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.frames import Slopes
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points
from mbm.estimation.starts.closed_forms.numerics.structure import LEAST_RAYS, Structure, View, structures
from mbm.estimation.starts.closed_forms.pose_from_points import rays_of
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation
from mbm.values import dataclass

SCALES = np.geomspace(1e-6, 1e6, 241)
"""Lengths of the first baseline among which the one that what else is measured suits best is looked for."""

FINER = 8
"""How often the best scale is looked for between those beside it, a tenth as far apart each time."""

SAME_PLACE = 1e-6
"""Distance, beside the extent of what the probed points are, within which a row's point is one of these."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceFrame:
    """A point that is itself unknown, as the motion that takes the origin there."""

    dimension: int = 3
    moves: bool = True
    scales: bool = False

    def numbers(self, c: Floats, R: Floats, t: Floats) -> Floats:
        """The place."""
        del c, R
        return t

    def slopes(self, derivatives: Floats, R: Floats) -> Slopes:
        """Those by the place; it does not turn."""
        del R
        return Slopes(rotation=np.zeros_like(derivatives), translation=derivatives)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photographs:
    """Views of the members of ``cloud``; those of the candidate ``poses`` (its frame in ``moved``) come first.

    ``centres`` (k, 3) are the places of the other views, which are not turned. ``used`` are the groups of their rows.
    """

    cloud: Entry
    poses: Candidate
    moved: MovedPoints
    views: tuple[View, ...]
    centres: Floats
    used: frozenset[int]


@dataclass(frozen=True, slots=True)
class StructureFromMotion:
    """Relative poses by the epipolar equation, the points where rays meet, then one photograph after the other.

    The frame is that of a photograph whose pose is known, or of the first; the scale is that which suits what else is
    measured best, distances or baselines, else the first two photographs are 1 apart.
    """

    name: str = "structure-from-motion"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that see members of a family of points from unknown poses."""
        if candidate.paired or len(candidate.entries) < 2:
            return None
        for number in candidate.support.entries:
            if is_cloud(situation.layout.entries[number]):
                found = photographs(situation, candidate, number)
                if found is not None:
                    rows = Rows.without_numbers(sum(len(view.points) for view in found.views), 2)
                    return Plan(form=self, candidate=candidate, rows=rows, minimal=2 * LEAST_RAYS, data=found)
        return None

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """The ways in which photographs and points may lie, (1, S, K·s); it takes all rows."""
        del subsets
        seen: Photographs = plan.data
        ways = structures(seen.views, seen.cloud.members)
        solved = [placed(seen, plan.candidate.situation, each)[plan.candidate.places].ravel() for each in ways]
        return np.stack(solved)[None] if solved else np.full((1, 1, plan.candidate.places.size), np.nan)


def is_cloud(entry: Entry) -> bool:
    """Whether an unknown is a family of places, enough to tell how photographs lie."""
    unknown = entry.unknown
    return unknown.size == 3 and unknown.manifold.flat and not unknown.dimension and entry.members >= LEAST_RAYS


def photographs(situation: Situation, candidate: Candidate, number: int) -> Photographs | None:
    """The views of a family of points (the unknown of this ``number``), if rows see them from all unknown poses."""
    cloud = situation.layout.entries[number]
    member = {e: members_of(candidate, situation.layout.entries[e]) for e in candidate.support.entries}
    absent = np.unique(member.pop(number))
    if candidate.places[:, _columns(candidate, cloud)].shape[1] != cloud.unknown.size:
        return None
    scattered = np.random.default_rng(0).uniform(-1.0, 1.0, (len(absent), 3))
    scattered = scattered[np.argsort(scattered[:, 0])]
    probed = situation.numbers.copy()
    probed[cloud.offset + 3 * absent[:, None] + np.arange(3)] = scattered
    takers = np.unique(np.stack([*member.values()], axis=1), axis=0)
    poses = situation.with_numbers(probed).candidate(tuple(member), takers)
    moved = None if poses is None else moved_points(poses, poses.rows(2))
    if poses is None or moved is None or moved.frame.dimension != 3 or moved.frame.scales:
        return None
    between = (scattered[1:, 0] + scattered[:-1, 0]) / 2
    which = np.searchsorted(between, moved.points[:, 0])
    same = (np.abs(moved.points - scattered[which]) <= SAME_PLACE).all(axis=1)
    rays = rays_of(poses.situation, moved, moved.points, moved.rows.member)
    if rays is None or rays.origins.any():
        return None
    same &= finite(rays.directions, 1)
    views = _views(moved.rows.member[same], absent[which[same]], rays.directions[same], poses.members)
    known = _from_known_places(situation, number, absent)
    return Photographs(
        cloud=cloud,
        poses=poses,
        moved=moved,
        views=(*views, *known.views),
        centres=known.centres,
        used=known.groups | {piece.group.number for piece in moved.rows.pieces},
    )


def _columns(candidate: Candidate, entry: Entry) -> Indices:
    """Where a candidate's places are of an unknown."""
    return np.flatnonzero((candidate.places[0] >= entry.range.start) & (candidate.places[0] < entry.range.stop))


def members_of(candidate: Candidate, entry: Entry) -> Indices:
    """Which member of an unknown each member (K,) of a candidate has."""
    return np.asarray((candidate.places[:, _columns(candidate, entry)[0]] - entry.offset) // entry.unknown.size)


def _views(view: Indices, point: Indices, bearings: Floats, count: int) -> tuple[View, ...]:
    """One for each of ``count`` numbers; a point that is seen twice there counts once."""
    found = []
    for k in range(count):
        mine = np.flatnonzero(view == k)
        points, first = np.unique(point[mine], return_index=True)
        found.append(View(points=points, bearings=bearings[mine[first]]))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """``views`` that are not turned from ``centres`` (k, 3), and the numbers of the groups that tell."""

    views: tuple[View, ...]
    centres: Floats
    groups: frozenset[int]


def _from_known_places(situation: Situation, number: int, absent: Indices) -> Known:
    """What sees the members ``absent`` of a family of points, and nothing else that is not known."""
    nothing = Known(views=(), centres=np.empty((0, 3)), groups=frozenset())
    alone = situation.candidate((number,), absent[:, None])
    rows = None if alone is None else alone.rows(2)
    if rows is None or not len(rows):
        return nothing
    moved = MovedPoints(rows=rows, frame=PlaceFrame(), inverse=False, points=np.zeros((len(rows), 3)))
    rays = rays_of(situation, moved, moved.points, np.zeros(len(rows), dtype=np.int64))
    if rays is None:
        return nothing
    seen = finite(rays.directions, 1)
    origins = rays.origins[seen]
    size = max(float(np.abs(origins).max(initial=0.0)), 1.0)
    _, first, which = np.unique(np.round(origins / size / SAME_PLACE), axis=0, return_index=True, return_inverse=True)
    views = _views(which.ravel(), absent[rows.member[seen]], rays.directions[seen], len(first))
    return Known(views=views, centres=origins[first], groups=frozenset(piece.group.number for piece in rows.pieces))


def placed(seen: Photographs, situation: Situation, found: Structure) -> Floats:
    """All numbers (N,), with a structure in the frame of the problem and of the size that suits best."""
    count = seen.poses.members
    known = [k for k in range(count, len(seen.views)) if bool(np.isfinite(found.t[k]).all())]
    rest = known[0] if known else int(np.flatnonzero(finite(found.t, 1))[0])
    centre = seen.centres[rest - count] if known else np.zeros(3)
    R = found.R[:count] @ found.R[rest].T
    t = found.t[:count] - R @ found.t[rest]
    points = found.points @ found.R[rest].T + found.t[rest]

    def sized(scale: float) -> Floats:
        numbers = situation.numbers.copy()
        numbers[seen.poses.places] = seen.moved.numbers(R, scale * t - R @ centre)
        wanted = np.isnan(numbers[seen.cloud.range])
        numbers[seen.cloud.range] = np.where(wanted, (scale * points + centre).ravel(), numbers[seen.cloud.range])
        return numbers

    none, one = sized(0.0), sized(1.0)  # places alone grow
    others = [group for group in situation.groups if group.rows and group.number not in seen.used]
    scales, width = SCALES, float(np.log(SCALES[1] / SCALES[0]))
    for _ in range(FINER if others else 0):
        with np.errstate(all="ignore"):
            trials = none + scales[:, None] * (one - none)
            costs = sum(squares(group, trials) for group in others)
        best = float(scales[int(np.argmin(costs))]) if np.ptp(costs) > 0 else 1.0
        scales, width = best * np.exp(width * np.linspace(-1.0, 1.0, 21)), width / 10
    return none + (best if others else 1.0) * (one - none)


def squares(group: Group, points: Floats) -> Floats:
    """The sum of squares (P,) at points (P, N) of a group's outputs that have values there, weighted."""
    values = group.whitened(group.values_at(points))
    return np.asarray(np.square(np.where(np.isfinite(values), values, 0.0)).sum(axis=(1, 2)))


STRUCTURE_FROM_MOTION = StructureFromMotion()
