"""Which constraints hold the estimates: what the signs of multipliers and values say at a place on their surface.

An active-set method's rules (Nocedal and Wright 2006, 16.5).
"""

from __future__ import annotations

from math import fabs

from mbm.target.decisions import EXACT
from mbm.target.solver.beginning import constraint_count
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_EQUALITY_AT,
    BLOCK_OUTPUTS,
    BLOCKS,
    BLOCKS_AT,
    BOUNDS_AT,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_ROWS,
)
from mbm.target.solver.workspace import (
    FORCES,
    FREE,
    HELD,
    LAMBDA,
    NORMS,
    ROUNDINGS,
    UNITS,
    VALUES,
    X,
    multipliers_at,
    slopes_at,
    triangle_at,
    vector_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals


def set_working(system: ConstantIntegers, data: ConstantIntegers, work: Reals) -> None:
    """`HELD`: the units of the equations, and of the inequalities that have a multiplier."""
    multipliers = work[multipliers_at(system, LAMBDA) :]
    units = work[multipliers_at(system, UNITS) :]
    held = work[multipliers_at(system, HELD) :]
    done = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        lines = block[BLOCK_OUTPUTS]
        count = lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        for k in range(count):
            c = done + k
            held[c] = units[c]
            if system[block[BLOCK_EQUALITY_AT] + k % lines] == 0 and not multipliers[c] > 0.0:
                held[c] = 0.0
        done += count


def largest_violation(system: ConstantIntegers, data: ConstantIntegers, work: Reals) -> Real:
    """Of the equations and of the inequalities that hold like them: in units, beyond rounding."""
    units = work[multipliers_at(system, UNITS) :]
    values = work[multipliers_at(system, VALUES) :]
    roundings = work[multipliers_at(system, ROUNDINGS) :]
    held = work[multipliers_at(system, HELD) :]
    worst = 0.0
    done = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        lines = block[BLOCK_OUTPUTS]
        count = lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        for k in range(count):
            c = done + k
            missed = fabs(values[c]) - roundings[c]
            holds = system[block[BLOCK_EQUALITY_AT] + k % lines] != 0 or held[c] != 0.0
            if holds and missed > worst * units[c]:
                worst = missed / units[c]
        done += count
    return worst


def change_working(system: ConstantIntegers, data: ConstantIntegers, nothing: Real, work: Reals) -> Integer:
    """1 where another inequality holds from now on: the most overstepped one does; or else the one does not any more
    whose multiplier is the most negative, beyond ``nothing`` standard deviations. 0: all signs are right.
    """
    forces = work[multipliers_at(system, FORCES) :]
    units = work[multipliers_at(system, UNITS) :]
    values = work[multipliers_at(system, VALUES) :]
    roundings = work[multipliers_at(system, ROUNDINGS) :]
    held = work[multipliers_at(system, HELD) :]
    overstepped = -1
    pulled = -1
    most = EXACT
    least = -nothing
    done = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        lines = block[BLOCK_OUTPUTS]
        count = lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        for k in range(count):
            c = done + k
            if system[block[BLOCK_EQUALITY_AT] + k % lines] == 0:
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
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    nothing: Real,
    place: ConstantReals,
    work: Reals,
) -> Integer:
    """1 where nothing pulls coordinates away from the bounds that hold them, beyond ``nothing`` standard deviations."""
    n = system[COORDINATES]
    forces = work[multipliers_at(system, FORCES) :]
    slopes = work[slopes_at(system) :]
    triangle = place[triangle_at(system) :]
    free = place[vector_at(system, FREE) :]
    norms = place[vector_at(system, NORMS) :]
    x = place[vector_at(system, X) :]
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
