"""How far quantities vary that are computed from the estimates, by linear propagation."""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.covariance import STILL, reflect_constraints, set_scales, to_null_space
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import dot, filled
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Work

OPEN = -2
"""The column of a coordinate that the data do not determine."""


def gather_gradient(
    n: Integer,
    which: Integer,
    count: Integer,
    rows: ConstantIntegers,
    tangents: ConstantIntegers,
    columns: ConstantIntegers,
    slopes: ConstantReals,
    gradient: Reals,
) -> Integer:
    """``gradient`` (n,) of quantity ``which``, from the derivatives (count,) that are not zero everywhere.

    ``rows`` are their quantities, ``tangents`` the coordinates, whose places in the gradient are ``columns``; -1: it
    stays. 0: the quantity depends on an `OPEN` one.
    """
    filled(n, 0.0, gradient)
    for k in range(count):
        if rows[k] == which and slopes[k] != 0.0:
            place = columns[tangents[k]]
            if place == OPEN:
                return 0
            if place >= 0:
                gradient[place] += slopes[k]
    return 1


def held_by_limits(
    problem: Problem,
    work: Work,
    gradient: ConstantReals,
    which: Integer,
    count: Integer,
    rows: ConstantIntegers,
    tangents: ConstantIntegers,
    columns: ConstantIntegers,
) -> Integer:
    """1 where quantity ``which`` changes only as estimates leave the limits that hold them, see `gather_gradient`.

    Also where it does not change at all and is calculated from such. After a solve. 0: it changes with other estimates,
    too, or equations alone keep it.
    """
    if dot(problem.n, gradient, gradient) == 0.0:
        return made_of_limits(problem, work, which, count, rows, tangents, columns)
    if share_beside(problem, work, 0, gradient) <= STILL:
        return 0
    return 1 if share_beside(problem, work, 1, gradient) <= STILL else 0


def share_beside(problem: Problem, work: Work, limits: Integer, gradient: ConstantReals) -> Real:
    """The share of the scaled length of a ``gradient`` (n,) that is along the surface of equations; 0: it is zero.

    ``limits`` 1: along that of the bounds and inequalities that hold, too.
    """
    n = problem.n
    answer = work.answer
    scale = work.scale
    line = work.line
    holding = holding_constraints(problem, work)
    for c in range(holding):
        work.forces[c] = work.held[c] if limits == 1 or work.equation[c] == 1 else 0.0
    for j in range(n):
        work.chosen[j] = j
    set_scales(problem, n, work.chosen, answer.triangle, holding, work.forces, work.slopes, scale)
    whole = 0.0
    count = 0
    for j in range(n):
        share = gradient[j] / scale[j]
        whole += share * share
        if limits == 0 or answer.sides[j] == 0:
            work.chosen[count] = j
            scale[count] = scale[j]
            line[count] = share
            count += 1
    found = reflect_constraints(n, count, work.chosen, scale, holding, work.forces, work.slopes, work.reflections)
    to_null_space(count, found, work.reflections, line)
    return sqrt(dot(count - found, line[found:], line[found:]) / whole) if whole > 0.0 else 0.0


def holding_constraints(problem: Problem, work: Work) -> Integer:
    """How many constraints may hold after a solve."""
    return constraint_count(problem, work.rows.data) if work.penalised == 1 else 0


def made_of_limits(
    problem: Problem,
    work: Work,
    which: Integer,
    count: Integer,
    rows: ConstantIntegers,
    tangents: ConstantIntegers,
    columns: ConstantIntegers,
) -> Integer:
    """1 where quantity ``which`` is calculated from an estimate that limits hold, alone or with others."""
    holding = holding_constraints(problem, work)
    for k in range(count):
        place = columns[tangents[k]]
        if rows[k] == which and place >= 0:
            if work.answer.sides[place] != 0:
                return 1
            for c in range(holding):
                slope = work.slopes[c * problem.n + place]
                if work.held[c] != 0.0 and work.equation[c] == 0 and slope != 0.0:
                    return 1
    return 0


def put_spread(
    n: Integer,
    count: Integer,
    factor: ConstantReals,
    touched: ConstantIntegers,
    gradients: Reals,
    covariance: Reals,
    deviations: Reals,
) -> None:
    """The covariance (count, count) of quantities with these ``gradients`` (count, n) by what has covariance ``UᵀU``.

    NaN, and -1 of the standard deviations, of what depends on coordinates that are ``touched``, or has no derivative.
    """
    lines = gradients[count * n :]
    for c in range(count):
        for i in range(n):
            lines[c * n + i] = dot(n, factor[i * n :], gradients[c * n :])
            if touched[i] == 1 and gradients[c * n + i] != 0.0:
                gradients[c * n] = inf - inf
    for c in range(count):
        for d in range(count):
            covariance[c * count + d] = dot(n, lines[c * n :], lines[d * n :])
        variance = covariance[c * count + c]
        deviations[c] = sqrt(variance) if variance < inf else -1.0
