"""The end of a constrained solve: Newton's steps on the surface of the constraints that the penalties show to hold.

Heavy penalties drown the residuals' digits in their own roundings. Once they have come near, with the signs of the
multipliers, equations alone are left to be solved, and those converge quadratically. Where the steps do not end in a
minimum for which the signs are right, nothing has happened: the search goes on.

Which constraints hold the estimates: what the signs of multipliers and values say at a place on their surface.

An active-set method's rules (Nocedal and Wright 2006, 16.5).
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.constraint_manifold import choose_free, kkt_step, set_null_space
from mbm.solver.constraint_values import linearise, set_units
from mbm.solver.decisions import DIFFERENCE, EXACT, LEAST_DIFFERENCE, MET, MOST_DENSE, POLISH, SETTLED, SLOW_KKT
from mbm.solver.description import BOUNDS_AT, ROUNDING, RUNNING, SMALL_OFFSET, TOLERANCE, Problem
from mbm.solver.equations import cost_at_point
from mbm.solver.linear_algebra import add_multiple, column_product, copied, filled, gradient_of, symmetrised
from mbm.solver.manifolds import coordinates_of, retract
from mbm.solver.sweeps import sweep
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Linearisation, Work

STEPS_AT_MOST = 20

CLOSE = 0.3
"""A first step longer than this, in standard deviations, is left to the penalties."""


def set_place(
    problem: Problem,
    place: Linearisation,
    work: Work,
) -> Integer:
    """Residuals, without penalties, and constraints at the point of a place; 0 where something is not finite."""
    n = problem.n
    triangle = place.triangle
    point = place.point
    residuals = work.rows.residuals
    coordinates_of(problem, point, place.x)
    place.cost = cost_at_point(problem, work.rows, point, 1, 0, residuals)
    sweep(problem, point, 0, 0, work.rows, residuals, triangle)
    linearise(problem, point, work)
    work.evaluations += 1
    total = place.cost
    for j in range(n):
        place.norms[j] = sqrt(column_product(j + 1, n + 1, triangle[j:], triangle[j:]))
        total += place.norms[j]
    for c in range(constraint_count(problem, work.rows.data)):
        total += fabs(work.values[c])
        for j in range(n):
            total += fabs(work.slopes[c * n + j])
    if not isfinite(total):
        return 0
    set_units(problem, place, 0, work)
    return 1


def set_lagrangian_curvature(
    problem: Problem,
    count: Integer,
    place: Linearisation,
    work: Work,
) -> Integer:
    """``Σ r ∇²r + Σ λ ∇²c`` at a place that `set_null_space` has seen, by forward differences; 0: it is not finite."""
    n = problem.n
    step = work.shift
    there = work.gradient_shifted
    curvature = work.curvature
    point = work.trial
    residuals = work.rows.residuals
    freedom = float(work.rows.data.count - count)
    spread = sqrt(place.cost / (freedom if freedom > 1.0 else 1.0))
    if spread < 1e-3:
        spread = 1e-3
    filled(n * n, 0.0, curvature)
    set_gradient(problem, place.point, residuals, work, work.gradient)
    total = 0.0
    for k in range(count):
        j = work.chosen[k]
        filled(n, 0.0, step)
        step[j] = DIFFERENCE * spread / work.scale[k]
        if LEAST_DIFFERENCE * fabs(place.x[j]) > step[j]:
            step[j] = LEAST_DIFFERENCE * fabs(place.x[j])
        retract(problem, place.point, step, point)
        linearise(problem, point, work)
        set_gradient(problem, point, residuals, work, there)
        for i in range(n):
            curvature[j * n + i] = (there[i] - work.gradient[i]) / step[j]
            total += fabs(curvature[j * n + i])
    work.evaluations += count
    symmetrised(n, 1.0, curvature)
    linearise(problem, place.point, work)
    return 1 if isfinite(total) else 0


def set_gradient(
    problem: Problem,
    point: ConstantReals,
    residuals: ConstantReals,
    work: Work,
    gradient: Reals,
) -> None:
    """``Jᵀ r + Σ λ ∇c`` (n,) with the slopes at a point, residuals and multipliers as they are given."""
    n = problem.n
    sweep(problem, point, 1, 0, work.rows, residuals, gradient)
    for c in range(constraint_count(problem, work.rows.data)):
        add_multiple(n, work.forces[c], work.slopes[c * n :], gradient)


def move(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """The step of a place taken; 0 where that leaves the bounds."""
    n = problem.n
    point = work.trial
    x = place.x
    retract(problem, place.point, place.full, point)
    copied(problem.numbers, point, place.point)
    coordinates_of(problem, point, x)
    for j in range(n):
        if place.free[j] != 0.0:
            if x[j] < work.rows.constants[BOUNDS_AT + j] or x[j] > work.rows.constants[BOUNDS_AT + n + j]:
                return 0
            if problem.positive[j] != 0 and not x[j] > 0.0:
                return 0
    return 1


def ending_of(
    constants: ConstantReals, place: Linearisation, steps: Integer, fresh: Integer, before: Real, worst: Real
) -> Integer:
    """Why the steps end at a place, `RUNNING`: they do not, -1: they lead nowhere.

    After ``steps`` with the same constraints; ``fresh`` 1: the last had the second-order term of its own place. A step
    has to be short by the stated noise and by that which the residuals show.
    """
    offset = place.offset
    small = offset <= constants[TOLERANCE] and sqrt(place.predicted) <= constants[TOLERANCE]
    if worst <= EXACT and steps > 0 and small:
        return SMALL_OFFSET
    if worst <= MET and place.length <= place.rounding:
        return ROUNDING
    if fresh == 1 and not offset <= POLISH * before:
        return ROUNDING if worst <= MET and offset <= SETTLED else -1
    return RUNNING


def begin_kkt(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """A place where the iteration is, and which constraints hold there; how many coordinates may move."""
    n = problem.n
    here = work.here
    copied(problem.numbers, here.point, place.point)
    copied(n, here.free, place.free)
    filled(n, 0.0, place.stopped)
    set_active(problem, work)
    return choose_free(problem, place, work)


def polish(
    problem: Problem,
    work: Work,
) -> Integer:
    """1: the solve is at its end, at a point on the surface near that of the iteration; 0: nothing has happened."""
    place = work.other
    count = begin_kkt(problem, place, work)
    before = inf
    curved = 0
    fresh = 0
    steps = 0
    for _ in range(STEPS_AT_MOST):
        if set_place(problem, place, work) == 0:
            return 0
        reflected = set_null_space(problem, place, count, work)
        if kkt_step(problem, count, reflected, curved, place, work) == 0:
            return 0
        worst = largest_violation(problem, work)
        ending = ending_of(work.rows.constants, place, steps, fresh, before, worst)
        if ending < 0:
            return 0
        if ending != RUNNING:
            nothing = work.rows.constants[TOLERANCE] * (1.0 + sqrt(place.cost))
            if change_active(problem, nothing, work) == 0:
                if pushes_on_bounds(problem, nothing, place, work) == 0:
                    return 0
                arrive_kkt(problem, ending, worst, work)
                return 1
            steps = 0
            reflected = set_null_space(problem, place, count, work)
            if kkt_step(problem, count, reflected, curved, place, work) == 0:
                return 0
        if steps == 0 and not (place.offset <= CLOSE or place.length <= CLOSE):
            return 0
        fresh = 0
        if steps > 0 and not place.offset <= SLOW_KKT * before and problem.n <= MOST_DENSE:
            if set_lagrangian_curvature(problem, count, place, work) == 0:
                return 0
            curved = 1
            fresh = 1
            reflected = set_null_space(problem, place, count, work)
            if kkt_step(problem, count, reflected, curved, place, work) == 0:
                return 0
        before = place.offset
        steps += 1
        work.iterations += 1
        if move(problem, place, work) == 0:
            return 0
    return 0


def arrive_kkt(
    problem: Problem,
    ending: Integer,
    worst: Real,
    work: Work,
) -> None:
    """The iteration ends at the other place, with its multipliers."""
    there = work.other
    work.other = work.here
    work.here = there
    work.stop = ending
    work.worst = worst
    copied(constraint_count(problem, work.rows.data), work.forces, work.multipliers)


def set_active(problem: Problem, work: Work) -> None:
    """`held`: the units of the equations, and of the inequalities that have a multiplier."""
    for c in range(constraint_count(problem, work.rows.data)):
        holds = work.equation[c] == 1 or work.multipliers[c] > 0.0
        work.held[c] = work.units[c] if holds else 0.0


def largest_violation(problem: Problem, work: Work) -> Real:
    """Of the equations and of the inequalities that hold like them: in units, beyond rounding."""
    worst = 0.0
    for c in range(constraint_count(problem, work.rows.data)):
        missed = fabs(work.values[c]) - work.roundings[c]
        holds = work.equation[c] == 1 or work.held[c] != 0.0
        if holds and missed > worst * work.units[c]:
            worst = missed / work.units[c]
    return worst


def change_active(problem: Problem, nothing: Real, work: Work) -> Integer:
    """1 where another inequality holds from now on: the most overstepped one does; or else the one does not any more
    whose multiplier is the most negative, beyond ``nothing`` standard deviations. 0: all signs are right.
    """
    forces = work.forces
    units = work.units
    held = work.held
    overstepped = -1
    pulled = -1
    most = EXACT
    least = -nothing
    for c in range(constraint_count(problem, work.rows.data)):
        if work.equation[c] == 0:
            if held[c] == 0.0 and work.values[c] - work.roundings[c] > most * units[c]:
                most = (work.values[c] - work.roundings[c]) / units[c]
                overstepped = c
            if held[c] != 0.0 and forces[c] * units[c] < least:
                least = forces[c] * units[c]
                pulled = c
            if forces[c] < 0.0:
                forces[c] = 0.0
    if overstepped >= 0:
        held[overstepped] = units[overstepped]
        return 1
    if pulled >= 0:
        held[pulled] = 0.0
        return 1
    return 0


def pushes_on_bounds(
    problem: Problem,
    nothing: Real,
    place: Linearisation,
    work: Work,
) -> Integer:
    """1 where nothing pulls coordinates away from the bounds that hold them, beyond ``nothing`` standard deviations."""
    n = problem.n
    for j in range(n):
        if place.free[j] == 0.0:
            slope = gradient_of(n, j, place.triangle)
            for c in range(constraint_count(problem, work.rows.data)):
                slope += work.forces[c] * work.slopes[c * n + j]
            low = place.x[j] <= work.rows.constants[BOUNDS_AT + j] and slope >= -nothing * place.norms[j]
            high = place.x[j] >= work.rows.constants[BOUNDS_AT + n + j] and slope <= nothing * place.norms[j]
            if not (low or high):
                return 0
    return 1
