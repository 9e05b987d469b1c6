"""Sequential quadratic programming for least squares: Gauss-Newton steps that obey the linearised constraints.

The merit function is exact (Han 1977, Powell 1978): the cost and the weighted violations. A step that the curvature of
the constraints spoils is corrected once (Fletcher 1982). Near the end, where Gauss-Newton is slow, the Hessian of the
Lagrange function takes over; the last steps are judged by their length because the merit no longer tells points apart.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, sqrt

import numpy as np

from mbm.solution.constrained.box import Box, box_of
from mbm.solution.constrained.curvature import lagrangian_model
from mbm.solution.constrained.linearise import finite, linearise, met, violations
from mbm.solution.constrained.quadratic import Solved, Subproblem, solve
from mbm.solution.constrained.types import ConstrainedEquations, Linearised, Stopped, never
from mbm.solution.types import Floats, Reason
from mbm.target.decisions import EPSILON, EXACT, LEAST_GAIN_RATIO, POLISH, SETTLED, SLOW_KKT
from mbm.target.step_control import relative_offset
from mbm.values import dataclass

KEPT = 0.1
HALVINGS = 40
FIRST_DAMPING = 1e-2
MOST_DAMPING = 1e8
"""Damping in scaled coordinates, where the residuals' singular values are about 1: when a step has failed, and ever."""

HOPELESS = 3
"""Iterations in a row whose linearised constraints contradict one another: other methods do better."""

NEAR_KKT = 0.1
"""The second-order term is computed if the relative offset is below this, and does not fall below SLOW_KKT."""

