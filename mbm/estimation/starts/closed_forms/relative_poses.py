"""Motions measured between members of one family of poses: all of them, by the best of several ways.

Along the shortest ways from a known member; along a tree that takes edges between neighbours of an ordered key before
all others (loop closures); and by the chordal relaxation, rotations first, which uses every edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.losses import rooted
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.starts.closed_forms.intersection import solved
from mbm.estimation.starts.closed_forms.motions import inverse, origin, product, stepped
from mbm.estimation.starts.closed_forms.numerics.chordal import Frames, Motions, chordal
from mbm.estimation.starts.closed_forms.numerics.consistency import agreeing_loops
from mbm.estimation.starts.closed_forms.rows import Rows, finite
from mbm.estimation.starts.closed_forms.trees import behind_one_another, foremost_edges, ranks, related, shortest_ways
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation, precision
from mbm.problem.types import BlockRole, UnknownKind
from mbm.rotations import matrix_of_quaternion, planar, quaternion_of_matrix
from mbm.values import dataclass

KINDS = (UnknownKind.POSE, UnknownKind.ROTATION)
"""Of unknowns that it places."""

NEWTON = 20
FOUND_MOTION = 1e-9
"""Residual at which a measured motion counts as found, beside one for motions far off."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pairs:
    """Rows of a group that two members meet in: ``first``, ``second`` (n,), and the inputs that each gives.

    ``roles`` (variables,) says which number of the two together (2 s) an input is, -1 for the others; ``columns``
    (tangents,) the same for coordinates (2 q).
    """

    group: Group = field(repr=False)
    lines: Indices
    first: Indices
    second: Indices
    inputs: Floats
    roles: Indices
    columns: Indices

    def linearised(self, first: Floats, second: Floats, coordinates: int) -> tuple[Floats, Floats]:
        """Residuals (n, q) and their derivatives by the second member (n, q, q) at two members' numbers (n, s)."""
        both = np.hstack([first, second])
        evaluation, variables = self.group.evaluation, len(self.roles)
        given = np.where(self.roles >= 0, both[:, np.maximum(self.roles, 0)], self.inputs)
        evaluation.inputs[:, :variables] = np.nan
        evaluation.inputs[self.lines, :variables] = given
        evaluation.inputs[:, variables:] = self.group.parameters
        values, nonzeros = evaluation.values_and_jacobian()
        kernel = self.group.kernel
        slopes = np.zeros((len(self.lines), kernel.outputs, coordinates))
        for k, (i, j) in enumerate(zip(kernel.jacobian_rows, kernel.jacobian_columns, strict=True)):
            column = int(self.columns[j]) - coordinates
            if column >= 0:
                slopes[:, i, column] += nonzeros[self.lines, k]
        return values[self.lines].copy(), slopes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edge:
    """From members to others (m,), with the motions (m, s) that take the first ones' frames to the second ones'.

    ``stiffness`` (m, 2): the information of a coordinate of the turn, and of the shift, on the average. ``pairs`` are
    the rows that say so, group by group.
    """

    first: Indices
    second: Indices
    motion: Floats
    stiffness: Floats
    pairs: tuple[Pairs, ...] = field(repr=False)

    def cost(self, numbers: Floats) -> float:
        """What all residuals cost at the members' numbers (K, s), by their losses; infinite where one has no value."""
        total = 0.0
        for pairs, found in zip(self.pairs, self._whitened(numbers), strict=True):
            for whitener, loss in zip(pairs.group.whiteners, pairs.group.losses, strict=False):
                own = slice(whitener.first, whitener.last)
                found[:, own] = rooted(loss, found[:, own])
            total += float(np.square(found).sum())
        return total if np.isfinite(total) else np.inf

    def _whitened(self, numbers: Floats) -> Iterator[Floats]:
        for pairs in self.pairs:
            group = pairs.group
            found = np.zeros((group.rows, group.kernel.outputs))
            found[pairs.lines], _ = pairs.linearised(numbers[pairs.first], numbers[pairs.second], group.kernel.outputs)
            yield group.whitened(found)


@dataclass(frozen=True, slots=True)
class RelativePoses:
    """Poses or rotations as the measured motions have them, from those known, else from the first."""

    name: str = "relative-poses"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that two members meet in, with as many components as a member has coordinates, and nothing else."""
        entry = candidate.entries[0]
        if len(candidate.entries) != 1 or entry.unknown.kind not in KINDS or not candidate.paired:
            return None
        whole = measured_motions(situation, entry)
        if whole is None:
            return None
        rows = Rows.without_numbers(len(whole.first), entry.unknown.freedom)
        return Plan(form=self, candidate=candidate, rows=rows, minimal=1, data=whole)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution (T, 1, K·s) for each subset of the measured motions; NaN for members that they do not reach.

        Of all motions the way that fits best; of fewer the shortest ways.
        """
        ways = [_best if len(subset) == len(plan.rows) else _composed for subset in subsets]
        found = np.stack([way(plan, subset) for way, subset in zip(ways, subsets, strict=True)])
        member = _members(plan)
        return found[:, member].reshape(len(subsets), 1, -1)


