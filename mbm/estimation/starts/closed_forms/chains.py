"""Rows that know of several unknown poses only to where their product takes a point: the product, and what is between.

``h(P, Q, …) = f(P A Q B … x)``: unknown poses or their inverses, in an order and with known motions between them that
the equations tell when they are probed. Each pose alone, the others at rest, moves points (`moved_points`): the points
of the outer pose change with the inner one, and how they change is the motion between the two.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from itertools import pairwise

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.frames import WholeFrame, some_rotation
from mbm.estimation.starts.closed_forms.moved_points import MovedPoints, moved_points, points_of
from mbm.estimation.starts.closed_forms.rows import thinned
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Situation, Support
from mbm.problem.types import UnknownKind
from mbm.values import dataclass

FRAME = WholeFrame(dimension=3, moves=True, scales=False)

LONGEST = 8
"""Unknown poses of a product: cameras that stand one on another, the rig in the room, a board there. Each two are
probed, so that it is not any number."""

SAME_MOTION = 1e-7
"""Difference, beside the size, below which motions between two poses are one."""

REST = FRAME.numbers(np.ones(()), np.eye(3), np.zeros(3))
"""No motion."""

Lines = tuple[tuple[Group, Indices], ...]
"""Rows of some groups."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Link:
    """An unknown pose of a product, or its inverse, and which member (n,) of its family each row has there."""

    entry: Entry = field(repr=False)
    inverse: bool
    member: Indices

    def places(self, member: int) -> Indices:
        """Where the numbers (7,) of a member stand."""
        size = self.entry.unknown.size
        return np.arange(self.entry.offset + member * size, self.entry.offset + (member + 1) * size)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """Rows ``f(P₁ A₁ P₂ A₂ … Pₘ x)`` in which ``links`` are the poses, outermost first.

    ``moved`` has f, by the place of the point; ``points`` (n, 3) are x, ``turns`` (m - 1, n, 3, 3) and ``shifts``
    (m - 1, n, 3) the motions A. Rows of one ``product`` (n,), counted from 0, have the same members and motions.
    """

    links: tuple[Link, ...]
    moved: MovedPoints = field(repr=False)
    points: Floats
    turns: Floats
    shifts: Floats
    product: Indices

    def placed(self, motions: Sequence[tuple[Floats, Floats]]) -> Floats:
        """Where the points (n, 3) are when the poses, as they stand in the product, are the motions R, t."""
        place = self.points
        for k in reversed(range(len(motions))):
            R, t = motions[k]
            place = place @ R.T + t
            if k:
                place = np.einsum("nij,nj->ni", self.turns[k - 1], place) + self.shifts[k - 1]
        return place


def is_pose(entry: Entry) -> bool:
    """A pose of space."""
    return entry.unknown.kind is UnknownKind.POSE and entry.unknown.dimension == 3


def without_poses(situation: Situation) -> Floats:
    """The numbers (N,) that are known; of poses those alone that were known to begin with."""
    numbers = situation.numbers.copy()
    for entry in situation.layout.entries:
        if is_pose(entry):
            numbers[entry.range] = situation.asked[entry.range]
    return numbers


def with_poses(situation: Situation, poses: tuple[int, ...], shift: Floats) -> Situation:
    """With poses (by number) that do not turn, each farther along ``shift`` (3,) than that before."""
    numbers = situation.numbers.copy()
    for k, number in enumerate(poses):
        entry = situation.layout.entries[number]
        motion = FRAME.numbers(np.ones(()), np.eye(3), (1.0 + 0.37 * k) * shift)
        numbers[entry.range] = np.tile(motion, entry.members)
    return situation.with_numbers(numbers)


