"""Pose graphs and networks as maps: where the members of families are, and which measurements join two of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Indices
from mbm.estimation.search.solution import Solution
from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.plot_data import Map
from mbm.report.residuals import normalised
from mbm.report.types import Floats, Mask

_MOVING = (UnknownKind.POSE, UnknownKind.SIMILARITY)


def maps_of(problem: Problem, solution: Solution) -> tuple[Map, ...]:
    """The maps of the plane and of space: where something is measured between two places of one family; usually one."""
    return tuple(found for dimension in (2, 3) if (found := _map(problem, solution, dimension)) is not None)


def _map(problem: Problem, solution: Solution, dimension: int) -> Map | None:
    entries = [e for e in solution.layout.entries if e.keys is not None and _dimension(e) == dimension]
    entries.sort(key=lambda e: e.unknown.kind not in _MOVING)
    if not entries:
        return None
    node_of, first = np.full(len(solution.numbers), -1, dtype=np.int64), 0
    for entry in entries:
        numbers = np.repeat(np.arange(first, first + entry.members), entry.unknown.size)
        node_of[entry.range] = numbers
        first += entry.members
    edges, residuals = _edges(problem, solution, node_of)
    family = np.repeat(np.arange(len(entries)), [e.members for e in entries])
    if not (family[edges[:, 0]] == family[edges[:, 1]]).any():
        return None
    moving = np.concatenate([np.full(e.members, e.unknown.kind in _MOVING) for e in entries])
    return Map(
        places=np.concatenate([_places(e, solution) for e in entries]),
        spreads=np.concatenate([_spreads(e, solution) for e in entries]),
        moving=moving,
        edges=edges,
        residuals=residuals,
        next_to=_next_to(entries, edges, family, moving),
        unit="m" if _is_length(problem, entries) else "",
        name=", ".join(entry.unknown.name for entry in entries),
    )


def _dimension(entry: Entry) -> int:
    """The space that a family's members are places in; 0 if they are none."""
    unknown = entry.unknown
    if unknown.kind in _MOVING:
        return unknown.dimension
    return unknown.shape[0] if unknown.kind is UnknownKind.VECTOR and unknown.shape in ((2,), (3,)) else 0


def _places(entry: Entry, solution: Solution) -> Floats:
    """Translations, or vectors, (members, d)."""
    numbers = solution.numbers[entry.range].reshape(entry.members, -1)
    dimension = _dimension(entry)
    held = 0 if entry.unknown.kind is UnknownKind.VECTOR else 4 if dimension == 3 else 1
    return np.asarray(numbers[:, held : held + dimension])


def _spreads(entry: Entry, solution: Solution) -> Floats:
    """Covariances (members, d, d) of the places; NaN where they are not known, 0 of what is fixed."""
    dimension = _dimension(entry)
    found = np.full((entry.members, dimension, dimension), np.nan)
    factor = solution.covariance.factor
    if not solution.sigma_known or not len(solution.free) or factor.shape[0] != len(solution.free):
        return found
    row_of = np.full(len(solution.layout.number), -1, dtype=np.int64)
    row_of[solution.free] = np.arange(len(solution.free))
    unknown = np.zeros(len(row_of), dtype=bool)
    unknown[solution.free] = ~solution.observability.estimable
    freedom = entry.unknown.freedom
    turning = 0 if entry.unknown.kind is UnknownKind.VECTOR else 3 if dimension == 3 else 1
    own = entry.first + freedom * np.arange(entry.members)[:, None] + turning + np.arange(dimension)
    rows = np.where((row_of[own] >= 0)[:, :, None], factor[row_of[own]], 0.0)
    rows[unknown[own].any(axis=1)] = np.nan
    return np.asarray(rows @ rows.transpose(0, 2, 1))


def _edges(problem: Problem, solution: Solution, node_of: Indices) -> tuple[Indices, Floats]:
    """Pairs (m, 2) of places that a measurement joins, and the root mean square (m,) of its normalised residual."""
    pairs, sizes = [np.zeros((0, 2), dtype=np.int64)], [np.zeros(0)]
    whitened = normalised(solution)
    for group in solution.groups:
        if problem.blocks[group.kernel.owner].role is not BlockRole.OBSERVATION or not group.index.shape[1]:
            continue
        nodes = node_of[group.index]
        last = nodes.max(axis=1)
        least = np.where(nodes < 0, len(node_of), nodes).min(axis=1)
        two = (last > least) & ((nodes < 0) | (nodes == least[:, None]) | (nodes == last[:, None])).all(axis=1)
        residuals = whitened[group.first : group.first + group.count].reshape(group.rows, -1)
        pairs.append(np.stack([least, last], axis=1)[two])
        sizes.append(np.sqrt((residuals[two] ** 2).mean(axis=1)))
    return np.concatenate(pairs), np.concatenate(sizes)


def _next_to(entries: Sequence[Entry], edges: Indices, family: Indices, moving: Mask) -> Mask:
    """Which edges (m,) join neighbours in the order of the keys of one family of poses: the odometry."""
    order = np.concatenate([np.array(list(_ranks(entry)), dtype=np.int64) for entry in entries])
    a, b = edges.T
    return np.asarray(moving[a] & moving[b] & (family[a] == family[b]) & (np.abs(order[a] - order[b]) == 1))


def _ranks(entry: Entry) -> Iterator[int]:
    """The place of each member in the order of the keys; that of the table where they are texts."""
    keys = entry.keys or ()
    if not all(isinstance(key, float | int) for key in keys):
        yield from range(len(keys))
        return
    yield from np.argsort(np.argsort(np.array(keys, dtype=float), kind="stable"), kind="stable").tolist()


def _is_length(problem: Problem, entries: Sequence[Entry]) -> bool:
    """Whether all families are known to be places in metres."""
    from mbm.report.quantities import quantity_of

    return all(quantity_of(problem, entry.unknown).unit == "m" for entry in entries)
