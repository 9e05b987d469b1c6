"""Solves from beginning to end, one after the other: what is called from outside."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer, Integers, Real
from mbm.solver.constraint_values import tell_equations
from mbm.solver.constraints import begin_rounds, next_round, set_held
from mbm.solver.covariance import set_covariance, undetermined
from mbm.solver.decisions import IDLE, PUSHED, ROUNDED_PUSH, takes_over, usual_cost, worth_following
from mbm.solver.description import (
    BOUNDS_AT,
    COMPARED,
    CONDITION,
    COST,
    DATA_BLOCK,
    DATA_HEAD,
    DEFICIENT,
    EVALUATIONS,
    FREEDOM,
    INFEASIBLE,
    MAX_ITERATIONS,
    NO_LOSS,
    NOT_FINITE_AT_START,
    OFFSET,
    ONE_STEP,
    PLAIN_COST,
    REASON,
    RESULTS,
    ROUNDS,
    RUNNING,
    SMALL_OFFSET,
    STATES,
    STEPS,
    TOLERANCE,
    UNSURE,
    VIOLATION,
    DataSet,
    Problem,
)
from mbm.solver.equations import cost_at_point, load_rows
from mbm.solver.linear_algebra import add_multiple, column_product, copied, filled, gradient_of
from mbm.solver.manifolds import coordinates_of
from mbm.solver.range_form import best_of_ranges
from mbm.solver.sequential import begin_steps, sequential_step
from mbm.solver.stationary import forget_stationary
from mbm.solver.sweeps import sweep
from mbm.solver.trust_region import begin, constraint_count, iterate, solve_directly
from mbm.solver.workspace import Linearisation, RangeForm, Solves, Work, share_out


def release_inactive(
    n: Integer, triangle: ConstantReals, x: ConstantReals, cost: Real, pulls: ConstantReals, sides: Integers
) -> None:
    """``sides`` (n,) become 0 where the slope ``Jᵀ r`` is nothing beside the length of its column and ``cost`` = rᵀ r.

    ``triangle`` (n + 1, n + 1) of ``[J r]``; ``x`` (n,) are the coordinates, ``pulls`` (n,) what constraints add to
    the slope.
    """
    width = n + 1
    bounded = 0
    for j in range(n):
        if sides[j] != 0:
            bounded += 1
    if bounded == 0:
        return
    made_of = 0.0
    for j in range(n):
        made_of += column_product(j + 1, width, triangle[j:], triangle[j:]) * x[j] * x[j]
    for j in range(n):
        if sides[j] != 0:
            length = column_product(j + 1, width, triangle[j:], triangle[j:])
            slope = pulls[j] + gradient_of(n, j, triangle)
            if fabs(slope) <= sqrt(length) * (IDLE * sqrt(cost) + ROUNDED_PUSH * sqrt(made_of)):
                sides[j] = 0


SURE = 1e4
"""A squared condition up to which sums of products give variances to 1e-10: with errors of a few eps √rows."""


def start_solve(
    problem: Problem,
    data: DataSet,
    loaded: Integer,
    start: ConstantReals,
    work: Work,
) -> None:
    """Everything at the start of a solve; ``loaded`` 1: the rows of the data set are in ``work`` already."""
    if work.shared == 0:
        share_out(problem, work)
    work.rows.data = data
    if loaded == 0:
        load_rows(problem, work.rows)
    work.here = work.first
    work.other = work.second
    copied(problem.numbers, start, work.here.point)
    work.iterations = 0
    work.evaluations = 0
    work.round = 0
    work.penalised = 0
    work.tolerance = work.rows.constants[TOLERANCE]
    work.sequential = 0
    tell_equations(problem, work.rows, work.equation)
    if problem.constraint_blocks > 0 and problem.exact == 1:
        begin_steps(problem, work)
    elif problem.constraint_blocks > 0:
        begin_rounds(problem, work)
    else:
        begin(problem, work)
        if problem.direct == 1 and work.stop != NOT_FINITE_AT_START and work.stop != UNSURE:
            solve_directly(problem, work)


def go_on(
    problem: Problem,
    most: Integer,
    work: Work,
) -> Integer:
    """Up to ``most`` further iterations; 1 where the solve is at its end, 0 where there is more to do."""
    last = work.iterations + most
    going = 1
    while going == 1:
        while work.stop == RUNNING and work.iterations < problem.iterations:
            if work.iterations >= last:
                return 0
            if work.sequential == 1:
                sequential_step(problem, work)
            else:
                iterate(problem, work)
        if work.stop == RUNNING:
            work.stop = MAX_ITERATIONS
        going = 0
        if problem.constraint_blocks > 0 and work.penalised == 1 and work.sequential == 0:
            going = next_round(problem, work)
    return 1


def set_sides(problem: Problem, constants: ConstantReals, place: Linearisation, sides: Integers) -> None:
    """-1 and +1 for coordinates held at their lower and upper bound, else 0.

    A `positive` coordinate whose undamped step still goes all the way to zero is at its lower bound.
    """
    n = problem.n
    for j in range(n):
        sides[j] = 0
        if place.free[j] == 0.0 and place.x[j] >= constants[BOUNDS_AT + n + j]:
            sides[j] = 1
        if place.free[j] == 0.0 and place.x[j] <= constants[BOUNDS_AT + j]:
            sides[j] = -1
        if problem.positive[j] != 0 and place.stopped[j] != 0.0 and place.full[j] < 0.0:
            sides[j] = -1


def lossy(problem: Problem) -> Integer:
    """1 where some unit has a loss."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            if block.units[u].loss != NO_LOSS:
                return 1
    return 0


