"""Unknowns that no residual feels to first order: a derivative that is rounding, or vanishes beside the curvature.

The cosine of an angle at half a turn has the derivative 1e-16 in floating point, and ``1/J`` is no standard deviation.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import ConstantIntegers, Integer, Real
from mbm.solver.decisions import ABSURD, BEND_STEP, LEAST_SIZE, MOST_GROUPS, vanishing
from mbm.solver.description import COST, Problem
from mbm.solver.linear_algebra import column_product, filled
from mbm.solver.manifolds import coordinates_of, retract
from mbm.solver.sweeps import COLUMN, sweep
from mbm.solver.workspace import Work


def forget_stationary(problem: Problem, sides: ConstantIntegers, work: Work) -> None:
    """Columns of the triangle of an answer that are zero to first order become zero.

    Looks closer, with one more Jacobian for each, or for a group of them where they are many, only at columns whose
    standard deviation would be absurd, of coordinates that no bound holds (``sides`` 0).
    """
    n = problem.n
    answer = work.answer
    spread = 1.0
    if problem.scaled == 1:
        spread = sqrt(answer.results[COST] / float(work.rows.data.count))
    coordinates_of(problem, answer.numbers, work.x)
    suspects = 0
    for j in range(n):
        length = sqrt(column_product(j + 1, n + 1, answer.triangle[j:], answer.triangle[j:]))
        if sides[j] == 0 and length > 0.0 and length * ABSURD * size_of(work.x[j]) < spread:
            work.chosen[suspects] = j
            suspects += 1
    if problem.linear == 1:
        suspects = 0
    for first in range(MOST_GROUPS if suspects > MOST_GROUPS else suspects):
        forget_group(problem, first, suspects, spread, work)


def size_of(coordinate: Real) -> Real:
    """That of a coordinate, 1 for one that is zero."""
    return fabs(coordinate) if coordinate != 0.0 else 1.0


def forget_group(problem: Problem, first: Integer, suspects: Integer, spread: Real, work: Work) -> None:
    """Every so many of the suspects, from the first: zero are those that vanish beside what small steps of all make."""
    n = problem.n
    rows = work.rows
    here = rows.residuals
    there = rows.residuals[problem.most_residuals :]
    point = work.answer.numbers
    triangle = work.answer.triangle
    filled(n, 0.0, work.step)
    for k in range(suspects):
        if k % MOST_GROUPS == first:
            work.step[work.chosen[k]] = BEND_STEP * max(size_of(work.x[work.chosen[k]]), LEAST_SIZE)
    retract(problem, point, work.step, work.trial)
    filled(2 * problem.most_residuals, 0.0, here)
    for k in range(suspects):
        j = work.chosen[k]
        if k % MOST_GROUPS == first:
            sweep(problem, point, COLUMN + j, 0, rows, rows.constants, here)
            sweep(problem, work.trial, COLUMN + j, 0, rows, rows.constants, there)
            length = 0.0
            bend = 0.0
            for i in range(problem.most_residuals):
                length += here[i] * here[i]
                bend += (there[i] - here[i]) * (there[i] - here[i])
            if vanishing(sqrt(length), size_of(work.x[j]), sqrt(bend) / work.step[j], spread):
                for i in range(j + 1):
                    triangle[i * (n + 1) + j] = 0.0