def measured_motions(situation: Situation, entry: Entry) -> Edge | None:
    """All that is measured of motions from one member of a family to another; None if nothing is."""
    edges = [e for pairs in _pairs(situation, entry) if (e := _edge(pairs, entry)) is not None]
    if not edges:
        return None
    return Edge(
        first=np.concatenate([e.first for e in edges]),
        second=np.concatenate([e.second for e in edges]),
        motion=np.vstack([e.motion for e in edges]),
        stiffness=np.vstack([e.stiffness for e in edges]),
        pairs=tuple(pairs for e in edges for pairs in e.pairs),
    )


def agreeing(entry: Entry, edges: Edge) -> Mask | None:
    """Which motions (m,) are a chain in the order of the poses' keys, or loops that agree with it and with others.

    None where no motion joins neighbours, or there are very many loops.
    """
    rank, known = ranks(entry), (edges.stiffness > 0.0) & np.isfinite(edges.stiffness)
    if rank is None or entry.unknown.kind is not UnknownKind.POSE or not bool(known.all()):
        return None
    first, second = rank[edges.first], rank[edges.second]
    early = np.flatnonzero(np.abs(first - second) == 1)
    if not len(early):
        return None
    chain = early[np.unique(np.minimum(first, second)[early], return_index=True)[1]]
    R, t = _frames(entry, edges.motion)
    motions = Motions(first=first, second=second, turns=R, shifts=t, stiffness=edges.stiffness)
    return agreeing_loops(motions, t, chain)


def relates(group: Group, entry: Entry) -> bool:
    """Whether rows of a group may measure the motion from one member of a family of poses or rotations to another."""
    kernel = group.kernel
    members = {slot.member for slot in kernel.variables if slot.unknown == entry.unknown.name}
    return entry.unknown.kind in KINDS and len(members) == 2 and kernel.outputs == entry.unknown.freedom


def _pairs(situation: Situation, entry: Entry) -> list[Pairs]:
    """The rows of each group that two members of the family meet in, and no other unknown without a value.

    Transitions from step to step are motions that are measured, too.
    """
    found = []
    missing = np.isnan(situation.numbers)
    size, freedom = entry.unknown.size, entry.unknown.freedom
    for group in situation.groups:
        kernel = group.kernel
        owned = [s.unknown == entry.unknown.name for s in kernel.variables]
        members = list(dict.fromkeys(s.member for s, mine in zip(kernel.variables, owned, strict=True) if mine))
        others = [j for j, mine in enumerate(owned) if not mine]
        measured = group.rows and group.role in (BlockRole.OBSERVATION, BlockRole.TRANSITION)
        if not measured or not relates(group, entry) or bool(missing[group.index[:, others]].any()):
            continue
        roles = np.array(
            [members.index(s.member) * size + s.component if s.unknown == entry.unknown.name else -1
             for s in kernel.variables]
        )  # fmt: skip
        columns = np.array(
            [members.index(s.member) * freedom + s.component if s.unknown == entry.unknown.name else -1
             for s in kernel.tangents]
        )  # fmt: skip
        numbers = related(group, entry)
        lines = np.flatnonzero(numbers[0] != numbers[1])
        found.append(
            Pairs(
                group=group,
                lines=lines,
                first=numbers[0][lines],
                second=numbers[1][lines],
                inputs=situation.numbers[group.index[lines]],
                roles=roles,
                columns=columns,
            )
        )
    return [pairs for pairs in found if len(pairs.lines)]


def _edge(pairs: Pairs, entry: Entry) -> Edge | None:
    """The measured motions: where the second member is when the first is the origin, and the residual vanishes."""
    count, freedom = len(pairs.lines), entry.unknown.freedom
    start = np.tile(origin(entry), (count, 1))
    motion = start.copy()
    with np.errstate(all="ignore"):
        for _ in range(NEWTON):
            values, slopes = pairs.linearised(start, motion, freedom)
            step = solved(slopes, values)
            if not bool(np.isfinite(step).all()):
                return None
            motion = stepped(entry, motion, -step)
            if float(np.abs(values).max()) <= FOUND_MOTION:
                break
    generator = np.random.default_rng(0)
    other = stepped(entry, start, np.asarray(generator.uniform(-1.0, 1.0, size=(count, freedom)), dtype=np.float64))
    left = np.abs(pairs.linearised(other, product(entry, other, motion), freedom)[0]).max(axis=1)
    apart = np.abs(pairs.linearised(other, motion, freedom)[0]).max(axis=1)
    if not bool((left <= 1e-6 * (1.0 + apart)).all()):
        return None
    weights = precision(pairs.group, pairs.lines)
    information = np.einsum("mij,mi->mj", np.square(slopes), weights)
    turn = 1 if entry.unknown.dimension == 2 else 3
    stiffness = np.stack([information[:, :turn].mean(axis=1), information[:, turn:].sum(axis=1)], axis=1)
    stiffness[:, 1] /= max(freedom - turn, 1)
    return Edge(first=pairs.first, second=pairs.second, motion=motion, stiffness=stiffness, pairs=(pairs,))


