"""Products of unknown poses ``P₁ A₁ P₂ …`` that rows tell as a whole: from images, from points, from measured poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.chains import (
    FRAME,
    REST,
    Chain,
    Lines,
    Link,
    alone_in,
    chain,
    is_pose,
    pose_in,
    rows_of_products,
)
from mbm.estimation.starts.closed_forms.measured import vanishing
from mbm.estimation.starts.closed_forms.numerics.bearings import poses_of_most
from mbm.estimation.starts.closed_forms.pose_from_points import rays_of
from mbm.estimation.starts.closed_forms.rows import finite
from mbm.estimation.starts.closed_forms.similarity import aligned, targets_of
from mbm.estimation.starts.closed_forms.types import AGREEMENT, Candidate, Situation
from mbm.rotations import exponential, inverse_motion, matrix_of_quaternion, quaternion_of_matrix, vector_of_quaternion
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Products:
    """C products of the poses ``links``, outermost first: the members (C,) of each link, what is between, the whole.

    ``turns`` (m - 1, C, 3, 3) and ``shifts`` (m - 1, C, 3) are the motions between, ``R`` (C, 3, 3) and ``t`` (C, 3)
    the products as the rows tell them, NaN where they do not.
    """

    links: tuple[Link, ...]
    turns: Floats
    shifts: Floats
    R: Floats
    t: Floats

    def factor(self, k: int, numbers: Floats) -> tuple[Floats, Floats]:
        """The pose of link k in each product (C, 3, 3), (C, 3); those of the others are among all ``numbers`` (N,)."""
        before, behind = _rest(len(self.R)), _rest(len(self.R))
        for j, link in enumerate(self.links):
            pose = numbers[np.stack([link.places(member) for member in link.member.tolist()])]
            motion = (matrix_of_quaternion(pose[:, :4]), pose[:, 4:])
            motion = inverse_motion(*motion) if link.inverse else motion
            if j < k:
                before = after(after(before, motion), (self.turns[j], self.shifts[j]))
            elif j > k:
                behind = after(after(behind, (self.turns[j - 1], self.shifts[j - 1])), motion)
        found = after(after(inverse_motion(*before), (self.R, self.t)), inverse_motion(*behind))
        return inverse_motion(*found) if self.links[k].inverse else found


def products_of(candidate: Candidate) -> Products | None:
    """The products of all poses of a candidate that rows tell, which miss nothing else."""
    situation, entries = candidate.situation, candidate.support.entries
    if candidate.paired or len(entries) < 2 or not all(is_pose(entry) for entry in candidate.entries):
        return None
    groups = {group.number: group for entry in entries for group in situation.mentioning[entry]}
    lines = tuple(
        (group, rows)
        for _, group in sorted(groups.items())
        for poses, rows in rows_of_products(situation, group, np.arange(group.rows))
        if poses == entries
    )
    return products_in(situation, lines, entries) if lines else None


def products_in(situation: Situation, lines: Lines, entries: tuple[int, ...]) -> Products | None:
    """The products that rows tell which miss one member of each of ``entries``, poses, and nothing else."""
    for width in (2, 3):
        found = chain(situation, lines, entries, width)
        told = None if found is None else _seen(situation, found) if width == 2 else _placed(found)
        if found is not None and told is not None:
            return _whole(found, *told)
    return _measured(situation, lines, entries) if len(entries) == 2 else None


def _whole(found: Chain, R: Floats, t: Floats) -> Products:
    """Each product by the first of its rows."""
    first = np.unique(found.product, return_index=True)[1]
    links = tuple(replace(link, member=link.member[first]) for link in found.links)
    return Products(links=links, turns=found.turns[:, first], shifts=found.shifts[:, first], R=R, t=t)


def _rows_of_each(found: Chain) -> Iterator[Indices]:
    order = np.argsort(found.product, kind="stable")
    yield from np.split(order, np.flatnonzero(np.diff(found.product[order])) + 1)


def _seen(situation: Situation, found: Chain) -> tuple[Floats, Floats] | None:
    """The products from images: the pose of each photograph."""
    rays = rays_of(situation, found.moved, found.points, found.product)
    if rays is None:
        return None
    bearings, origins, weight = rays.directions, rays.origins, found.moved.rows.weight
    known = finite(bearings, 1)
    count = int(found.product.max()) + 1
    R, t = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    for k, rows in enumerate(_rows_of_each(found)):
        mine = rows[known[rows]]
        if len(mine) >= 4:
            seen = found.points[mine], bearings[mine], weight[mine], origins[mine]
            turns, shifts = poses_of_most(found.moved.rows.code, *seen)
            if len(turns):
                R[k], t[k] = turns[0], shifts[0]
    return R, t


def _placed(found: Chain) -> tuple[Floats, Floats] | None:
    """The products from places of points."""
    targets = targets_of(found.moved)
    if targets is None:
        return None
    weight = found.moved.rows.weight * targets[1]
    parts = [aligned(found.points[k], targets[0][k], weight[k], scale=False) for k in _rows_of_each(found)]
    return np.stack([R for _, R, _ in parts]), np.stack([t for _, _, t in parts])


def _measured(situation: Situation, lines: Lines, entries: tuple[int, ...]) -> Products | None:
    """``P A Q^±1 = C`` with C measured: P vanishes the residual, and how it changes with Q tells A and the sign."""
    outer, inner = (pose_in(situation, lines, entry) for entry in entries)

    def outer_at(motion: Floats) -> tuple[Floats, Floats] | None:
        alone = alone_in(situation, lines, (outer, inner), outer, {inner.entry.unknown.name: motion})
        rows = alone.rows(6)
        found = vanishing(rows, outer.entry) if len(rows) else np.full((1, 7), np.nan)
        return (matrix_of_quaternion(found[:, :4]), found[:, 4:]) if bool(np.isfinite(found).all()) else None

    rest = outer_at(REST)
    turned = [outer_at(FRAME.numbers(np.ones(()), exponential(axis), np.zeros(3))) for axis in np.eye(3)]
    if rest is None or any(each is None for each in turned):
        return None
    # P(Q) = C Q^∓1 A⁻¹, so that P(1)⁻¹ P(Q) = A Q^∓1 A⁻¹
    within = [after(inverse_motion(*rest), each) for each in turned if each is not None]
    axes = np.stack([vector_of_quaternion(quaternion_of_matrix(R)) for R, _ in within], axis=-1)
    inverted = bool(np.linalg.det(axes[0]) > 0)
    turns = axes if inverted else -axes
    if not np.allclose(np.swapaxes(turns, 1, 2) @ turns, np.eye(3), atol=AGREEMENT):
        return None
    moved = np.concatenate([np.eye(3) - R for R, _ in within], axis=1)
    shifts = np.einsum("nij,nj->ni", np.linalg.pinv(moved), np.concatenate([t for _, t in within], axis=1))
    R, t = after(rest, (turns, shifts))
    members = [np.concatenate(pose.members) for pose in (outer, inner)]
    links = (
        Link(entry=outer.entry, inverse=False, member=members[0]),
        Link(entry=inner.entry, inverse=inverted, member=members[1]),
    )
    return Products(links=links, turns=turns[None], shifts=shifts[None], R=R, t=t)


def _rest(count: int) -> tuple[Floats, Floats]:
    return np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))


def after(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """The motions (n, 3, 3), (n, 3) first ∘ second."""
    (R, t), (S, s) = first, second
    return R @ S, np.einsum("nij,nj->ni", R, s) + t
