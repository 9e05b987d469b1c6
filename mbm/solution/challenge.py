"""A start that was given against the closed forms: where one of these leads lower, its minimum is the answer."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from mbm.problem.types import Method, Problem
from mbm.solution.assembly import Assembled
from mbm.solution.binding import EvaluationCache, Kind
from mbm.solution.minimise import minimise
from mbm.solution.multistart import GIVEN as GIVEN_START
from mbm.solution.multistart import RANDOM
from mbm.solution.random_starts import costs
from mbm.solution.search import Alternative, Found, Tally
from mbm.solution.settings import Settings
from mbm.solution.starting import GIVEN
from mbm.solution.types import Minimum

LOWER = 1e-6
"""Share of the cost by which another minimum must be lower to take the place of the one that a given start leads to."""


FROM_A_SAMPLE = 1e-2
"""Share of the cost by which an answer from a sample of the rows may lie above the minimum near it."""

USUAL = 5.0
"""Standard deviations of χ² within which a fit gives no cause for doubt."""


def challenged(
    equations: Assembled, settings: Settings, found: Found, problem: Problem, cache: EvaluationCache
) -> Found:
    """``found``, or what a closed form for all unknowns leads to where that is a better fit.

    A closed form's answer costs more than the minimum that it lies near: it is followed if it costs less than what
    was found (hardly more, where it is that of a sample of very many rows), or nothing was found, or what was found
    costs more than the stated noise lets expect (errors add up along a chain of poses: its start may cost more than a
    wrong minimum). That no closed form is made for such equations is remembered in ``cache``, for the data sets to
    come. It is learnt from data that were solved only, and not relied on where a fit is worse than stated noise lets
    expect: what closed forms recognise is found by probing the data, and one that fails on these may succeed on the
    next.
    """
    names = tuple(entry.unknown.name for entry in equations.layout.entries)
    kind: Kind = (names, tuple(group.rows for group in equations.groups))
    iterative = settings.method not in (Method.CLOSED_FORM, Method.DIRECT_SEARCH)
    stated = found.origin in (GIVEN, GIVEN_START, RANDOM)
    if not stated or not iterative or equations.linear or equations.lossy or settings.robust is not None:
        return found
    if equations.constraints:
        return found
    solved = found.minimum.reason.converged and bool(np.isfinite(found.minimum.cost))
    if solved and kind in cache.without_closed_form and not _strained(equations, found, problem):
        return found
    # Here and below: loaded where a start is challenged only, so that other problems start at once.
    from mbm.solution.closed_forms.completion import completions
    from mbm.solution.closed_forms.situation import Situation
    from mbm.solution.closed_forms.thinning import ENOUGH

    numbers = np.where(equations.moving(), np.nan, found.minimum.point)
    situation = Situation(layout=equations.layout, groups=equations.groups, numbers=numbers, most=ENOUGH)
    reached = completions(situation, settings.closed_forms)
    complete = [c for c in reached if not bool(np.isnan(c.numbers).any())]
    if not complete:
        if solved and not any(c.recognised for c in reached):
            cache.without_closed_form.add(kind)
        return found
    fits = costs(equations, np.stack([c.numbers for c in complete]))
    best = int(np.argmin(fits))
    least = found.minimum.cost * (1.0 + FROM_A_SAMPLE if situation.thins else 1.0)
    promising = fits[best] < least or _strained(equations, found, problem)
    if not np.isfinite(fits[best]) or (found.minimum.reason.converged and not promising):
        return found
    other = minimise(equations, complete[best].numbers, settings, problem.span)
    lower = other.cost < (1 - LOWER) * found.minimum.cost
    rescued = not found.minimum.reason.converged and other.cost <= found.minimum.cost
    worked = replace(
        found, iterations=found.iterations + other.iterations, evaluations=found.evaluations + other.evaluations
    )
    return _beaten(worked, other, "; ".join(complete[best].used)) if lower or rescued else worked


def _beaten(found: Found, other: Minimum, origin: str) -> Found:
    """A better minimum, which one more start has led to; what was the best before is another solution."""
    if found.tally is None:
        return replace(found, minimum=other, origin=origin)
    former = Alternative(minimum=found.minimum, cost=found.minimum.cost, starts=found.tally.best_found, mirrored=False)
    converged = int(other.reason.converged)
    return replace(
        found,
        minimum=other,
        origin=origin,
        alternatives=(former, *found.alternatives) if found.minimum.reason.converged else found.alternatives,
        tally=Tally(tried=found.tally.tried + 1, converged=found.tally.converged + converged, best_found=1),
    )


def _strained(equations: Assembled, found: Found, problem: Problem) -> bool:
    """Whether the noise is stated, and the cost larger than it gives."""
    freedom = max(equations.count - equations.dimension, 1)
    stated = not any(block.unknown_factor for block in problem.blocks)
    return stated and not found.minimum.cost < freedom + USUAL * sqrt(2.0 * freedom)