def rows_of_products(situation: Situation, group: Group, rows: Indices) -> Iterator[tuple[tuple[int, ...], Indices]]:
    """Those of some rows of a group that miss one member of each of some poses, and nothing else, by these poses."""
    layout = situation.layout
    number_of = layout.number_of()
    owners = np.array([number_of[slot.unknown] for slot in group.kernel.variables], dtype=np.int64)
    missing = np.isnan(situation.numbers)[group.index[rows]]
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        entries = tuple(np.unique(owners[pattern]).tolist())
        mine = rows[which.ravel() == k]
        if not entries or len(entries) > LONGEST or not all(is_pose(layout.entries[e]) for e in entries):
            continue
        single = np.ones(len(mine), dtype=bool)
        for e in entries:
            each = group.index[np.ix_(mine, np.flatnonzero(owners == e))] - layout.entries[e].offset
            each //= layout.entries[e].unknown.size
            single &= (each == each[:, :1]).all(axis=1)
        mine = mine[single]
        if situation.most is not None and len(mine) > situation.most:
            mine = mine[thinned(np.unique(group.index[mine], axis=0, return_inverse=True)[1].ravel(), situation.most)]
        if len(mine):
            yield entries, mine


def chain(situation: Situation, lines: Lines, entries: tuple[int, ...], width: int) -> Chain | None:
    """The product of poses through which rows of ``width`` components see a point, if that is all they know of them.

    The rows miss one member of each of ``entries`` and nothing else.
    """
    poses = tuple(pose_in(situation, lines, entry) for entry in entries)
    moved = []
    for pose in poses:
        candidate = alone_in(situation, lines, poses, pose, {})
        mine = moved_points(candidate, candidate.rows(width))
        if mine is None:
            return None
        moved.append(mine)
    probe = _Probe(situation=situation, lines=lines, poses=poses, moved=tuple(moved), width=width)
    order = probe.order()
    if order is None:
        return None
    between = [probe.between(outer, inner) for outer, inner in pairwise(order)]
    turns = np.array([R for R, _ in between]).reshape(-1, len(moved[0].points), 3, 3)
    if not np.allclose(np.swapaxes(turns, -1, -2) @ turns, np.eye(3), atol=AGREEMENT):
        return None
    links = tuple(Link(entry=poses[k].entry, inverse=moved[k].inverse, member=probe.members(k)) for k in order)
    shifts = np.array([t for _, t in between]).reshape(-1, len(turns[0]) if len(turns) else len(moved[0].points), 3)
    found = Chain(
        links=links,
        moved=moved[order[0]],
        points=moved[order[-1]].points,
        turns=turns,
        shifts=shifts,
        product=_products(links, turns, shifts),
    )
    return found if probe.holds(found, order) else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseInRows:
    """A family of poses, or one, and which member (r,) the rows of each group mention."""

    entry: Entry
    members: tuple[Indices, ...]


