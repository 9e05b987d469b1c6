"""Trial steps: where a step inside the radius leads, and what the equations say there.

A second try answers the curvature met along the step (Transtrum and Sethna 2012).
"""

from __future__ import annotations

from math import isfinite

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.decisions import BEND, CURVED_SHARE, UNDECIDED
from mbm.solver.description import Problem
from mbm.solver.equations import cost_at_point
from mbm.solver.linear_algebra import (
    copied,
    damped_triangle,
    dot,
    filled,
    solve_transposed,
    solve_upper,
    times_transposed,
    times_upper,
)
from mbm.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.solver.step_control import shortened
from mbm.solver.steps import boxed_step, judge_step, land, limited_step
from mbm.solver.sweeps import set_triangle, sweep
from mbm.solver.workspace import Linearisation, Work


def step_within(problem: Problem, radius: Real, work: Work) -> None:
    """The step inside the radius: `step`, `step_stopped`, its promise and length."""
    n = problem.n
    place = work.here
    vector = work.step
    stopped = work.step_stopped
    work.undamped = 0
    if place.length <= 1.1 * radius:
        work.undamped = 1
        copied(n, place.full, vector)
        copied(n, place.stopped, stopped)
        work.step_predicted = place.predicted
        work.step_length = place.length
        return
    if problem.boxed == 1:
        boxed_step(problem, place, radius, work, vector, stopped)
        return
    filled(n, 0.0, stopped)
    limited_step(problem, n, place.factor, place.projected, radius, work, vector)
    for j in range(n):
        vector[j] /= place.scale[j]
    judge_step(problem, place, vector, work)


def correct_step(
    problem: Problem,
    work: Work,
) -> Integer:
    """The step with the curvature answered that showed at its end: `corrected`; 0 where the answer is too long.

    Half the geodesic acceleration of Transtrum and Sethna (2012), from the trial point instead of an extra one.
    """
    n = problem.n
    place = work.here
    factor = place.factor
    projected = place.projected
    scale = place.scale
    scaled = work.scaled
    corrected = work.corrected
    moved = work.moved
    residuals = work.rows.residuals[work.residuals_tried * problem.most_residuals :]
    sweep(problem, place.point, 1, work.penalised, work.rows, residuals, work.gradient)
    for j in range(n):
        scaled[j] = scale[j] * work.step[j]
    times_upper(n, factor, scaled, moved)
    size = dot(n, scaled, scaled)
    damping = 0.0
    if size > 0.0:
        damping = -(dot(n, moved, moved) + dot(n, moved, projected)) / size
        if not damping > 0.0:
            damping = 0.0
    for j in range(n):
        moved[j] += projected[j]
    times_transposed(n, factor, moved, work.back)
    for j in range(n):
        corrected[j] = work.gradient[j] / scale[j] - work.back[j]
    triangle = work.damped
    damped_triangle(n, factor, projected, damping, triangle, work.right, work.row)
    solve_transposed(n, triangle, corrected)
    solve_upper(n, triangle, corrected)
    most = BEND * work.step_length
    if not dot(n, corrected, corrected) <= most * most:
        return 0
    for j in range(n):
        corrected[j] = (scaled[j] - corrected[j]) / scale[j]
    return 1


def cost_of_trial(problem: Problem, penalised: Integer, work: Work) -> Real:
    """The cost at `trial`, which is what is tried now."""
    work.tried = work.trial
    work.residuals_tried = (work.residuals_here + 1) % 3
    work.evaluations += 1
    residuals = work.rows.residuals[work.residuals_tried * problem.most_residuals :]
    work.cost_tried = cost_at_point(problem, work.rows, work.trial, 1, penalised, residuals)
    return work.cost_tried


def try_step(
    problem: Problem,
    work: Work,
) -> None:
    """Evaluate the step, and once more with the curvature answered where it brought too little."""
    place = work.here
    vector = work.step
    point = work.trial
    retract(problem, place.point, vector, point)
    if problem.boxed == 1:
        x = work.x
        coordinates_of(problem, point, x)
        land(problem, work.rows.constants, vector, work.step_stopped, x)
        place_coordinates(problem, x, point)
    cost = cost_of_trial(problem, work.penalised, work)
    if not isfinite(cost) or problem.boxed == 1 or not work.step_predicted > UNDECIDED * place.cost_rounding:
        return
    if place.cost - cost >= CURVED_SHARE * work.step_predicted:
        return
    if correct_step(problem, work) == 0:
        return
    curved = work.corrected_trial
    retract(problem, place.point, work.corrected, curved)
    there = work.rows.residuals[((work.residuals_here + 2) % 3) * problem.most_residuals :]
    work.evaluations += 1
    lower = cost_at_point(problem, work.rows, curved, 1, work.penalised, there)
    if lower < cost:
        work.cost_tried = lower
        work.tried = work.corrected_trial
        work.residuals_tried = (work.residuals_here + 2) % 3


def factor_there(
    problem: Problem,
    work: Work,
) -> Integer:
    """The trial point as the other place, with its triangle; 0 where that is not finite."""
    n = problem.n
    there = work.other
    copied(problem.numbers, work.tried, there.point)
    there.cost = work.cost_tried
    if LANES > 1:
        set_triangle(problem, there, work)
    else:
        sweep(problem, there.point, 0, work.penalised, work.rows, work.rows.constants, there.triangle)
    total = 0.0
    for i in range((n + 1) * (n + 1)):
        total += there.triangle[i]
    return 1 if isfinite(total) else 0


def same_point(problem: Problem, a: ConstantReals, b: ConstantReals) -> Integer:
    """1 where two points are equal to the last bit."""
    for i in range(problem.numbers):
        if a[i] != b[i]:
            return 0
    return 1


def shortening(problem: Problem, place: Linearisation, vector: ConstantReals, actual: Real, work: Work) -> Real:
    """MINPACK's shortening after a growing cost: half of where the parabola through slope and value is least."""
    if actual >= 0.0:
        return shortened(0.0, actual)
    n = problem.n
    for j in range(n):
        work.scaled[j] = place.scale[j] * vector[j]
    times_upper(n, place.factor, work.scaled, work.moved)
    return shortened(dot(n, work.moved, place.projected), actual)
