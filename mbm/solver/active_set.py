"""Which constraints hold the estimates: what the signs of multipliers and values say at a place on their surface.

An active-set method's rules (Nocedal and Wright 2006, 16.5).
"""

from __future__ import annotations

from math import fabs

from mbm.machine.words import Integer, Real
from mbm.solver.beginning import constraint_count
from mbm.solver.decisions import EXACT
from mbm.solver.description import BOUNDS_AT, Problem
from mbm.solver.workspace import Linearisation, Work


def set_active(problem: Problem, work: Work) -> None:
    """`held`: the units of the equations, and of the inequalities that have a multiplier."""
    for c in range(constraint_count(problem, work.rows.data)):
        holds = work.equation[c] == 1 or work.multipliers[c] > 0.0
        work.held[c] = work.units[c] if holds else 0.0


def largest_violation(problem: Problem, work: Work) -> Real:
    """Of the equations and of the inequalities that hold like them: in units, beyond rounding."""
    worst = 0.0
    for c in range(constraint_count(problem, work.rows.data)):
        missed = fabs(work.values[c]) - work.roundings[c]
        holds = work.equation[c] == 1 or work.held[c] != 0.0
        if holds and missed > worst * work.units[c]:
            worst = missed / work.units[c]
    return worst


def change_active(problem: Problem, nothing: Real, work: Work) -> Integer:
    """1 where another inequality holds from now on: the most overstepped one does; or else the one does not any more
    whose multiplier is the most negative, beyond ``nothing`` standard deviations. 0: all signs are right.
    """
    forces = work.forces
    units = work.units
    held = work.held
    overstepped = -1
    pulled = -1
    most = EXACT
    least = -nothing
    for c in range(constraint_count(problem, work.rows.data)):
        if work.equation[c] == 0:
            if held[c] == 0.0 and work.values[c] - work.roundings[c] > most * units[c]:
                most = (work.values[c] - work.roundings[c]) / units[c]
                overstepped = c
            if held[c] != 0.0 and forces[c] * units[c] < least:
                least = forces[c] * units[c]
                pulled = c
            if forces[c] < 0.0:
                forces[c] = 0.0
    if overstepped >= 0:
        held[overstepped] = units[overstepped]
        return 1
    if pulled >= 0:
        held[pulled] = 0.0
        return 1
    return 0


def pushes_on_bounds(
    problem: Problem,
    nothing: Real,
    place: Linearisation,
    work: Work,
) -> Integer:
    """1 where nothing pulls coordinates away from the bounds that hold them, beyond ``nothing`` standard deviations."""
    n = problem.n
    for j in range(n):
        if place.free[j] == 0.0:
            slope = 0.0
            for i in range(j + 1):
                slope += place.triangle[i * (n + 1) + j] * place.triangle[i * (n + 1) + n]
            for c in range(constraint_count(problem, work.rows.data)):
                slope += work.forces[c] * work.slopes[c * n + j]
            low = place.x[j] <= work.rows.constants[BOUNDS_AT + j] and slope >= -nothing * place.norms[j]
            high = place.x[j] >= work.rows.constants[BOUNDS_AT + n + j] and slope <= nothing * place.norms[j]
            if not (low or high):
                return 0
    return 1
