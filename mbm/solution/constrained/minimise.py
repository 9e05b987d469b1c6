"""Equations, constraints and a start → the constrained minimum, or the constraints that contradict one another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field, replace

import numpy as np

from mbm.solution.constrained.conflict import STILL, TOLERANCE, conflict_at
from mbm.solution.constrained.linearise import linearise, met, violations
from mbm.solution.constrained.penalised import Penalised, least_violation, marquardt, penalised, updated
from mbm.solution.constrained.sequential import Iterate, begin, merit, run
from mbm.solution.constrained.types import ConstrainedEquations, Stopped, never
from mbm.solution.types import Conflict, Floats, Minimum, Reason
from mbm.target.decisions import FIRST_WEIGHT, HEAVIER, LOOSE, SHRINKS
from mbm.values import dataclass

ROUNDS = 14
"""Rounds of the multiplied penalties."""

FEASIBLE_WEIGHT = 100.0
"""In place of FIRST_WEIGHT from a point without violations."""

TIGHTER = 0.3
"""Standard deviations to which each round after the first is solved; sequential steps give the digits."""

FINISH = 30
"""Sequential steps that may follow a round."""

FINAL = (Reason.NOT_FINITE_AT_START, Reason.INTERRUPTED)

PLACES = 10
"""Points around the start from which a feasible one is searched for before there is said to be none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Constrained:
    """Where the search ended; ``conflict`` where it ended because no point meets the constraints."""

    state: Iterate
    reason: Reason
    iterations: int
    evaluations: int
    conflict: Conflict | None = None


@dataclass(slots=True)
class _Work:
    """The iterations and evaluations of one search, as they add up."""

    limit: int
    tolerance: float
    seed: int
    stopped: Stopped
    iterations: int = 0
    evaluations: int = 0
    searched: bool = field(default=False)

    def count(self, done: Iterate | Minimum) -> None:
        self.iterations += done.iterations
        self.evaluations += done.evaluations

    def steps(self, equations: ConstrainedEquations, state: Iterate) -> Iterate:
        """A few sequential steps, counted: no more than the whole search may have."""
        done = run(equations, state, tolerance=self.tolerance, limit=min(FINISH, self.limit), stopped=self.stopped)
        self.count(done)
        return done

    def end(self, state: Iterate, reason: Reason, conflict: Conflict | None = None) -> Constrained:
        return Constrained(
            state=state, reason=reason, iterations=self.iterations, evaluations=self.evaluations, conflict=conflict
        )


def by_penalties(
    equations: ConstrainedEquations,
    start: Floats,
    *,
    tolerance: float,
    limit: int,
    seed: int = 1,
    stopped: Stopped = never,
) -> Constrained:
    """Multiplied penalties until the constraints nearly hold, then sequential steps until they do.

    The penalties need no feasible start and no feasible linearisation. Where they do not bring the violations down,
    the least of them is searched for: if that is not zero, the constraints contradict one another.
    """
    return _by_penalties(equations, begin(equations, start), _Work(limit, tolerance, seed, stopped))


def by_sequential_steps(
    equations: ConstrainedEquations,
    start: Floats,
    *,
    tolerance: float,
    limit: int,
    seed: int = 1,
    stopped: Stopped = never,
) -> Constrained:
    """Sequential quadratic programming from the start; multiplied penalties where that gets stuck."""
    work = _Work(limit, tolerance, seed, stopped)
    state = run(equations, begin(equations, start), tolerance=tolerance, limit=limit, stopped=stopped)
    work.count(state)
    if state.reason is not None and (state.reason.converged or state.reason in FINAL):
        return work.end(state, state.reason)
    work.limit += limit
    return _by_penalties(equations, begin(equations, state.place.point), work)


