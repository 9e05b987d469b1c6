"""The end of a constrained solve: Newton's steps on the surface of the constraints that the penalties show to hold.

Heavy penalties drown the residuals' digits in their own roundings. Once they have come near, with the signs of the
multipliers, equations alone are left to be solved, and those converge quadratically; tests and constants are those of
`solution.constrained.sequential`. Where the steps do not end in a minimum for which the signs are right, nothing has
happened: the penalties go on.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.target.decisions import DIFFERENCE, EXACT, LEAST_DIFFERENCE, MET, POLISH, SETTLED, SLOW_KKT
from mbm.target.solver.beginning import constraint_count
from mbm.target.solver.constraint_values import linearise, set_units
from mbm.target.solver.description import (
    BOUNDS_AT,
    COORDINATES,
    DATA_COUNT,
    NUMBERS,
    POSITIVE_AT,
    ROUNDING,
    RUNNING,
    SMALL_OFFSET,
    TOLERANCE,
)
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.linear_algebra import copied, dot, filled
from mbm.target.solver.manifolds import coordinates_of, retract
from mbm.target.solver.surface import SCALE, choose_free, surface_step, turn_place
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.working import change_working, largest_violation, pushes_on_bounds, set_working
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_NOISE,
    AT_OFFSET,
    AT_POINT,
    AT_PREDICTED,
    EVALUATIONS_DONE,
    FLAGS,
    FORCES,
    FREE,
    FULL,
    HERE,
    ITERATIONS_DONE,
    LAMBDA,
    NORMS,
    STOP,
    STOPPED,
    VALUES,
    WORST,
    X,
    curvature_at,
    multipliers_at,
    place_at,
    residuals_at,
    scalars_at,
    slopes_at,
    step_at,
    trial_at,
    triangle_at,
    vector_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

STEPS_AT_MOST = 20

CLOSE = 0.3
"""A first step longer than this, in standard deviations, is left to the penalties."""


def set_place(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    place: Reals,
    work: Reals,
    flags: Integers,
) -> Integer:
    """Residuals, without penalties, and constraints at the point of a place; 0 where something is not finite."""
    n = system[COORDINATES]
    triangle = place[triangle_at(system) :]
    norms = place[vector_at(system, NORMS) :]
    point = place[AT_POINT:]
    residuals = work[residuals_at(system, 0) :]
    coordinates_of(system, point, place[vector_at(system, X) :])
    count = residuals_at_point(system, constants, data, index, point, 1, 0, work, residuals)
    place[AT_COST] = dot(count, residuals, residuals)
    sweep(system, constants, data, index, columns, point, 0, 0, work, residuals, triangle)
    linearise(system, data, index, columns, point, work)
    flags[EVALUATIONS_DONE] += 1
    total = place[AT_COST]
    for j in range(n):
        square = 0.0
        for i in range(j + 1):
            square += triangle[i * (n + 1) + j] * triangle[i * (n + 1) + j]
        norms[j] = sqrt(square)
        total += norms[j]
    values = work[multipliers_at(system, VALUES) :]
    slopes = work[slopes_at(system) :]
    for c in range(constraint_count(system, data)):
        total += fabs(values[c])
        for j in range(n):
            total += fabs(slopes[c * n + j])
    if not isfinite(total):
        return 0
    set_units(system, data, place, 0, work)
    return 1


def set_surface_curvature(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    count: Integer,
    place: ConstantReals,
    work: Reals,
    flags: Integers,
) -> Integer:
    """``Σ r ∇²r + Σ λ ∇²c`` at a place that `turn_place` has seen, by forward differences; 0: it is not finite."""
    n = system[COORDINATES]
    chosen = flags[FLAGS:]
    x = place[vector_at(system, X) :]
    scale = work[step_at(system, SCALE) :]
    step = work[step_at(system, 7) :]
    there = work[step_at(system, 8) :]
    gradient = work[step_at(system, 9) :]
    curvature = work[curvature_at(system) :]
    point = work[trial_at(system, 0) :]
    residuals = work[residuals_at(system, 0) :]
    freedom = float(data[DATA_COUNT] - count)
    spread = sqrt(place[AT_COST] / (freedom if freedom > 1.0 else 1.0))
    if spread < 1e-3:
        spread = 1e-3
    filled(n * n, 0.0, curvature)
    set_gradient(system, constants, data, index, columns, place[AT_POINT:], residuals, work, gradient)
    total = 0.0
    for k in range(count):
        j = chosen[k]
        filled(n, 0.0, step)
        step[j] = DIFFERENCE * spread / scale[k]
        if LEAST_DIFFERENCE * fabs(x[j]) > step[j]:
            step[j] = LEAST_DIFFERENCE * fabs(x[j])
        retract(system, place[AT_POINT:], step, point)
        linearise(system, data, index, columns, point, work)
        set_gradient(system, constants, data, index, columns, point, residuals, work, there)
        for i in range(n):
            curvature[j * n + i] = (there[i] - gradient[i]) / step[j]
            total += fabs(curvature[j * n + i])
    flags[EVALUATIONS_DONE] += count
    for i in range(n):
        for k in range(i):
            value = 0.5 * (curvature[i * n + k] + curvature[k * n + i])
            curvature[i * n + k] = value
            curvature[k * n + i] = value
    linearise(system, data, index, columns, place[AT_POINT:], work)
    return 1 if isfinite(total) else 0


def set_gradient(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    residuals: ConstantReals,
    work: Reals,
    gradient: Reals,
) -> None:
    """``Jᵀ r + Σ λ ∇c`` (n,) with the slopes at a point, residuals and multipliers as they are given."""
    n = system[COORDINATES]
    forces = work[multipliers_at(system, FORCES) :]
    slopes = work[slopes_at(system) :]
    sweep(system, constants, data, index, columns, point, 1, 0, work, residuals, gradient)
    for c in range(constraint_count(system, data)):
        for j in range(n):
            gradient[j] += forces[c] * slopes[c * n + j]


def move(system: ConstantIntegers, constants: ConstantReals, place: Reals, work: Reals) -> Integer:
    """The step of a place taken; 0 where that leaves the bounds."""
    n = system[COORDINATES]
    point = work[trial_at(system, 0) :]
    x = place[vector_at(system, X) :]
    free = place[vector_at(system, FREE) :]
    retract(system, place[AT_POINT:], place[vector_at(system, FULL) :], point)
    copied(system[NUMBERS], point, place[AT_POINT:])
    coordinates_of(system, point, x)
    for j in range(n):
        if free[j] != 0.0:
            if x[j] < constants[BOUNDS_AT + j] or x[j] > constants[BOUNDS_AT + n + j]:
                return 0
            if system[system[POSITIVE_AT] + j] != 0 and not x[j] > 0.0:
                return 0
    return 1


def ending_of(
    constants: ConstantReals, place: ConstantReals, steps: Integer, fresh: Integer, before: Real, worst: Real
) -> Integer:
    """Why the steps end at a place, `RUNNING`: they do not, -1: they lead nowhere.

    After ``steps`` with the same constraints; ``fresh`` 1: the last had the second-order term of its own place. A step
    has to be short by the stated noise and by that which the residuals show.
    """
    offset = place[AT_OFFSET]
    small = offset <= constants[TOLERANCE] and sqrt(place[AT_PREDICTED]) <= constants[TOLERANCE]
    if worst <= EXACT and steps > 0 and small:
        return SMALL_OFFSET
    if worst <= MET and place[AT_LENGTH] <= place[AT_NOISE]:
        return ROUNDING
    if fresh == 1 and not offset <= POLISH * before:
        return ROUNDING if worst <= MET and offset <= SETTLED else -1
    return RUNNING


def begin_on_surface(
    system: ConstantIntegers, data: ConstantIntegers, number: Integer, work: Reals, flags: Integers
) -> Integer:
    """Place ``number`` where the iteration is, and which constraints hold there; how many coordinates may move."""
    n = system[COORDINATES]
    here = work[place_at(system, flags[HERE]) :]
    place = work[place_at(system, number) :]
    copied(system[NUMBERS], here[AT_POINT:], place[AT_POINT:])
    copied(n, here[vector_at(system, FREE) :], place[vector_at(system, FREE) :])
    filled(n, 0.0, place[vector_at(system, STOPPED) :])
    set_working(system, data, work)
    return choose_free(system, place, flags)


def polish(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> Integer:
    """1: the solve is at its end, at a point on the surface near that of the iteration; 0: nothing has happened."""
    number = 1 - flags[HERE]
    place = work[place_at(system, number) :]
    count = begin_on_surface(system, data, number, work, flags)
    before = inf
    curved = 0
    fresh = 0
    steps = 0
    for _ in range(STEPS_AT_MOST):
        if set_place(system, constants, data, index, columns, place, work, flags) == 0:
            return 0
        turned = turn_place(system, data, place, count, work, flags)
        if surface_step(system, data, count, turned, curved, place, work, flags) == 0:
            return 0
        worst = largest_violation(system, data, work)
        ending = ending_of(constants, place, steps, fresh, before, worst)
        if ending < 0:
            return 0
        if ending != RUNNING:
            nothing = constants[TOLERANCE] * (1.0 + sqrt(place[AT_COST]))
            if change_working(system, data, nothing, work) == 0:
                if pushes_on_bounds(system, constants, data, nothing, place, work) == 0:
                    return 0
                arrive_on_surface(system, data, number, ending, worst, work, flags)
                return 1
            steps = 0
            turned = turn_place(system, data, place, count, work, flags)
            if surface_step(system, data, count, turned, curved, place, work, flags) == 0:
                return 0
        if steps == 0 and not (place[AT_OFFSET] <= CLOSE or place[AT_LENGTH] <= CLOSE):
            return 0
        fresh = 0
        if steps > 0 and not place[AT_OFFSET] <= SLOW_KKT * before:
            if set_surface_curvature(system, constants, data, index, columns, count, place, work, flags) == 0:
                return 0
            curved = 1
            fresh = 1
            turned = turn_place(system, data, place, count, work, flags)
            if surface_step(system, data, count, turned, curved, place, work, flags) == 0:
                return 0
        before = place[AT_OFFSET]
        steps += 1
        flags[ITERATIONS_DONE] += 1
        if move(system, constants, place, work) == 0:
            return 0
    return 0


def arrive_on_surface(
    system: ConstantIntegers,
    data: ConstantIntegers,
    number: Integer,
    ending: Integer,
    worst: Real,
    work: Reals,
    flags: Integers,
) -> None:
    """The iteration ends at place ``number``, with its multipliers."""
    flags[HERE] = number
    flags[STOP] = ending
    work[scalars_at(system) + WORST] = worst
    forces = work[multipliers_at(system, FORCES) :]
    copied(constraint_count(system, data), forces, work[multipliers_at(system, LAMBDA) :])
