"""A way that odometry tells and that was found in one place → the other places where it fits as well, or better.

Near a minimum nothing tells of a mirror image. So the whole way is moved as one to where ranges, fixes or bearings suit
it nearly as well, and the solve begins there again; so it does with points of unknown places on other sides of the way.

Points that a way measures, and their mirror images → the minima with some of them on the other side.

Ranges from a straight way do not tell on which side of it a station lies, and those from a way whose bends odometry
leaves open hardly do. Each station has a mirror image of its own, and which of them are meant only solves tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from heapq import heappop, heappush

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.excerpt import excerpt
from mbm.equations.metric import column_norms, rounding_at
from mbm.equations.types import Floats, Indices, Minimum
from mbm.estimation.minimise.minimise import minima, minimise
from mbm.estimation.search.aligning import LEAST_FELT, ORIGIN, Movable, laid_elsewhere, movable
from mbm.estimation.search.basins import same_minimum
from mbm.estimation.search.beside import BACK, BOTH_ZERO, PLAUSIBLE, Centre
from mbm.estimation.search.facing import facing
from mbm.estimation.search.search import Alternative, Found, other_minimum
from mbm.estimation.search.twins import separation
from mbm.estimation.search.valleys import Walks
from mbm.estimation.settings import Settings
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solver.decisions import takes_over
from mbm.values import dataclass

MOST_SOLVES = 40
"""Solves with points on other sides: all sides of five points, and the nearest of more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Point:
    """Where the numbers (d,) of a point stand, those of the places (k, d) that it is measured from, and its rows alone,
    over what else they tell with the way as it is.
    """

    places: Indices
    seen: Indices
    rows: Assembled


def on_other_sides(
    equations: Assembled,
    tree: Movable,
    minimum: Minimum,
    settings: Settings,
    solved: Callable[[Floats], Minimum | None],
) -> Iterator[Minimum]:
    """What a minimum leads to with points mirrored, one more at a time, from the lowest of what was found before.

    ``solved`` is the new minimum that numbers (N,) lead to, None where it is known or none. The search ends where all
    that is left is excluded beside the best.
    """
    points = _points(equations, tree)
    best, solves, tried = minimum.cost, 0, {frozenset[int]()}
    queue: list[tuple[float, int, frozenset[int], Minimum]] = [(minimum.cost, 0, frozenset(), minimum)]
    while queue:
        cost, _, mirrored, lowest = heappop(queue)
        if cost > best + PLAUSIBLE:
            return
        for number, point in enumerate(points):
            other = mirrored ^ {number}
            if other in tried:
                continue
            tried.add(other)
            start = _mirrored(point, lowest.point, settings)
            if start is None:
                continue
            if solves == MOST_SOLVES:
                return
            solves += 1
            found = solved(start)
            if found is not None:
                best = min(best, found.cost)
                heappush(queue, (found.cost, solves, other, found))
                yield found


def _points(equations: Assembled, tree: Movable) -> Sequence[_Point]:
    """The points of as many numbers as places have that are measured from several poses."""
    dimension = tree.entry.unknown.dimension
    found = []
    for entry in equations.layout.entries:
        if not entry.unknown.freedom == entry.unknown.size == dimension or not tree.others[entry.coordinates].all():
            continue
        for member in range(entry.members):
            places = entry.offset + member * dimension + np.arange(dimension)
            seen, columns, units = _measured_from(tree, places)
            if len(seen) >= LEAST_FELT:
                rows = excerpt(equations, columns[tree.others[columns]], units)
                found.append(_Point(places=places, seen=seen, rows=rows))
    return found


