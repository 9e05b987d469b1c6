"""A place: a point with all that depends on it alone, and the tests that end the iteration there.

Where a column of the scaled triangle is as good as dependent on those before it, the place is *deficient*: of all
steps that do equally well the shortest is taken then.
"""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.decisions import (
    CAP,
    EPSILON,
    FLOOR,
    HUGE,
    ROUNDED_ROTATION,
    ROUNDING_ERRORS,
    TINY,
    ZERO_COST,
    rounding_of_norm,
)
from mbm.solver.description import BOUNDS_AT, EXACT_FIT, ROUNDING, RUNNING, SMALL_OFFSET, Problem
from mbm.solver.linear_algebra import column_product, divided, filled, times_transposed
from mbm.solver.manifolds import coordinates_of
from mbm.solver.newton import newton_step
from mbm.solver.step_control import relative_offset
from mbm.solver.steps import boxed_step, dependent_share, norm_of, undamped_step, without_dependent
from mbm.solver.workspace import Linearisation, Work


@distinct_arrays
def set_metric(problem: Problem, x: ConstantReals, peak: ConstantReals, scale: Reals) -> None:
    """The scale of each coordinate (n,) > 0, from the largest norms that the columns have had."""
    n = problem.n
    most = 0.0
    least = peak[0] * fabs(x[0])
    for j in range(n):
        value = peak[j] * fabs(x[j])
        if value > most:
            most = value
        if value < least:
            least = value
    floor = FLOOR * most
    even = least >= floor and floor > 0.0
    for j in range(n):
        scale[j] = peak[j]
        if not even:
            wanted = floor / fabs(x[j]) if x[j] != 0.0 else 0.0
            if wanted > CAP * peak[j]:
                wanted = CAP * peak[j]
            if wanted > scale[j]:
                scale[j] = wanted
            if not scale[j] > 0.0:
                scale[j] = 1.0
    curved = 0.0
    for j in range(n):
        if problem.number_of[j] < 0 and scale[j] > curved:
            curved = scale[j]
    for j in range(n):
        if problem.number_of[j] < 0 and scale[j] < ROUNDED_ROTATION * curved:
            scale[j] = curved


@distinct_arrays
def set_factor(
    n: Integer, least: Real, triangle: ConstantReals, scale: ConstantReals, factor: Reals, projected: Reals
) -> Integer:
    """The scaled triangle and Qᵀr; how many columns are as good as dependent on those before them (share ``least``)."""
    for i in range(n):
        filled(i, 0.0, factor[i * n :])
        divided(n - i, triangle[i * (n + 1) + i :], scale[i:], factor[i * n + i :])
        projected[i] = triangle[i * (n + 1) + n]
    return without_dependent(n, least, factor, projected)


@distinct_arrays
def set_free(
    problem: Problem, constants: ConstantReals, x: ConstantReals, gradient: ConstantReals, free: Reals
) -> None:
    """Mark coordinates that are not at a bound which the descent direction would leave."""
    n = problem.n
    for j in range(n):
        low = x[j] <= constants[BOUNDS_AT + j] and gradient[j] >= 0.0
        high = x[j] >= constants[BOUNDS_AT + n + j] and gradient[j] <= 0.0
        free[j] = 0.0 if low or high else 1.0


def set_cost_rounding(problem: Problem, place: Linearisation) -> None:
    """The rounding of ``‖r‖`` and of the cost at a place whose norms are known."""
    terms = 0.0
    for j in range(problem.n):
        size = fabs(place.x[j]) if problem.number_of[j] >= 0 else 1.0
        terms += place.norms[j] * size * place.norms[j] * size
    noise = rounding_of_norm(terms, place.cost)
    place.rounding = noise
    place.cost_rounding = 2.0 * noise * sqrt(place.cost) + noise * noise


def arrive(
    problem: Problem,
    place: Linearisation,
    reached: Integer,
    curved: Integer,
    work: Work,
) -> None:
    """Everything at a place whose point, cost and triangle are known; ``reached`` 1: from where the iteration is."""
    n = problem.n
    x = place.x
    norms = place.norms
    peak = place.peak
    triangle = place.triangle
    coordinates_of(problem, place.point, x)
    deficient = 0
    for j in range(n):
        norms[j] = sqrt(column_product(j + 1, n + 1, triangle[j:], triangle[j:]))
        if not (norms[j] > TINY and norms[j] < HUGE):
            deficient += 1
        peak[j] = norms[j]
    if reached == 1:
        old = work.here.peak
        for j in range(n):
            if old[j] > peak[j]:
                peak[j] = old[j]
    set_metric(problem, x, peak, place.scale)
    set_cost_rounding(problem, place)
    least = dependent_share(problem, work.count)
    deficient += set_factor(n, least, triangle, place.scale, place.factor, place.projected)
    place.deficient = deficient
    filled(n, 1.0, place.free)
    if problem.boxed == 1:
        gradient = work.gradient
        times_transposed(n, place.factor, place.projected, gradient)
        set_free(problem, work.rows.constants, x, gradient, place.free)
    judge(problem, place, curved, work)


def judge(problem: Problem, place: Linearisation, curved: Integer, work: Work) -> None:
    """The undamped step at a place (Newton's where ``curved``), its offset, and why the iteration ends there if so."""
    n = problem.n
    set_full_step(problem, place, curved, work)
    norms = place.norms
    moving = 0
    movement = 0.0
    terms = 0.0
    for j in range(n):
        if place.free[j] != 0.0:
            moving += 1
        movement += norms[j] * place.full[j] * norms[j] * place.full[j]
        size = fabs(place.x[j]) if problem.number_of[j] >= 0 else 1.0
        terms += norms[j] * size * norms[j] * size
    rank = n - place.deficient
    if rank > moving:
        rank = moving
    freedom = work.count - rank
    place.freedom = freedom
    noise = place.rounding
    outside = place.cost - place.predicted
    if outside < 0.0:
        outside = 0.0
    offset = relative_offset(place.predicted, outside, moving, freedom)
    place.offset = offset
    ending = RUNNING
    if place.cost <= noise * noise or place.cost <= ZERO_COST:
        ending = EXACT_FIT
    elif offset <= work.tolerance:
        ending = SMALL_OFFSET
    elif sqrt(movement) <= ROUNDING_ERRORS * EPSILON * sqrt(terms):
        ending = ROUNDING
    place.ending = ending


def set_full_step(problem: Problem, place: Linearisation, curved: Integer, work: Work) -> None:
    """The undamped step of a place, its promise and length."""
    n = problem.n
    full = place.full
    projected = place.projected
    filled(n, 0.0, place.stopped)
    if curved == 1 and newton_step(problem, place, work) == 1:
        return
    if problem.boxed == 1:
        promised = work.step_predicted
        length = work.step_length
        boxed_step(problem, place, inf, work, full, place.stopped)
        place.predicted = work.step_predicted
        place.length = work.step_length
        work.step_predicted = promised
        work.step_length = length
        return
    undamped_step(n, place.factor, projected, work, full)
    inside = 0.0
    for j in range(n):
        if place.factor[j * n + j] != 0.0:
            inside += projected[j] * projected[j]
    place.predicted = inside
    place.length = norm_of(n, full)
    for j in range(n):
        full[j] /= place.scale[j]
