"""Motions measured between members of one family of poses: all of them, along a tree of measurements."""

from __future__ import annotations

from collections import deque
from dataclasses import field

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.motions import inverse, origin, product, stepped
from mbm.estimation.starts.closed_forms.numerics.finite import finite
from mbm.estimation.starts.closed_forms.rows import Rows
from mbm.estimation.starts.closed_forms.situation import Candidate, Situation
from mbm.estimation.starts.closed_forms.types import Plan
from mbm.problem.types import UnknownKind
from mbm.values import dataclass

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
    """From one member to another, with the motion (s,) that takes the first one's frame to the second's."""

    first: Indices
    second: Indices
    motion: Floats


@dataclass(frozen=True, slots=True)
class RelativePoses:
    """Poses or rotations composed along a tree that spans the measurements, from those known, else from the first."""

    name: str = "relative-poses"
    joint: bool = True

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """Rows that two members meet in, with as many components as a member has coordinates, and nothing else."""
        entry = candidate.entries[0]
        kinds = (UnknownKind.POSE, UnknownKind.ROTATION)
        if len(candidate.entries) != 1 or entry.unknown.kind not in kinds or not candidate.paired:
            return None
        edges = [e for pairs in _pairs(situation, entry) if (e := _edge(pairs, entry)) is not None]
        if not edges:
            return None
        whole = Edge(
            first=np.concatenate([e.first for e in edges]),
            second=np.concatenate([e.second for e in edges]),
            motion=np.vstack([e.motion for e in edges]),
        )
        count = len(whole.first)
        rows = Rows(
            columns=np.empty(0, dtype=np.int64),
            pieces=(),
            width=entry.unknown.freedom,
            member=np.zeros(count, dtype=np.int64),
            unit=np.arange(count),
            weight=np.ones(count),
        )
        return Plan(form=self, candidate=candidate, rows=rows, minimal=1, data=whole)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """One solution (T, 1, K·s) for each subset of the measured motions; NaN for members that they do not reach."""
        return np.stack([_composed(plan, subset) for subset in subsets])[:, None, :]


def _pairs(situation: Situation, entry: Entry) -> list[Pairs]:
    """The rows of each group that two members of the family meet in, and no other unknown without a value."""
    found = []
    missing = np.isnan(situation.numbers)
    size, freedom = entry.unknown.size, entry.unknown.freedom
    for group in situation.observations():
        kernel = group.kernel
        owned = [s.unknown == entry.unknown.name for s in kernel.variables]
        members = list(dict.fromkeys(s.member for s, mine in zip(kernel.variables, owned, strict=True) if mine))
        others = [j for j, mine in enumerate(owned) if not mine]
        if len(members) != 2 or kernel.outputs != freedom or bool(missing[group.index[:, others]].any()):
            continue
        roles = np.array(
            [members.index(s.member) * size + s.component if s.unknown == entry.unknown.name else -1
             for s in kernel.variables]
        )  # fmt: skip
        columns = np.array(
            [members.index(s.member) * freedom + s.component if s.unknown == entry.unknown.name else -1
             for s in kernel.tangents]
        )  # fmt: skip
        numbers = [
            (group.index[:, next(j for j, r in enumerate(roles) if r >= 0 and r // size == which)] - entry.offset)
            // size
            for which in (0, 1)
        ]
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
            usable = finite(slopes, (1, 2)) & finite(values, 1)
            safe = np.where(usable[:, None, None], slopes, np.eye(freedom))
            usable &= np.abs(np.linalg.det(safe)) > 0
            if not bool(usable.all()):
                return None
            motion = stepped(entry, motion, np.asarray(-np.linalg.solve(safe, values[..., None])[..., 0]))
            if float(np.abs(values).max()) <= FOUND_MOTION:
                break
    generator = np.random.default_rng(0)
    other = stepped(entry, start, np.asarray(generator.uniform(-1.0, 1.0, size=(count, freedom)), dtype=np.float64))
    left = np.abs(pairs.linearised(other, product(entry, other, motion), freedom)[0]).max(axis=1)
    apart = np.abs(pairs.linearised(other, motion, freedom)[0]).max(axis=1)
    if not bool((left <= 1e-6 * (1.0 + apart)).all()):
        return None
    return Edge(first=pairs.first, second=pairs.second, motion=motion)


def _composed(plan: Plan, subset: Indices) -> Floats:
    edges: Edge = plan.data
    entry = plan.candidate.entries[0]
    size = entry.unknown.size
    places = plan.candidate.places
    member = (places[:, 0] - entry.offset) // size
    result = plan.candidate.situation.numbers[entry.range].reshape(entry.members, size).copy()
    known = np.flatnonzero(finite(result, 1))
    if not len(known):
        known = member[:1]
        result[known] = origin(entry)
    along = np.vstack([edges.motion[subset], inverse(entry, edges.motion[subset])])
    parent, edge = _tree(entry.members, edges.first[subset], edges.second[subset], known)
    reached = np.flatnonzero(parent >= 0)
    result[reached] = along[edge[reached]]
    # Each member's motion becomes that from its parent's parent, until all begin at one that is known.
    while reached.size:
        above = parent[reached]
        result[reached] = product(entry, result[above], result[reached])
        parent[reached] = parent[above]
        reached = reached[parent[reached] >= 0]
    return result[member].ravel()


def _tree(members: int, first: Indices, second: Indices, known: Indices) -> tuple[Indices, Indices]:
    """Along edges, k from ``first`` to ``second`` and n + k back, to all members that are reached from those known.

    For each member the one before it (-1: it is known, or not reached) and the edge from there, the shortest ways.
    """
    neighbours: list[list[tuple[int, int]]] = [[] for _ in range(members)]
    for k, (a, b) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        neighbours[a].append((b, k))
        neighbours[b].append((a, len(first) + k))
    parent = [-1] * members
    edge = [-1] * members
    met = [False] * members
    waiting = deque(known.tolist())
    for here in waiting:
        met[here] = True
    while waiting:
        here = waiting.popleft()
        for there, k in neighbours[here]:
            if not met[there]:
                met[there], parent[there], edge[there] = True, here, k
                waiting.append(there)
    return np.array(parent, dtype=np.int64), np.array(edge, dtype=np.int64)


RELATIVE_POSES = RelativePoses()