def _members(plan: Plan) -> Indices:
    """The members (K,) of the family that the candidate is of."""
    entry = plan.candidate.entries[0]
    return np.asarray((plan.candidate.places[:, 0] - entry.offset) // entry.unknown.size)


def _known(plan: Plan) -> tuple[Floats, Indices]:
    """The numbers (members, s) of the family, NaN where they are not known, and which members are; one at least."""
    entry = plan.candidate.entries[0]
    numbers = plan.candidate.situation.numbers[entry.range].reshape(entry.members, entry.unknown.size).copy()
    known = np.flatnonzero(finite(numbers, 1))
    if not len(known):
        known = _members(plan)[:1]
        numbers[known] = origin(entry)
    return numbers, known


def _best(plan: Plan, subset: Indices) -> Floats:
    """The numbers (members, s) by the way that fits best."""
    edges: Edge = plan.data
    found = [_composed(plan, subset)]
    reached = finite(found[0], 1)
    early = behind_one_another(plan.candidate.entries[0], edges.first, edges.second)
    if early.any() and not early.all():
        foremost = foremost_edges(len(found[0]), edges.first, edges.second, np.where(early, 0.0, 1.0))
        found.append(_composed(plan, foremost))
    used = [np.ones(len(edges.first))]
    if any(pairs.group.losses for pairs in edges.pairs):
        agree = agreeing(plan.candidate.entries[0], edges)
        used += [] if agree is None else [agree.astype(float)]
    found += [each for weights in used if (each := _relaxed(plan, reached, weights)) is not None]
    costs = [edges.cost(np.where(reached[:, None], each, 0.0)) for each in found]
    return found[int(np.argmin(costs))]


def _relaxed(plan: Plan, reached: Mask, weights: Floats) -> Floats | None:
    """The numbers (members, s) by the chordal relaxation, of the members that are ``reached``; None where it fails.

    Motions count with their ``weights`` (m,).
    """
    edges: Edge = plan.data
    entry = plan.candidate.entries[0]
    numbers, known = _known(plan)
    inside = reached[edges.first] & reached[edges.second] & (edges.stiffness > 0.0).all(axis=1)
    held = ~reached
    held[known] = True
    numbers[~reached] = origin(entry)
    turns, shifts = _frames(entry, np.where(held[:, None], numbers, origin(entry)))
    moves = entry.unknown.kind is UnknownKind.POSE
    R, t = _frames(entry, edges.motion[inside])
    motions = Motions(
        first=edges.first[inside],
        second=edges.second[inside],
        turns=R,
        shifts=t if moves else None,
        stiffness=edges.stiffness[inside] * weights[inside, None],
    )
    found = chordal(motions, Frames(known=held, rotations=turns, translations=shifts))
    if found is None:
        return None
    result = _numbers(entry, found.rotations, found.translations)
    result[known] = numbers[known]
    result[~reached] = np.nan
    return result


def _frames(entry: Entry, numbers: Floats) -> tuple[Floats, Floats]:
    """Rotations (n, d, d) and translations (n, d), zero of rotations alone."""
    dimension = entry.unknown.dimension
    turns = planar(numbers[:, 0]) if dimension == 2 else matrix_of_quaternion(numbers[:, :4])
    shifts = numbers[:, -dimension:] if entry.unknown.kind is UnknownKind.POSE else np.zeros((len(numbers), dimension))
    return turns, shifts


def _numbers(entry: Entry, turns: Floats, shifts: Floats) -> Floats:
    """The numbers (n, s) of frames."""
    if entry.unknown.dimension == 2:
        turned = np.arctan2(turns[:, 1, 0], turns[:, 0, 0])[:, None]
    else:
        turned = quaternion_of_matrix(turns)
    return np.hstack([turned, shifts]) if entry.unknown.kind is UnknownKind.POSE else turned


def _composed(plan: Plan, subset: Indices) -> Floats:
    """The numbers (members, s) along the shortest ways that the motions ``subset`` make; NaN where none leads."""
    edges: Edge = plan.data
    entry = plan.candidate.entries[0]
    result, known = _known(plan)
    along = np.vstack([edges.motion[subset], inverse(entry, edges.motion[subset])])
    parent, edge = shortest_ways(entry.members, edges.first[subset], edges.second[subset], known)
    reached = np.flatnonzero(parent >= 0)
    result[reached] = along[edge[reached]]
    # Each member's motion becomes that from its parent's parent, until all begin at one that is known.
    while reached.size:
        above = parent[reached]
        result[reached] = product(entry, result[above], result[reached])
        parent[reached] = parent[above]
        reached = reached[parent[reached] >= 0]
    return result


RELATIVE_POSES = RelativePoses()
