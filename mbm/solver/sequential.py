"""Sequential quadratic programming for least squares: Gauss-Newton steps that obey the linearised constraints.

The merit function is exact (Han 1977, Powell 1978): the cost and the weighted violations. A step that the curvature of
the constraints spoils is corrected once (Fletcher 1982). Near the end `kkt` takes over, with the active set that the
subproblem has; where the steps get stuck, penalties do.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.constraint_values import evaluate, linearise, set_units
from mbm.solver.constraints import begin_rounds
from mbm.solver.decisions import EPSILON, LEAST_GAIN_RATIO, UNDECIDED
from mbm.solver.description import BOUNDS_AT, NOT_FINITE_AT_START, RUNNING, Problem
from mbm.solver.equations import cost_at_point
from mbm.solver.kkt import polish, set_place
from mbm.solver.linear_algebra import copied, dot, filled, gradient_of
from mbm.solver.linearisation import set_cost_rounding
from mbm.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.solver.quadratic import solve_quadratic
from mbm.solver.step_control import relative_offset
from mbm.solver.steps import project
from mbm.solver.trust_region import begin, constraint_count
from mbm.solver.workspace import Linearisation, Work

MOST_STEPS = 60
"""Steps after which penalties take over."""

KEPT = 0.1
"""The share of what the gradient could ask for that a violation weighs at least: where the linearised constraint lets
the residuals vanish its multiplier is nothing, and the merit would not notice that it is left behind."""

HALVINGS = 40
FIRST_STEP_DAMPING = 1e-2
MOST_STEP_DAMPING = 1e4
"""Damping in scaled coordinates, where the residuals' singular values are about 1: when a step has failed, and ever."""

CONTRADICTIONS = 3
"""Iterations in a row whose linearised constraints contradict one another: penalties do better."""

NEAR_KKT = 0.1
"""The steps on the surface of the constraints are tried where the next step is shorter, in standard deviations."""

ON_BOUND = 1e-9
"""Distance from its bound, in standard deviations, below which a coordinate is at the bound."""


def begin_steps(problem: Problem, work: Work) -> None:
    """The first iterate, from the point where the iteration is."""
    place = work.here
    begin(problem, work)
    if work.stop == NOT_FINITE_AT_START:
        return
    filled(constraint_count(problem, work.rows.data), 0.0, work.multipliers)
    filled(constraint_count(problem, work.rows.data), 0.0, work.violation_weights)
    filled(problem.n, 0.0, place.stopped)
    work.stop = RUNNING
    work.worst = 0.0
    if set_place(problem, place, work) == 0:
        work.stop = NOT_FINITE_AT_START
        return
    arrive_on(problem, place, work)
    work.penalised = 1
    work.sequential = 1
    work.contradicting = 0
    work.damping = 0.0


def arrive_on(problem: Problem, place: Linearisation, work: Work) -> None:
    """Units and roundings at a place that `set_place` has seen."""
    set_units(problem, place, 1, work)
    set_cost_rounding(problem, place)


def leave_to_penalties(problem: Problem, work: Work) -> None:
    """Penalties go on from where the iteration is."""
    work.sequential = 0
    begin_rounds(problem, work)


def violations(problem: Problem, values: ConstantReals, work: Work) -> Real:
    """What the violations add to the merit function."""
    total = 0.0
    for c in range(constraint_count(problem, work.rows.data)):
        missed = fabs(values[c]) if work.equation[c] == 1 else values[c]
        if not missed <= 0.0:
            total += work.violation_weights[c] * missed
    return total


def choose_equations(problem: Problem, work: Work) -> None:
    """`held`: the units of the equations; `chosen`: all coordinates."""
    for c in range(constraint_count(problem, work.rows.data)):
        work.held[c] = work.units[c] * float(work.equation[c])
    for j in range(problem.n):
        work.chosen[j] = j


def sequential_step(problem: Problem, work: Work) -> None:
    """One iteration."""
    n = problem.n
    here = work.here
    work.iterations += 1
    choose_equations(problem, work)
    feasible = solve_quadratic(problem, here, work)
    work.contradicting = 0 if feasible == 1 else work.contradicting + 1
    if work.contradicting > CONTRADICTIONS or work.iterations > MOST_STEPS:
        leave_to_penalties(problem, work)
        return
    inside = 0.0
    along = 0.0
    for i in range(n):
        moved = dot(n - i, here.triangle[i * (n + 1) + i :], here.full[i:])
        inside += moved * moved
        along += moved * here.triangle[i * (n + 1) + n]
    outside = here.cost - inside
    here.offset = relative_offset(inside, outside if outside > 0.0 else 0.0, n, work.rows.data.count - n)
    copied(constraint_count(problem, work.rows.data), work.forces, work.multipliers)
    if feasible == 1 and (here.offset <= NEAR_KKT or inside <= NEAR_KKT * NEAR_KKT):
        set_held_by_bounds(problem, here, work)
        copied(n, here.full, work.step)
        if polish(problem, work) == 1:
            return
        linearise(problem, here.point, work)
        set_units(problem, here, 1, work)
    set_weights(problem, here, work)
    search(problem, along, feasible, work)


