"""The start of an iteration, and the one step of affine equations."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import Integer
from mbm.solver.decisions import MOST_DENSE, NEVER, REFINEMENTS, UNSCALED
from mbm.solver.description import NO_FINITE_STEP, NOT_FINITE_AT_START, ONE_STEP, RUNNING, UNSURE, DataSet, Problem
from mbm.solver.equations import residuals_at_point
from mbm.solver.linear_algebra import dot, filled
from mbm.solver.linearisation import arrive
from mbm.solver.manifolds import coordinates_of, place_coordinates, retract
from mbm.solver.steps import project
from mbm.solver.sweeps import set_triangle, summed, sweep
from mbm.solver.trust_region import factor_there
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
    count = residuals_at_point(problem, work.rows, point, 1, work.penalised, residuals)
    place.cost = dot(count, residuals, residuals)
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
        work.tried = work.trial
        work.residuals_tried = (work.residuals_here + 1) % 3
        residuals = work.rows.residuals[work.residuals_tried * problem.most_residuals :]
        count = residuals_at_point(problem, work.rows, point, 1, 0, residuals)
        work.evaluations += 1
        cost = dot(count, residuals, residuals)
        work.cost_tried = cost
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