def _measured_from(tree: Movable, places: Indices) -> tuple[Indices, Indices, Indices]:
    """Of the rows that hold some numbers: those of the translations (k, d) of their poses, coordinates, and units."""
    family, size = tree.entry, tree.entry.unknown.size
    members, columns, units = ([np.empty(0, dtype=np.int64)] for _ in range(3))
    for group in tree.apart:
        rows = np.flatnonzero(np.isin(group.index, places).any(axis=1))
        numbers = group.index[rows]
        own = numbers[(numbers >= family.range.start) & (numbers < family.range.stop)]
        members.append((own - family.offset) // size)
        columns.append(group.columns[rows].ravel())
        units.append(group.units[rows].ravel())
    last = np.arange(size - family.unknown.dimension, size)
    found = family.offset + np.unique(np.concatenate(members))[:, None] * size + last
    return found, np.unique(np.concatenate(columns)), np.concatenate(units)


def _mirrored(point: _Point, numbers: Floats, settings: Settings) -> Floats | None:
    """The numbers (N,) with a point mirrored at the line, or plane, that fits best what it is measured from.

    As its rows have it there with the way as it is; None where that leads back.
    """
    middle = numbers[point.seen].mean(axis=0)
    normal = np.linalg.svd(numbers[point.seen] - middle, full_matrices=False)[2][-1]
    start = numbers.copy()
    start[point.places] -= 2.0 * ((numbers[point.places] - middle) @ normal) * normal
    rows = replace(point.rows, numbers=numbers)
    ends = [minimise(rows, each, settings) for each in (numbers, start)]
    apart = separation(rows, ends[0].point, ends[1].point[None])[0]
    back = np.square(apart * column_norms(ends[0].jacobian)).sum() <= BACK
    return None if back or not np.isfinite(ends[1].cost) else ends[1].point


def may_lie_elsewhere(equations: Assembled, settings: Settings) -> bool:
    """Whether other places are looked for, by the form of the equations; these may be of many data sets."""
    asked = settings.starts is not None or settings.robust is not None or not settings.iterative
    plain = equations.implicit is None and not equations.lossy and not equations.linear
    return plain and not asked and movable(equations) is not None


def rival_minima(
    equations: Assembled, minimum: Minimum, others: Sequence[Minimum], settings: Settings, problem: Problem
) -> Iterator[Minimum]:
    """What other places lead to, that is neither a ``minimum`` nor one of the ``others``."""
    tree = movable(equations) if minimum.reason.converged and may_lie_elsewhere(equations, settings) else None
    if tree is None:
        return
    known, walks = [minimum, *others], Walks(equations, settings.stopped)

    def solved(point: Floats) -> Minimum | None:
        if settings.stopped():
            return None
        other = next(iter(minima(equations, point[None], settings, problem.span)))
        if not other.reason.converged or not other.feasible or any(same_minimum(walks, k, other) for k in known):
            return None
        known.append(other)
        return other

    laid = map(solved, laid_elsewhere(equations, tree, minimum.point, settings))
    yield from (other for other in laid if other is not None)
    yield from on_other_sides(equations, tree, min(known, key=lambda each: each.cost), settings, solved)


def places_beside(
    equations: Assembled, about: Centre, others: Sequence[Alternative], settings: Settings, problem: Problem
) -> tuple[Alternative, ...]:
    """Other minima with those of other places that are not excluded, the lowest first.

    The answer from a stated start is where it leads, as in generated solvers: the other places are told only.
    """
    found = rival_minima(equations, about.minimum, [each.minimum for each in others], settings, problem)
    near = (other_minimum(equations, each, 1) for each in found if each.cost <= about.most)
    return tuple(sorted((*others, *near), key=lambda a: a.minimum.cost))


def with_rival_places(
    equations: Assembled, found: Found, settings: Settings, problem: Problem, tables: Mapping[str, Table]
) -> Found:
    """``found`` with the minima that other places lead to; the best of all is the answer."""
    others = [each.minimum for each in found.alternatives]
    for other in rival_minima(equations, found.minimum, others, settings, problem):
        alternative = other_minimum(equations, other, 1)
        worked = replace(
            found, iterations=found.iterations + other.iterations, evaluations=found.evaluations + other.evaluations
        )
        seen = facing(problem, tables, equations, found.minimum, (alternative,))
        found = _joined(equations, worked, alternative) if seen else worked
    return found


def _joined(equations: Assembled, found: Found, other: Alternative) -> Found:
    """The lower of the two is the minimum; the other is one of the alternatives unless the data exclude it."""
    lower = takes_over(found.minimum.cost, other.minimum.cost, rounding_at(equations, found.minimum))
    former = other_minimum(equations, found.minimum, 1)
    best, rest = (other, former) if lower else (former, other)
    variance = max(1.0, best.cost / max(equations.count - equations.dimension, 1))
    near = rest.cost <= best.cost + PLAUSIBLE * variance + BOTH_ZERO
    every = (*found.alternatives, *([rest] if near else []))
    return replace(
        found,
        minimum=best.minimum,
        origin=ORIGIN if lower else found.origin,
        alternatives=tuple(sorted(every, key=lambda a: a.minimum.cost)),
    )