def _by_penalties(equations: ConstrainedEquations, first: Iterate, work: _Work) -> Constrained:
    if first.reason is not None:
        return work.end(first, first.reason)
    start = point = first.place.point
    known = first.multipliers
    weight, worst, last = FIRST_WEIGHT, np.inf, first
    for number in range(ROUNDS):
        unit = linearise(equations, point).unit
        penalties = penalised(equations, unit, known, weight)
        near = max(LOOSE * TIGHTER**number, work.tolerance)
        found = marquardt(penalties, point, near, max(work.limit - work.iterations, 1), work.stopped)
        work.count(found)
        point, known = found.point, updated(penalties, found.point)
        last = work.steps(equations, begin(equations, point, known))
        if last.reason is not None and (last.reason.converged or last.reason is Reason.INTERRUPTED):
            return work.end(last, last.reason)
        if not known.any():
            unheld = _unheld(equations, penalties, point, work)
            if unheld is not None:
                return unheld
        left = float((violations(equations.constraint_values(point), equations.equality) / unit).max(initial=0.0))
        if not left <= SHRINKS * worst:
            weight *= HEAVIER
            if not work.searched:
                feasible = _feasible(equations, point, start, work)
                if isinstance(feasible, Constrained):
                    return feasible
                point, known, weight = feasible, np.zeros(len(known)), max(weight, FEASIBLE_WEIGHT)
                last = work.steps(equations, begin(equations, point))
                if last.reason is not None and last.reason.converged:
                    return work.end(last, last.reason)
        worst = min(worst, left) if np.isfinite(left) else worst
        if work.iterations >= work.limit:
            break
    return work.end(_no_worse(equations, first, last), last.reason or Reason.MAX_ITERATIONS)


def _unheld(equations: ConstrainedEquations, penalties: Penalised, point: Floats, work: _Work) -> Constrained | None:
    """The minimum without constraints, if none is active there: the least squares solver knows more ways to it."""
    found = marquardt(penalties, point, work.tolerance, max(work.limit - work.iterations, 1), work.stopped)
    work.count(found)
    there = begin(equations, found.point)
    values = there.place.values
    if there.reason is not None or not found.reason.converged or not bool((values < 0.0).all()):
        return None
    bounds = found.at_bound * there.place.scale
    return work.end(replace(there, bounds=bounds, offset=found.offset), found.reason)


def _no_worse(equations: ConstrainedEquations, first: Iterate, last: Iterate) -> Iterate:
    """The last place of a search that found no end, unless the first was better by the exact merit."""
    weights = np.maximum(first.weights, last.weights)
    return last if merit(last.place, weights, equations) <= merit(first.place, weights, equations) else first


def _feasible(equations: ConstrainedEquations, here: Floats, start: Floats, work: _Work) -> Floats | Constrained:
    """A point that meets the constraints; or the end at the point of least violation, with what contradicts there."""
    work.searched = True
    least, fewest, unit_there = None, np.inf, np.zeros(0)
    for point in _places(equations, here, start, work.seed):
        unit = linearise(equations, point).unit
        found, left = least_violation(equations, point, unit, TOLERANCE, work.limit)
        work.count(found)
        if not np.isfinite(found.cost):
            continue
        there = linearise(equations, found.point)
        if bool((left <= STILL).all()) or bool(met(there, equations.equality).all()):
            return found.point
        if found.cost < fewest:
            least, fewest, unit_there = found, found.cost, unit
    if least is None:
        return here
    conflict = conflict_at(equations, least, unit_there, work.limit)
    return work.end(begin(equations, least.point), Reason.INFEASIBLE, conflict)


def _places(equations: ConstrainedEquations, here: Floats, start: Floats, seed: int) -> Iterator[Floats]:
    """Where the search for a point that meets the constraints begins: here, at the start, around them, in the box."""
    yield here
    yield start
    random = np.random.default_rng(seed)
    low, high = equations.lower, equations.upper
    boxed = np.isfinite(low) & np.isfinite(high)
    sizes = np.maximum(np.abs(equations.coordinates(start)), 1.0 / linearise(equations, start).scale)
    for _ in range(PLACES):
        moved = equations.retract(start, sizes * random.normal(size=equations.dimension))
        inside = np.where(boxed, low + random.random(equations.dimension) * np.where(boxed, high - low, 0.0), 0.0)
        coordinates = np.clip(np.where(boxed, inside, equations.coordinates(moved)), low, high)
        yield equations.placed(moved, coordinates)
