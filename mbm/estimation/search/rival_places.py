"""A way that odometry tells and that was found in one place → the other places where it fits as well, or better.

Near a minimum nothing tells of a mirror image. So the whole way is moved as one to where ranges, fixes or bearings suit
it nearly as well, and the solve begins there again.
"""

from __future__ import annotations

from dataclasses import replace

from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounding_at
from mbm.equations.types import Minimum
from mbm.estimation.minimise.minimise import minima
from mbm.estimation.search.aligning import ORIGIN, laid_elsewhere
from mbm.estimation.search.basins import same_minimum
from mbm.estimation.search.beside import BOTH_ZERO, PLAUSIBLE
from mbm.estimation.search.search import Found, other_minimum
from mbm.estimation.search.starting import GIVEN
from mbm.estimation.search.valleys import Walks
from mbm.estimation.settings import Settings
from mbm.problem.types import Problem
from mbm.solver.decisions import takes_over


def with_rival_places(equations: Assembled, found: Found, settings: Settings, problem: Problem) -> Found:
    """``found`` with the minima that other places lead to; the best of all is the answer unless a start is stated.

    The answer from a stated start is where it leads, as in generated solvers.
    """
    asked = settings.starts is not None or settings.robust is not None or not settings.iterative
    plain = equations.implicit is None and not equations.lossy
    if asked or not plain or equations.linear or not found.minimum.reason.converged:
        return found
    points = laid_elsewhere(equations, found.minimum.point, settings)
    walks = Walks(equations, settings.stopped)
    known = [found.minimum, *(each.minimum for each in found.alternatives)]
    for point in points:
        if settings.stopped():
            break
        other = next(iter(minima(equations, point[None], settings, problem.span)))
        found = replace(
            found, iterations=found.iterations + other.iterations, evaluations=found.evaluations + other.evaluations
        )
        if not other.reason.converged or not other.feasible or any(same_minimum(walks, k, other) for k in known):
            continue
        known.append(other)
        found = _joined(equations, found, other)
    return found


def _joined(equations: Assembled, found: Found, other: Minimum) -> Found:
    """The lower of the two is the minimum, or that from a stated start; the other is one of the alternatives unless the
    data exclude it.
    """
    stated = found.origin == GIVEN
    lower = not stated and takes_over(found.minimum.cost, other.cost, rounding_at(equations, found.minimum))
    best, rest = (other, found.minimum) if lower else (found.minimum, other)
    variance = max(1.0, best.cost / max(equations.count - equations.dimension, 1))
    near = rest.cost <= best.cost + PLAUSIBLE * variance + BOTH_ZERO
    every = (*found.alternatives, *([other_minimum(equations, rest, 1)] if near else []))
    return replace(
        found,
        minimum=best,
        origin=ORIGIN if lower else found.origin,
        alternatives=tuple(sorted(every, key=lambda a: a.minimum.cost)),
    )