def pose_in(situation: Situation, lines: Lines, number: int) -> PoseInRows:
    """The pose of an entry (by number) in some rows that mention one member of it each."""
    entry = situation.layout.entries[number]
    found = []
    for group, rows in lines:
        first = next(j for j, slot in enumerate(group.kernel.variables) if slot.unknown == entry.unknown.name)
        found.append(np.asarray((group.index[rows, first] - entry.offset) // entry.unknown.size))
    return PoseInRows(entry=entry, members=tuple(found))


def alone_in(
    situation: Situation, lines: Lines, poses: tuple[PoseInRows, ...], pose: PoseInRows, others: Mapping[str, Floats]
) -> Candidate:
    """One pose as the only unknown; the others are at the numbers (7,) given by name, else at rest."""
    numbers = situation.numbers.copy()
    for each in poses:
        numbers[each.entry.range] = np.tile(others.get(each.entry.unknown.name, REST), each.entry.members)
    entry = pose.entry
    distinct, which = np.unique(np.concatenate(pose.members), return_inverse=True)
    mine = np.split(which, np.cumsum([len(m) for m in pose.members])[:-1])
    size, freedom = entry.unknown.size, entry.unknown.freedom
    return Candidate(
        situation=situation.with_numbers(numbers),
        support=Support((situation.layout.entries.index(entry),)),
        entries=(entry,),
        places=entry.offset + distinct[:, None] * size + np.arange(size),
        coordinates=entry.first + distinct[:, None] * freedom + np.arange(freedom),
        lines=tuple((group, rows, member) for (group, rows), member in zip(lines, mine, strict=True)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Probe:
    """Rows and their poses, with what each pose alone moves while the others are at rest."""

    situation: Situation
    lines: Lines
    poses: tuple[PoseInRows, ...]
    moved: tuple[MovedPoints, ...]
    width: int

    def members(self, k: int) -> Indices:
        """The member (n,) of pose k in each row."""
        return np.asarray(np.unique(np.concatenate(self.poses[k].members))[self.moved[k].rows.member])

    def order(self) -> tuple[int, ...] | None:
        """The poses from the outermost to the innermost: the points of one change with those within it."""
        within = np.zeros(len(self.poses), dtype=np.int64)
        for k, mine in enumerate(self.moved):
            for j in range(len(self.poses)):
                if j == k:
                    continue
                points = self.points(k, {j: (some_rotation(3, np.random.default_rng(1)), np.array([0.4, -0.3, 0.7]))})
                if points is None:
                    return None
                within[k] += bool(np.abs(points - mine.points).max() > AGREEMENT * (1.0 + np.abs(points).max()))
        order = np.argsort(-within, kind="stable")
        expected = np.arange(len(order))[::-1]
        return tuple(order.tolist()) if bool((within[order] == expected).all()) else None

    def points(self, k: int, others: Mapping[int, tuple[Floats, Floats]]) -> Floats | None:
        """The points (n, 3) that pose k moves with some others in a product as the motions R, t."""
        candidate = alone_in(self.situation, self.lines, self.poses, self.poses[k], self._numbers(others))
        rows = candidate.rows(self.width)
        return points_of(rows, FRAME, self.moved[k].inverse, np.random.default_rng(0))

    def _numbers(self, motions: Mapping[int, tuple[Floats, Floats]]) -> dict[str, Floats]:
        return {self.poses[k].entry.unknown.name: self.moved[k].numbers(R, t) for k, (R, t) in motions.items()}

    def between(self, outer: int, inner: int) -> tuple[Floats, Floats]:
        """The motions (n, 3, 3), (n, 3) between two poses that follow one another; NaN where points tell of none."""
        at_rest = self.moved[outer].points
        columns = []
        for axis in np.eye(3):
            points = self.points(outer, {inner: (np.eye(3), axis)})
            columns.append(np.full_like(at_rest, np.nan) if points is None else points - at_rest)
        R = np.stack(columns, axis=-1)
        return R, at_rest - np.einsum("nij,nj->ni", R, self.moved[inner].points)

    def holds(self, found: Chain, order: tuple[int, ...]) -> bool:
        """Whether the rows do depend on the place of the points alone."""
        generator = np.random.default_rng(0)
        size = 1.0 + float(np.abs(found.points).max())
        for _ in range(2):
            motions = {k: (some_rotation(3, generator), size * generator.uniform(0.3, 1.0, size=3)) for k in order}
            others = {k: motions[k] for k in order[1:]}
            candidate = alone_in(self.situation, self.lines, self.poses, self.poses[order[0]], self._numbers(others))
            own = self._numbers({order[0]: motions[order[0]]})[self.poses[order[0]].entry.unknown.name]
            direct = candidate.rows(self.width).values(own)
            place = found.placed([motions[k] for k in order])
            shifted, aside = found.moved.values(place), found.moved.values(place * 1.25)
            scale = np.abs(direct).max(axis=1) + np.abs(aside).max(axis=1)
            if not bool((np.abs(direct - shifted).max(axis=1) <= AGREEMENT * scale).all()):
                return False
        return True


def _products(links: Sequence[Link], turns: Floats, shifts: Floats) -> Indices:
    """A number for each row, the same for those with the same members and the same motions between."""
    members = np.stack([link.member for link in links])
    generator = np.random.default_rng(0)
    seen = np.einsum("mnij,mij->n", turns, generator.uniform(0.5, 1.0, size=(len(turns), 3, 3)))
    seen += np.einsum("mnj,mj->n", shifts, generator.uniform(0.5, 1.0, size=(len(turns), 3)))
    order = np.lexsort((seen, *members))
    apart = np.diff(seen[order]) > SAME_MOTION * (1.0 + np.abs(seen[order][1:]))
    apart |= (np.diff(members[:, order], axis=1) != 0).any(axis=0)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.concatenate([[0], np.cumsum(apart)])
    return number


def put_pose(result: Floats, places: Indices, mine: Indices, numbers: Floats) -> None:
    """Write a pose (7,) into a candidate's numbers (K, s) wherever its ``places`` have the places ``mine`` (7,)."""
    row, column = np.nonzero(places == mine[0])
    result[row[:, None], column[:, None] + np.arange(len(mine))] = numbers