ON_BOUND = 1e-9
"""Distance from its bound, in standard deviations, below which a coordinate is at the bound."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Iterate:
    """Where the iteration is: the place, the last multipliers, weights of the violations (k,), damping, counters.

    ``bounds`` (n,) are the multipliers of the bounds: negative at a lower, positive at an upper one. ``before`` is the
    relative offset where the last accepted step began (inf: there was none). ``infeasible`` counts the last iterations
    whose linearised constraints had no common point.
    """

    place: Linearised
    multipliers: Floats
    bounds: Floats
    weights: Floats
    damping: float
    offset: float
    before: float
    second: bool
    infeasible: int
    iterations: int
    evaluations: int
    reason: Reason | None


def begin(equations: ConstrainedEquations, start: Floats, multipliers: Floats | None = None) -> Iterate:
    """The iterate at a start (put into the bounds)."""
    box = box_of(equations)
    point = equations.placed(start, box.project(equations.coordinates(start))) if box.present else start
    place = linearise(equations, point)
    known = np.zeros(len(place.values)) if multipliers is None else multipliers
    return Iterate(
        place=place,
        multipliers=known,
        bounds=np.zeros(equations.dimension),
        weights=np.abs(known),
        damping=0.0,
        offset=inf,
        before=inf,
        second=False,
        infeasible=0,
        iterations=0,
        evaluations=1,
        reason=None if finite(place) else Reason.NOT_FINITE_AT_START,
    )


def run(
    equations: ConstrainedEquations, state: Iterate, *, tolerance: float, limit: int, stopped: Stopped = never
) -> Iterate:
    """Steps until the iteration is over (``reason``), or ``limit`` of them are done (``reason`` None)."""
    box = box_of(equations)
    while state.reason is None and state.iterations < limit:
        if stopped():
            return replace(state, reason=Reason.INTERRUPTED)
        state = step(equations, box, state, tolerance)
    return state


@np.errstate(all="ignore")
def step(equations: ConstrainedEquations, box: Box, state: Iterate, tolerance: float) -> Iterate:
    """One iteration."""
    here, equality = state.place, equations.equality
    model = lagrangian_model(equations, here, state.multipliers, state.bounds) if state.second else None
    problem = _subproblem(equations, box, here, model, state.damping)
    solved = solve(problem)
    offset = _offset(here, solved, equations.count)
    state = replace(
        state,
        offset=offset,
        multipliers=solved.multipliers,
        bounds=solved.bounds,
        infeasible=0 if solved.feasible else state.infeasible + 1,
        iterations=state.iterations + 1,
    )
    if state.infeasible > HOPELESS:
        return replace(state, reason=Reason.FLAT)
    everything = solved.feasible and bool(met(here, equality, EXACT).all())
    if everything and offset <= tolerance:
        return _last(equations, box, state, solved, Reason.SMALL_OFFSET)
    # Constraints that contradict one another by less than MET (coordinates rounded when typed) get no better than this.
    if solved.feasible and bool(met(here, equality).all()) and _no_movement(here, solved, equations):
        return _last(equations, box, state, solved, Reason.ROUNDING)
    state = replace(state, weights=_weights(here, state.weights, solved.multipliers))
    return _searched(equations, box, state, problem, solved)


def _last(equations: ConstrainedEquations, box: Box, state: Iterate, solved: Solved, reason: Reason) -> Iterate:
    """The negligible last step all the same: it puts coordinates exactly on the bounds that hold them."""
    place = linearise(equations, _moved(equations, box, state.place, solved), state.place)
    good = finite(place) and bool(met(place, equations.equality, EXACT).all())
    good = good and place.cost <= state.place.cost + state.place.slack
    return replace(state, place=place if good else state.place, evaluations=state.evaluations + 1, reason=reason)


def _subproblem(
    equations: ConstrainedEquations,
    box: Box,
    here: Linearised,
    model: tuple[Floats, Floats] | None,
    damping: float,
) -> Subproblem:
    jacobian, residuals = (here.jacobian, here.residuals) if model is None else model
    down, up = box.gaps(equations.coordinates(here.point))
    return Subproblem(
        jacobian=jacobian,
        residuals=residuals,
        slopes=here.slopes,
        values=here.values,
        equality=equations.equality,
        down=down,
        up=up,
        scale=here.scale,
        damping=damping,
    )


def _offset(here: Linearised, solved: Solved, count: int) -> float:
    """The step in standard deviations of the estimates: relative offset of Bates and Watts (1981)."""
    image = here.jacobian @ solved.step
    length = float(image @ image)
    moving = max(len(solved.step), 1)
    return relative_offset(length, max(here.cost - length, 0.0), moving, max(count - moving, 1))


def _no_movement(here: Linearised, solved: Solved, equations: ConstrainedEquations) -> bool:
    """The step is no more than the rounding of the coordinates."""
    size = np.abs(equations.coordinates(here.point)) * here.scale
    return bool(
        sqrt(float(np.square(solved.step * here.scale).sum())) <= here.noise + 1e-15 * float(size.max(initial=0))
    )


def _weights(here: Linearised, before: Floats, multipliers: Floats) -> Floats:
    """Weights of the violations above every multiplier, falling slowly (Powell 1978).

    A share of what the gradient could ask for is kept: where the linearised constraint lets the residuals vanish, its
    multiplier is nothing, and the merit would not notice that it is left behind.
    """
    gradient = (here.residuals @ here.jacobian) / here.scale
    least = KEPT * sqrt(float(gradient @ gradient)) / here.unit
    needed = np.maximum(1.1 * np.abs(multipliers), least)
    return np.maximum(needed, 0.5 * (before + needed))


def merit(here: Linearised, weights: Floats, equations: ConstrainedEquations) -> float:
    """Half the cost and the weighted violations: at a minimum no other point nearby has less."""
    return _merit_of(here.residuals, here.values, weights, equations)


def _merit_of(residuals: Floats, values: Floats, weights: Floats, equations: ConstrainedEquations) -> float:
    found = 0.5 * float(residuals @ residuals) + float(weights @ violations(values, equations.equality))
    return found if isfinite(found) else inf


def _searched(
    equations: ConstrainedEquations, box: Box, state: Iterate, problem: Subproblem, solved: Solved
) -> Iterate:
    """The iterate after a search along the step."""
    here = state.place
    before = merit(here, state.weights, equations)
    image = here.jacobian @ solved.step
    slope = float(here.residuals @ image) - float(state.weights @ violations(here.values, equations.equality))
    rounding = 0.5 * here.slack + float(state.weights @ here.rounding)
    promised = -slope
    if promised <= 10.0 * rounding and solved.feasible:
        return _judged_by_length(equations, box, state, solved, before + rounding)
    evaluations, length = state.evaluations, 1.0
    for tries in range(HALVINGS):
        point = _moved(equations, box, here, solved, length)
        residuals, values = equations.residuals(point), equations.constraint_values(point)
        evaluations += 1
        reached = _merit_of(residuals, values, state.weights, equations)
        wanted = before - LEAST_GAIN_RATIO * length * max(promised, 0.0) + rounding
        if reached > wanted and tries == 0 and isfinite(reached):
            point, reached = _corrected(equations, box, state, problem, values, solved)
            evaluations += 1
        if reached <= wanted and reached < before + rounding:
            place = linearise(equations, point, here)
            if finite(place):
                return _arrived(replace(state, evaluations=evaluations), place, length)
        length *= 0.5 if tries < 4 else 0.1
        if length < 1e-12:
            break
    return _stuck(replace(state, evaluations=evaluations))


def _moved(equations: ConstrainedEquations, box: Box, here: Linearised, solved: Solved, length: float = 1.0) -> Floats:
    """Where a step leads, inside the bounds; what a bound holds is put on it to the last bit."""
    moved = equations.retract(here.point, length * solved.step)
    if not box.present:
        return moved
    inside = box.project(equations.coordinates(moved))
    bound = np.where(solved.bounds < 0.0, box.lower, box.upper)
    near = np.abs(inside - bound) <= np.maximum(ON_BOUND / here.scale, 8.0 * EPSILON * np.abs(bound))
    allowed = near & (solved.bounds != 0.0) & ~(box.positive & (bound <= 0.0))
    return equations.placed(moved, np.where(allowed, bound, inside))


def _corrected(
    equations: ConstrainedEquations, box: Box, state: Iterate, problem: Subproblem, values: Floats, solved: Solved
) -> tuple[Floats, float]:
    """The full step again, with the curvature of the constraints answered that showed at its end."""
    bent = values - problem.slopes @ solved.step
    again = solve(replace(problem, values=bent))
    point = _moved(equations, box, state.place, again)
    residuals, there = equations.residuals(point), equations.constraint_values(point)
    return point, _merit_of(residuals, there, state.weights, equations)


def _arrived(state: Iterate, place: Linearised, length: float) -> Iterate:
    damping = state.damping
    if length >= 1.0:
        damping = damping / 10.0 if damping > 1e-6 else 0.0
    elif length < 0.2:
        damping = min(max(10.0 * damping, FIRST_DAMPING), MOST_DAMPING)
    second = state.second or (state.offset <= NEAR_KKT and state.offset > SLOW_KKT * state.before)
    return replace(state, place=place, damping=damping, before=state.offset, second=second)


def _stuck(state: Iterate) -> Iterate:
    """No length would do: shorter steps by damping, as long as there is any hope."""
    if state.damping >= MOST_DAMPING or (not state.second and state.damping >= 1e4):
        return replace(state, reason=Reason.FLAT)
    return replace(state, damping=max(100.0 * state.damping, FIRST_DAMPING), second=False)


def _judged_by_length(
    equations: ConstrainedEquations, box: Box, state: Iterate, solved: Solved, most: float
) -> Iterate:
    """The promise is rounding: take the step if the next one is shorter or the constraints hold better.

    The merit may not grow beyond ``most``.
    """
    here = state.place
    point = _moved(equations, box, here, solved)
    place = linearise(equations, point, here)
    state = replace(state, evaluations=state.evaluations + 1)
    settled = state.offset <= SETTLED or not isfinite(state.offset)
    ending = Reason.ROUNDING if settled and bool(met(here, equations.equality).all()) else Reason.FLAT
    if not finite(place) or merit(place, state.weights, equations) > most:
        if not state.second:
            return replace(state, second=True)
        return replace(state, reason=ending)
    model = lagrangian_model(equations, place, state.multipliers, state.bounds) if state.second else None
    after = solve(_subproblem(equations, box, place, model, state.damping))
    shorter = _offset(place, after, equations.count) <= POLISH * state.offset
    unit = np.maximum(here.unit, place.unit)
    worse = violations(place.values, equations.equality) / unit
    better = violations(here.values, equations.equality) / unit
    if not shorter and not float(worse.max(initial=0.0)) < POLISH * float(better.max(initial=0.0)):
        if not state.second:
            return replace(state, second=True)
        return replace(state, reason=ending)
    return _arrived(state, place, 1.0)
