"""The start of an iteration, and the one step of affine equations.

One iteration of the trust region that Marquardt's method, the dogleg and Gauss-Newton share.

Moré (1978) for the radius and its update. Added to it: trial points without a finite residual or Jacobian are refused
and the radius shrinks; hard bounds; a second try along the curve where a step met curvature; Newton's steps at the end
where Gauss-Newton's are slow; and last steps that are judged by the relative offset of Bates and Watts (1981) instead
of the sum of squares, because the sum of squares stops telling points apart at half the digits.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import Integer, Real
from mbm.solver.decisions import (
    CREEP,
    LEAST_GAIN_RATIO,
    MOST_CREEPING,
    MOST_DENSE,
    NEAR_OFFSET,
    NEVER,
    OFFSET_DECREASE,
    PATIENCE,
    REACH,
    REFINEMENTS,
    SLOW_OFFSET,
    TRIAL_POINTS,
    UNDECIDED,
    UNSCALED,
)
from mbm.solver.description import (
    NO_FINITE_STEP,
    NOT_FINITE_AT_START,
    ONE_STEP,
    ROUNDING,
    RUNNING,
    UNSURE,
    DataSet,
    Problem,
)
from mbm.solver.equations import cost_at_point
from mbm.solver.kinks import settle_at_kink
from mbm.solver.linear_algebra import filled
from mbm.solver.linearisation import arrive, judge, set_curvature
from mbm.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.solver.step_control import radius_after, remaining
from mbm.solver.steps import project
from mbm.solver.sweeps import set_triangle, summed, sweep
from mbm.solver.trial_steps import cost_of_trial, factor_there, same_point, shortening, step_within, try_step
from mbm.solver.workspace import Work


def constraint_count(problem: Problem, data: DataSet) -> Integer:
    """Constraint values of a data set."""
    found = 0
    for b in range(problem.residual_blocks, problem.residual_blocks + problem.constraint_blocks):
        lines = problem.blocks[b].outputs
        found += lines * data.blocks[b].rows
    return found


def begin(
    problem: Problem,
    work: Work,
) -> None:
    """Everything where the iteration is, put into the bounds; `stop` says whether it is the end already.

    Among many unknowns the second-order term is not taken: it needs a Jacobian for each.
    """
    n = problem.n
    place = work.here
    point = place.point
    x = work.x
    if problem.boxed == 1:
        coordinates_of(problem, point, x)
        project(problem, work.rows.constants, x)
        place_coordinates(problem, x, point)
    work.curvature_known = 0
    work.patience = NEVER if n > MOST_DENSE else 0
    work.residuals_here = 0
    work.count = work.rows.data.count + work.penalised * constraint_count(problem, work.rows.data)
    work.stop = RUNNING
    work.evaluations += 1
    residuals = work.rows.residuals
    place.cost = cost_at_point(problem, work.rows, point, 1, work.penalised, residuals)
    triangle = place.triangle
    if LANES > 1:
        work.summed = summed(problem, work.rows.data)
        set_triangle(problem, place, work)
    else:
        sweep(problem, point, 0, work.penalised, work.rows, work.rows.constants, triangle)
    total = place.cost
    for i in range((n + 1) * (n + 1)):
        total += fabs(triangle[i])
    if not isfinite(total):
        filled((n + 1) * (n + 1), 0.0, triangle)
        work.stop = NOT_FINITE_AT_START
        place.deficient = 0
        return
    arrive(problem, place, 0, 0, work)
    work.stop = place.ending
    if problem.strict == 1 and place.deficient > 0:
        work.stop = UNSURE
    size = 0.0
    coordinates = place.x
    for j in range(n):
        size += place.scale[j] * coordinates[j] * place.scale[j] * coordinates[j]
    size = sqrt(size)
    length = sqrt(place.cost)
    work.radius = size if size > UNSCALED * length else length
    if problem.linear == 1 and work.penalised == 0:
        work.radius = inf


def solve_directly(
    problem: Problem,
    work: Work,
) -> None:
    """The minimum of affine equations in one step, with refinement."""
    finite = 1
    moved = 0
    work.iterations = 1
    for tries in range(1 + REFINEMENTS):
        here = work.here
        point = work.trial
        retract(problem, here.point, here.full, point)
        cost = cost_of_trial(problem, 0, work)
        finite = 1 if isfinite(cost) else 0
        if finite == 0 or cost > here.cost + here.cost_rounding:
            break
        if factor_there(problem, work) == 0:
            break
        there = work.other
        arrive(problem, there, 1, 0, work)
        if tries > 0 and not there.length < here.length:
            break
        work.here = there
        work.other = here
        work.residuals_here = work.residuals_tried
        moved = 1
    work.stop = ONE_STEP
    if moved == 0 and finite == 0:
        work.stop = NO_FINITE_STEP
    if problem.strict == 1 and work.here.deficient > 0:
        work.stop = UNSURE


def arrive_there(
    problem: Problem,
    share: Real,
    work: Work,
) -> None:
    """Go to the accepted point; the second-order term is taken where convergence is slow enough to pay for it.

    ``share`` of the promise that the step brought, negative where it was judged by the offset.
    """
    here = work.here
    there = work.other
    arrive(problem, there, 1, work.curvature_known, work)
    if share < 0.0 and not there.offset <= OFFSET_DECREASE * here.offset:
        no_better(problem, work)
        return
    if share >= 0.0:
        work.radius = radius_after(share, work.radius, work.step_length, work.undamped)
    work.here = there
    work.other = here
    work.residuals_here = work.residuals_tried
    work.stop = there.ending
    if work.patience > 0:
        work.patience -= 1
    if problem.strict == 1 and there.deficient > 0:
        work.stop = UNSURE
    if work.stop != RUNNING or there.offset <= SLOW_OFFSET * here.offset or work.patience > 0:
        return
    if there.offset < NEAR_OFFSET:
        few = float(problem.n + 2)
        if remaining(there.offset, here.offset, work.tolerance) <= few:
            return
    elif problem.n > MOST_CREEPING or here.cost - there.cost > CREEP * here.cost:
        return
    take_curvature(problem, work)
    longest = REACH * work.radius
    if there.length < longest:
        longest = there.length
    if longest > work.radius:
        work.radius = longest


def take_curvature(
    problem: Problem,
    work: Work,
) -> None:
    """The second-order term at the place of the iteration, and the place judged anew with it."""
    place = work.here
    work.curvature_known = set_curvature(problem, work)
    judge(problem, place, work.curvature_known, work)
    work.patience = PATIENCE if place.offset >= NEAR_OFFSET else 0
    work.stop = place.ending


def no_better(problem: Problem, work: Work) -> None:
    """No better point: the end, unless the second-order term was too inexact for the last digits."""
    if work.curvature_known == 0:
        work.stop = ROUNDING
        return
    place = work.here
    work.curvature_known = 0
    judge(problem, place, 0, work)
    if place.length > work.radius:
        work.radius = place.length
    work.patience = NEVER
    work.stop = place.ending


def stuck(
    problem: Problem,
    work: Work,
) -> None:
    """No trial was accepted: the end, unless Newton's step shows a way that Gauss-Newton's did not."""
    place = work.here
    if place.predicted <= UNDECIDED * place.cost_rounding:
        no_better(problem, work)
    elif work.finite == 0:
        work.stop = NO_FINITE_STEP
    elif work.patience > 0:
        settle_at_kink(problem, work)
    else:
        take_curvature(problem, work)
        work.patience = PATIENCE
        if place.length > work.radius:
            work.radius = place.length


def iterate(
    problem: Problem,
    work: Work,
) -> None:
    """Trial steps until one is accepted, or none can be; the cost never grows by more than its rounding.

    Where an equation has no finite value, the radius shrinks faster each time: there may be none all around.
    """
    here = work.here
    start = work.radius
    radius = start
    shrink = 0.25
    work.finite = 1
    work.iterations += 1
    for _ in range(TRIAL_POINTS):
        step_within(problem, radius, work)
        try_step(problem, work)
        if same_point(problem, work.tried, here.point) == 1:
            break
        shorter = work.step_length if work.step_length < radius else radius
        work.finite = 1 if isfinite(work.cost_tried) else 0
        if work.finite == 0:
            radius = shrink * shorter
            shrink = 0.5 * shrink
            continue
        actual = here.cost - work.cost_tried
        share = -1.0
        acceptable = 0
        decided = work.step_predicted > UNDECIDED * here.cost_rounding
        if decided:
            share = actual / work.step_predicted
            if share > LEAST_GAIN_RATIO:
                acceptable = 1
        elif work.undamped == 1 and actual >= -here.cost_rounding:
            acceptable = 1
        if acceptable == 1:
            if factor_there(problem, work) == 0:
                work.finite = 0
                radius = shrink * shorter
                shrink = 0.5 * shrink
                continue
            work.radius = radius
            arrive_there(problem, share, work)
            return
        if not decided:
            break
        radius = shortening(problem, here, work.step, actual, work) * shorter
    work.radius = radius
    stuck(problem, work)
