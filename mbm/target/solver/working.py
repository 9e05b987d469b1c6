"""Which constraints hold the estimates: what the signs of multipliers and values say at a place on their surface.

An active-set method's rules (Nocedal and Wright 2006, 16.5).
"""

from __future__ import annotations

from math import fabs

from mbm.target.decisions import EXACT
from mbm.target.solver.beginning import constraint_count
from mbm.target.solver.description import BOUNDS_AT, DataSet, Problem
from mbm.target.solver.workspace import Place, Work
from mbm.target.words import ConstantReals, Integer, Real


def set_working(system: Problem, data: DataSet, work: Work) -> None:
    """`held`: the units of the equations, and of the inequalities that have a multiplier."""
    multipliers = work.multipliers
    units = work.units
    held = work.held
    done = 0
    for b in range(system.residual_blocks, system.residual_blocks + system.constraint_blocks):
        block = system.blocks[b]
        lines = block.outputs
        count = lines * data.blocks[b].rows
        for k in range(count):
            c = done + k
            held[c] = units[c]
            if block.equality[k % lines] == 0 and not multipliers[c] > 0.0:
                held[c] = 0.0
        done += count


def largest_violation(system: Problem, data: DataSet, work: Work) -> Real:
    """Of the equations and of the inequalities that hold like them: in units, beyond rounding."""
    units = work.units
    values = work.values
    roundings = work.roundings
    held = work.held
    worst = 0.0
    done = 0
    for b in range(system.residual_blocks, system.residual_blocks + system.constraint_blocks):
        block = system.blocks[b]
        lines = block.outputs
        count = lines * data.blocks[b].rows
        for k in range(count):
            c = done + k
            missed = fabs(values[c]) - roundings[c]
            holds = block.equality[k % lines] != 0 or held[c] != 0.0
            if holds and missed > worst * units[c]:
                worst = missed / units[c]
        done += count
    return worst


def change_working(system: Problem, data: DataSet, nothing: Real, work: Work) -> Integer:
    """1 where another inequality holds from now on: the most overstepped one does; or else the one does not any more
    whose multiplier is the most negative, beyond ``nothing`` standard deviations. 0: all signs are right.
    """
    forces = work.forces
    units = work.units
    values = work.values
    roundings = work.roundings
    held = work.held
    overstepped = -1
    pulled = -1
    most = EXACT
    least = -nothing
    done = 0
    for b in range(system.residual_blocks, system.residual_blocks + system.constraint_blocks):
        block = system.blocks[b]
        lines = block.outputs
        count = lines * data.blocks[b].rows
        for k in range(count):
            c = done + k
            if block.equality[k % lines] == 0:
                if held[c] == 0.0 and values[c] - roundings[c] > most * units[c]:
                    most = (values[c] - roundings[c]) / units[c]
                    overstepped = c
                if held[c] != 0.0 and forces[c] * units[c] < least:
                    least = forces[c] * units[c]
                    pulled = c
                if forces[c] < 0.0:
                    forces[c] = 0.0
        done += count
    if overstepped >= 0:
        held[overstepped] = units[overstepped]
        return 1
    if pulled >= 0:
        held[pulled] = 0.0
        return 1
    return 0


def pushes_on_bounds(
    system: Problem,
    constants: ConstantReals,
    data: DataSet,
    nothing: Real,
    place: Place,
    work: Work,
) -> Integer:
    """1 where nothing pulls coordinates away from the bounds that hold them, beyond ``nothing`` standard deviations."""
    n = system.n
    forces = work.forces
    slopes = work.slopes
    triangle = place.triangle
    free = place.free
    norms = place.norms
    x = place.x
    for j in range(n):
        if free[j] == 0.0:
            slope = 0.0
            for i in range(j + 1):
                slope += triangle[i * (n + 1) + j] * triangle[i * (n + 1) + n]
            for c in range(constraint_count(system, data)):
                slope += forces[c] * slopes[c * n + j]
            low = x[j] <= constants[BOUNDS_AT + j] and slope >= -nothing * norms[j]
            high = x[j] >= constants[BOUNDS_AT + n + j] and slope <= nothing * norms[j]
            if not (low or high):
                return 0
    return 1