def set_held_by_bounds(problem: Problem, place: Linearisation, work: Work) -> None:
    """Mark coordinates that stand on a bound which pushes them."""
    n = problem.n
    for j in range(n):
        low = work.pushes[j] < 0.0 and place.x[j] <= work.rows.constants[BOUNDS_AT + j]
        high = work.pushes[j] > 0.0 and place.x[j] >= work.rows.constants[BOUNDS_AT + n + j]
        place.free[j] = 0.0 if low or high else 1.0


def set_weights(problem: Problem, place: Linearisation, work: Work) -> None:
    """Weights of the violations above every multiplier, falling slowly (Powell 1978)."""
    square = 0.0
    for j in range(problem.n):
        if place.norms[j] > 0.0:
            pull = gradient_of(problem.n, j, place.triangle) / place.norms[j]
            square += pull * pull
    weights = work.violation_weights
    for c in range(constraint_count(problem, work.rows.data)):
        needed = max(1.1 * fabs(work.multipliers[c]), KEPT * sqrt(square) / work.units[c])
        weights[c] = max(needed, 0.5 * (weights[c] + needed))


def search(problem: Problem, along: Real, feasible: Integer, work: Work) -> None:
    """Go along the step of the subproblem; ``along`` is the derivative of half the cost."""
    here = work.here
    violated = violations(problem, work.values, work)
    before = 0.5 * here.cost + violated
    promised = violated - along
    rounding = 0.5 * here.cost_rounding
    for c in range(constraint_count(problem, work.rows.data)):
        rounding += work.violation_weights[c] * work.roundings[c]
    if feasible == 1 and promised <= UNDECIDED * rounding:
        leave_to_penalties(problem, work)
        return
    length = 1.0
    for tries in range(HALVINGS):
        wanted = before + rounding - (LEAST_GAIN_RATIO * length * promised if promised > 0.0 else 0.0)
        reached = try_length(problem, length, work)
        if reached > wanted and tries == 0 and isfinite(reached):
            reached = try_corrected(problem, work)
        if reached <= wanted and reached < before + rounding and go_there(problem, length, work) == 1:
            return
        length *= 0.5 if tries < 4 else 0.1
        if length < 1e-12:
            break
    if work.damping >= MOST_STEP_DAMPING:
        leave_to_penalties(problem, work)
    else:
        work.damping = max(100.0 * work.damping, FIRST_STEP_DAMPING)


def try_length(problem: Problem, length: Real, work: Work) -> Real:
    """The merit at this share of the step, inside the bounds; infinite where it is not finite."""
    n = problem.n
    here = work.here
    x = work.x
    for j in range(n):
        work.shift[j] = length * here.full[j]
    retract(problem, here.point, work.shift, work.trial)
    if problem.boxed == 1:
        coordinates_of(problem, work.trial, x)
        project(problem, work.rows.constants, x)
        for j in range(n):
            bound = work.rows.constants[BOUNDS_AT + j if work.pushes[j] < 0.0 else BOUNDS_AT + n + j]
            near = max(ON_BOUND / here.norms[j] if here.norms[j] > 0.0 else 0.0, 8.0 * EPSILON * fabs(bound))
            kept = problem.positive[j] != 0 and bound <= 0.0
            if work.pushes[j] != 0.0 and fabs(x[j] - bound) <= near and not kept:
                x[j] = bound
        place_coordinates(problem, x, work.trial)
    residuals = work.rows.residuals
    cost = cost_at_point(problem, work.rows, work.trial, 1, 0, residuals)
    evaluate(problem, work.trial, 0, work.rows, work.trial_values, work.slopes)
    work.evaluations += 1
    found = 0.5 * cost + violations(problem, work.trial_values, work)
    return found if isfinite(found) else inf


def try_corrected(problem: Problem, work: Work) -> Real:
    """The merit after the full step with the curvature of the constraints answered that showed at its end."""
    n = problem.n
    here = work.here
    copied(n, here.full, work.step)
    for c in range(constraint_count(problem, work.rows.data)):
        work.values[c] = work.trial_values[c] - dot(n, work.slopes[c * n :], here.full)
    choose_equations(problem, work)
    solve_quadratic(problem, here, work)
    found = try_length(problem, 1.0, work)
    copied(n, work.step, here.full)
    evaluate(problem, here.point, 0, work.rows, work.values, work.slopes)
    return found


def go_there(problem: Problem, length: Real, work: Work) -> Integer:
    """The trial point is where the iteration is from now on; 0 where something there is not finite."""
    there = work.other
    copied(problem.numbers, work.trial, there.point)
    filled(problem.n, 0.0, there.stopped)
    filled(problem.n, 1.0, there.free)
    if set_place(problem, there, work) == 0:
        linearise(problem, work.here.point, work)
        return 0
    work.other = work.here
    work.here = there
    arrive_on(problem, there, work)
    if length >= 1.0:
        work.damping = 0.1 * work.damping if work.damping > 1e-6 else 0.0
    elif length < 0.2:
        work.damping = min(max(10.0 * work.damping, FIRST_STEP_DAMPING), MOST_STEP_DAMPING)
    return 1
