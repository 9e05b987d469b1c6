"""A way that odometry tells and that was found in one place → the other places where it fits as well, or better.

Near a minimum nothing tells of a mirror image. So the whole way is moved as one to where ranges, fixes or bearings suit
it nearly as well, and the solve begins there again; so it does with points of unknown places on other sides of the way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounding_at
from mbm.equations.types import Floats, Minimum
from mbm.estimation.minimise.minimise import minima
from mbm.estimation.search.aligning import ORIGIN, laid_elsewhere, movable
from mbm.estimation.search.basins import same_minimum
from mbm.estimation.search.beside import BOTH_ZERO, PLAUSIBLE, Centre
from mbm.estimation.search.facing import facing
from mbm.estimation.search.rival_sides import on_other_sides
from mbm.estimation.search.search import Alternative, Found, other_minimum
from mbm.estimation.search.valleys import Walks
from mbm.estimation.settings import Settings
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solver.decisions import takes_over


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
