"""What depends on noise that nothing tells, or that is estimated as nothing, in a generated solver: it has no sigma."""

from __future__ import annotations

from math import inf, sqrt

from mbm.emit.routines.agreement import covariance_anew
from mbm.emit.routines.noises import CHECKED, EXACT, TOLD, UNTOLD, rescale
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied, dot
from mbm.solver.noise_factors import OWN, SAME_COVARIANCES, TRIED, changed
from mbm.solver.workspace import Work

ASSUMPTIONS = 2
"""About noise: what was never checked is larger, what is estimated as nothing is."""


def quadratic_form(n: Integer, matrix: ConstantReals, vector: ConstantReals) -> Real:
    """``vᵀ M v``; rows of equations are 0 in most of their coordinates."""
    total = 0.0
    for j in range(n):
        if vector[j] != 0.0:
            total += vector[j] * dot(n, matrix[j * n :], vector)
    return total


def assumed(told: ConstantReals, unchecked: Integer) -> Integer:
    """Whether nothing tells the noise of a group, never checked or fitted exactly (``unchecked`` 1), or nothing (0)."""
    found = 0
    if told[EXACT] == 1.0:
        found = unchecked
    elif told[UNTOLD] == 1.0 and told[CHECKED] == 1.0 - float(unchecked):
        found = 1
    return found


def set_assumptions(problem: Problem, work: Work, told: ConstantReals, apart: Reals, covariances: Reals) -> None:
    """``covariances`` (1 + `ASSUMPTIONS`, n, n): that at the end of a solve, and those under each assumption.

    What differs by more than ``apart`` (`ASSUMPTIONS`,) is not known; 0: the assumption is not made.
    """
    n = problem.n
    rows = work.rows
    made = 0
    for which in range(ASSUMPTIONS):
        unchecked = 1 if which == 0 else 0
        apart[which] = 0.0
        for g in range(problem.noises):
            if assumed(told[g * TOLD :], unchecked) == 1:
                apart[which] = SAME_COVARIANCES if unchecked == 1 else OWN
                rescale(problem, rows, g, TRIED)
        if apart[which] != 0.0:
            made = 1
            covariance_anew(problem, work, covariances[(1 + which) * n * n :])
        for g in range(problem.noises):
            if assumed(told[g * TOLD :], unchecked) == 1:
                rescale(problem, rows, g, 1.0 / TRIED)
    if made == 1:
        covariance_anew(problem, work, work.answer.covariance)
        copied(n * n, work.answer.covariance, covariances)


def is_untold(n: Integer, apart: ConstantReals, covariances: ConstantReals, gradient: ConstantReals) -> Integer:
    """1 where a quantity with the ``gradient`` (n,) depends on noise that nothing tells, by `set_assumptions`."""
    found = 0
    for which in range(ASSUMPTIONS):
        if apart[which] != 0.0:
            given = quadratic_form(n, covariances, gradient)
            other = quadratic_form(n, covariances[(1 + which) * n * n :], gradient)
            if changed(given, other, apart[which], given) == 1:
                found = 1
    return found


def mask_untold(n: Integer, apart: ConstantReals, covariances: ConstantReals, covariance: Reals) -> None:
    """NaN for the elements of a covariance (n, n) that depend on noise that nothing tells."""
    for which in range(ASSUMPTIONS):
        other = covariances[(1 + which) * n * n :]
        for i in range(n if apart[which] != 0.0 else 0):
            for j in range(n):
                size = sqrt(covariances[i * n + i] * covariances[j * n + j])
                if changed(covariances[i * n + j], other[i * n + j], apart[which], size) == 1:
                    covariance[i * n + j] = inf - inf