def set_end(problem: Problem, work: Work) -> None:
    """Where a solve has ended and why, without what is known about the answer there."""
    answer = work.answer
    results = answer.results
    states = answer.states
    here = work.here
    copied(problem.numbers, here.point, answer.numbers)
    states[REASON] = work.stop
    states[STEPS] = work.iterations
    states[EVALUATIONS] = work.evaluations
    states[ROUNDS] = work.round
    states[DEFICIENT] = 1 if here.deficient > 0 else 0
    results[OFFSET] = here.offset
    results[COST] = here.cost
    results[VIOLATION] = 0.0
    filled(problem.most_multipliers, 0.0, answer.multipliers)
    n = problem.n
    copied((n + 1) * (n + 1), here.triangle, answer.triangle)
    if work.stop == NOT_FINITE_AT_START:
        for j in range(n):
            answer.sides[j] = 0
        return
    set_sides(problem, work.rows.constants, here, answer.sides)
    pulls = work.gradient
    filled(n, 0.0, pulls)
    if work.penalised == 1:
        residuals = work.rows.residuals
        results[COST] = cost_at_point(problem, work.rows, here.point, 1, 0, residuals)
        results[VIOLATION] = work.worst
        set_held(problem, results[COST], work)
        copied(constraint_count(problem, work.rows.data), work.multipliers, answer.multipliers)
        for c in range(constraint_count(problem, work.rows.data)):
            add_multiple(n, work.multipliers[c], work.slopes[c * n :], pulls)
    if work.penalised == 1 or (LANES > 1 and here.squared_condition > SURE):
        sweep(problem, here.point, 0, 0, work.rows, work.rows.constants, answer.triangle)
    release_inactive(n, answer.triangle, here.x, results[COST], pulls, answer.sides)


def finish_solve(problem: Problem, work: Work) -> None:
    """The answer of a solve that has ended."""
    answer = work.answer
    results = answer.results
    states = answer.states
    sides = answer.sides
    triangle = answer.triangle
    covariance = answer.covariance
    n = problem.n
    here = work.here
    set_end(problem, work)
    residuals = work.rows.residuals
    point = here.point
    count = constraint_count(problem, work.rows.data)
    if work.stop == NOT_FINITE_AT_START:
        states[FREEDOM] = 0
        states[DEFICIENT] = 1
        results[PLAIN_COST] = here.cost
        results[CONDITION] = undetermined(n, sides, covariance)
        filled(n, 1.0, work.touched)
        work.rank = 0
        work.loose = 0
        return
    results[PLAIN_COST] = results[COST]
    if lossy(problem) == 1:
        results[PLAIN_COST] = cost_at_point(problem, work.rows, point, 0, 0, residuals)
    count = count if work.penalised == 1 else 0
    forget_stationary(problem, sides, work)
    results[CONDITION] = set_covariance(problem, triangle, sides, count, work.held, work, covariance)
    states[FREEDOM] = work.rows.data.count - work.rank
    if work.stop == INFEASIBLE:
        results[CONDITION] = undetermined(n, sides, covariance)
    if work.penalised == 1 and states[FREEDOM] <= 0 and results[COST] > PUSHED * PUSHED:
        # Residuals are perpendicular to all columns at a minimum: what remains of so few leaves a column too many.
        results[CONDITION] = undetermined(n, sides, covariance)
    states[DEFICIENT] = 0 if results[CONDITION] < 1e300 else 1


