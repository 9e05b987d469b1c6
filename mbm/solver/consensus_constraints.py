"""Equations among the constraints, which consensus keeps to: each tells one coordinate, which follows the others.

Inequalities and bounds that hold a fit are kept to as well, once they are known: a coordinate at its bound is told.

At a point the slopes of the equations are brought to reduced form: c tells coordinate j by ``d_j = -c - Σ s_k d_k``,
over the coordinates that none tells. Rows then depend on those alone, so that subsets are as many units smaller, fits
keep to the equations, and noise has the degrees of freedom that they leave. Which coordinates are told may change from
point to point: those that the equations depend on most.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Reals
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.constraint_values import evaluate, tell_equations
from mbm.solver.decisions import CONSTRAINT_SHARE, ROUNDING_OF_BOUNDS
from mbm.solver.description import BOUNDS_AT, Problem
from mbm.solver.linear_algebra import add_multiple, copied, dot, filled, multiplied
from mbm.solver.manifolds import retract
from mbm.solver.trust_region import constraint_count

NOT_TOLD = -1
AT_BOUND = -2
NO_VALUE = -1

PUT_ROUNDS = 30
"""Newton steps to the constraints; one does where they are linear."""

PUT = 1e-9
"""The last step, as a share of the numbers that it changes, of those that led to the constraints."""


def normed_equations(problem: Problem, point: ConstantReals, work: ConsensusWork) -> Integer:
    """Values and slopes of the constraints at a point in the work, those of equations over the norm of their slopes.

    0 where one of these has no value there.
    """
    n = problem.n
    count = constraint_count(problem, work.rows.data)
    filled(count * n, 0.0, work.slopes)
    evaluate(problem, point, 1, work.rows, work.values, work.slopes)
    finite = 1
    for c in range(count):
        for j in range(n):
            if work.bounded[j] == 1:
                work.slopes[c * n + j] = 0.0
        work.teller[c] = 1 - work.equation[c]
        if work.equation[c] == 1:
            row = work.slopes[c * n :]
            length = sqrt(dot(n, row, row))
            if not isfinite(length + work.values[c]):
                finite = 0
            elif length > 0.0:
                multiplied(n, 1.0 / length, row)
                work.values[c] = work.values[c] / length
    return finite


def reduced_equations(problem: Problem, point: ConstantReals, work: ConsensusWork) -> Integer:
    """The equations at a point in reduced form in the work, and how many coordinates they tell; `NO_VALUE`: no form."""
    n = problem.n
    count = constraint_count(problem, work.rows.data)
    values = work.values
    slopes = work.slopes
    found = 0
    for j in range(n):
        work.told_by[j] = NOT_TOLD
        if work.bounded[j] == 1:
            work.told_by[j] = AT_BOUND
            found += 1
    if normed_equations(problem, point, work) == 0:
        return NO_VALUE
    for _ in range(n):
        largest = CONSTRAINT_SHARE
        first = NOT_TOLD
        column = 0
        for c in range(count):
            if work.teller[c] == 0:
                for j in range(n):
                    if fabs(slopes[c * n + j]) > largest:
                        largest = fabs(slopes[c * n + j])
                        first = c
                        column = j
        if first == NOT_TOLD:
            break
        own = slopes[first * n :]
        pivot = own[column]
        multiplied(n, 1.0 / pivot, own)
        values[first] = values[first] / pivot
        for c in range(count):
            if c != first and work.equation[c] == 1:
                factor = slopes[c * n + column]
                add_multiple(n, -factor, own, slopes[c * n :])
                slopes[c * n + column] = 0.0
                values[c] -= factor * values[first]
        work.teller[first] = 1
        work.told_by[column] = first
        found += 1
    return found


def put_on_constraints(problem: Problem, point: Reals, work: ConsensusWork) -> None:
    """The point (N,) with the coordinates that the equations tell; nothing finite where they tell none nearby."""
    if work.told == 0:
        return
    last = inf
    for _ in range(PUT_ROUNDS):
        size = 0.0
        filled(problem.n, 0.0, work.told_step)
        if reduced_equations(problem, point, work) == NO_VALUE:
            last = inf
            break
        for j in range(problem.n):
            if work.told_by[j] >= 0:
                change = -work.values[work.told_by[j]]
                place = problem.number_of[j]
                work.told_step[j] = change
                size = max(size, fabs(change) / (max(fabs(point[place]), PUT) if place >= 0 else 1.0))
        retract(problem, point, work.told_step, work.put_point)
        copied(problem.numbers, work.put_point, point)
        shorter = size < 0.5 * last
        last = min(size, last)
        if not shorter or size <= ROUNDING_OF_BOUNDS:
            break
    if not last <= PUT:
        filled(problem.numbers, inf, point)


def follow_constraints(
    problem: Problem, count: Integer, point: ConstantReals, work: ConsensusWork, chunk: Reals
) -> None:
    """Derivatives by the coordinates that are not told, others being put in; those by the others become zero."""
    if work.told == 0:
        return
    n = problem.n
    stride = problem.chunk
    reduced_equations(problem, point, work)
    for j in range(n):
        if work.told_by[j] >= 0:
            row = work.slopes[work.told_by[j] * n :]
            for k in range(n):
                if k != j and row[k] != 0.0:
                    add_multiple(count, -row[k], chunk[j * stride :], chunk[k * stride :])
        if work.told_by[j] != NOT_TOLD:
            filled(count, 0.0, chunk[j * stride :])


def tell_step(problem: Problem, point: ConstantReals, step: Reals, work: ConsensusWork) -> None:
    """The coordinates of a step (n,) from a point of the constraints that follow the others."""
    if work.told == 0:
        return
    n = problem.n
    reduced_equations(problem, point, work)
    for j in range(n):
        if work.told_by[j] != NOT_TOLD:
            step[j] = 0.0
    for j in range(n):
        if work.told_by[j] >= 0:
            step[j] = -dot(n, work.slopes[work.told_by[j] * n :], step)


def moved(problem: Problem, point: ConstantReals, step: Reals, work: ConsensusWork, target: Reals) -> None:
    """The point after a step (n,), put back inside the bounds and on the constraints."""
    tell_step(problem, point, step, work)
    retract(problem, point, step, target)
    n = problem.n
    constants = work.rows.constants
    for j in range(n):
        place = problem.number_of[j]
        if place >= 0:
            if target[place] < constants[BOUNDS_AT + j]:
                target[place] = constants[BOUNDS_AT + j]
            if target[place] > constants[BOUNDS_AT + n + j]:
                target[place] = constants[BOUNDS_AT + n + j]
    put_on_constraints(problem, target, work)


def begin_on_constraints(problem: Problem, work: ConsensusWork) -> None:
    """The starts in the work put on the constraints, and how many coordinates these tell.

    None if that were all, but no step leads from the first start to where they hold.
    """
    work.told = 0
    if work.held == 0:
        for j in range(problem.n):
            work.bounded[j] = 0
        tell_equations(problem, work.rows, work.equation)
    if problem.constraint_blocks > 0 or work.held == 1:
        work.told = reduced_equations(problem, work.begun, work)
        if work.told == NO_VALUE:
            work.told = 0
        copied(problem.numbers, work.begun, work.kept)
        for k in range(work.rules.starts):
            put_on_constraints(problem, work.begun[k * problem.numbers :], work)
        if work.told == problem.n and not isfinite(work.begun[0]):
            copied(problem.numbers, work.kept, work.begun)
            work.told = 0
    work.left = problem.n - work.told