def ended_well(stop: Integer) -> Integer:
    """1 where an iteration has ended in a minimum."""
    return 1 if stop >= SMALL_OFFSET and stop <= ONE_STEP else 0


def solve_alone(problem: Problem, data: DataSet, start: ConstantReals, work: Work) -> None:
    """A solve from its start to its answer."""
    start_solve(problem, data, 0, start, work)
    go_on(problem, problem.iterations + 1, work)
    finish_solve(problem, work)


def solve_from(
    problem: Problem, data: DataSet, loaded: Integer, start: ConstantReals, form: RangeForm, work: Work
) -> None:
    """A solve from its start to its answer; where ranges lead to a better minimum, to that.

    ``loaded`` as in `start_solve`. The iterations of both count.
    """
    start_solve(problem, data, loaded, start, work)
    go_on(problem, problem.iterations + 1, work)
    if form.ranges.d > 0:
        settle_lower(problem, start, form, work)
    finish_solve(problem, work)
    work.answer.states[COMPARED] = 1 if form.ranges.d > 0 else 0


def squared_step_to(problem: Problem, place: Linearisation, point: ConstantReals, work: Work) -> Real:
    """``‖J (x − x_here)‖²`` of a point x that differs from a place in numbers that vary by addition."""
    n = problem.n
    total = 0.0
    coordinates_of(problem, point, work.shift)
    for i in range(n):
        along = 0.0
        for j in range(i, n):
            along += place.triangle[i * (n + 1) + j] * (work.shift[j] - place.x[j])
        total += along * along
    return total


def place_promises(problem: Problem, start: ConstantReals, form: RangeForm, work: Work) -> Integer:
    """1 where the best place of the ranges, then the `point`, is worth following from the end at hand, 0 where it is
    not, -1 where there is none.
    """
    least = best_of_ranges(problem, start, form, work)
    if not isfinite(least):
        return -1
    here = work.here
    if ended_well(work.stop) == 0:
        return 1
    most = inf
    if form.stated == 1:
        most = usual_cost(float(work.rows.data.count - problem.n))
    away = squared_step_to(problem, here, form.point, work)
    return worth_following(here.cost, least, away, most, here.rounding)


def settle_lower(problem: Problem, start: ConstantReals, form: RangeForm, work: Work) -> None:
    """Let the work be where the best place of the ranges leads, if that is a better minimum than the one at hand."""
    if place_promises(problem, start, form, work) <= 0:
        return
    data = work.rows.data
    here = work.here
    cost = here.cost
    rounding = here.rounding
    stop = work.stop
    well = ended_well(stop)
    iterations = work.iterations
    evaluations = work.evaluations
    copied(problem.numbers, here.point, form.other)
    start_solve(problem, data, 1, form.point, work)
    go_on(problem, problem.iterations + 1, work)
    iterations += work.iterations
    evaluations += work.evaluations
    lower = takes_over(cost, work.here.cost, rounding)
    if lower == 0 and (well == 1 or not work.here.cost <= cost):
        start_solve(problem, data, 1, form.other, work)
        work.stop = stop
    work.iterations = iterations
    work.evaluations = evaluations


def solve_many(solves: Solves) -> None:
    """Solves of a batch, each from beginning to end, with the scratch of one thread."""
    problem = solves.problem
    work = solves.work
    every = solves.answers
    answer = work.answer
    n = problem.n
    stride = DATA_HEAD + DATA_BLOCK * (problem.residual_blocks + problem.constraint_blocks)
    work.loaded = -1
    for k in range(solves.first, solves.last):
        own = view(DataSet, solves.data[solves.which[k] * stride :])
        loaded = 1 if work.loaded == solves.which[k] else 0
        answer.numbers = every.numbers[k * problem.numbers :]
        answer.results = every.results[k * RESULTS :]
        answer.states = every.states[k * STATES :]
        answer.sides = every.sides[k * n :]
        answer.triangle = every.triangle[k * (n + 1) * (n + 1) :]
        answer.covariance = every.covariance[k * n * n :]
        answer.multipliers = every.multipliers[k * problem.most_multipliers :]
        solve_from(problem, own, loaded, solves.starts[k * problem.numbers :], solves.form, work)
        work.loaded = solves.which[k]
