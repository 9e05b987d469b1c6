"""Constraints by multiplied penalties: the augmented Lagrange function as squares (Hestenes 1969, Powell 1969).

To the residuals come ``weight · (c/unit + shift)``, for inequalities only where positive, with ``shift`` the
multiplier in units of the penalty. Rounds of Marquardt's method, with growing weights and updated multipliers, until
the constraints hold to rounding; units and constants are those of `solution.constrained`.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.target.decisions import EXACT, FIRST_WEIGHT, HEAVIER, LOOSE, MET, PUSHED, SHRINKS
from mbm.target.solver.beginning import begin, constraint_count
from mbm.target.solver.constraint_values import linearise, set_units
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_EQUALITY_AT,
    BLOCK_OUTPUTS,
    BLOCKS,
    BLOCKS_AT,
    CONSTRAINTS,
    DATA_BLOCK,
    DATA_HEAD,
    DATA_ROWS,
    FLAT,
    INFEASIBLE,
    LANES,
    NOT_FINITE_AT_START,
    NUMBERS,
    TOLERANCE,
)
from mbm.target.solver.equations import groups_of, weights_width
from mbm.target.solver.linear_algebra import copied, filled
from mbm.target.solver.polishing import polish
from mbm.target.solver.united import rows_apart
from mbm.target.solver.workspace import (
    AT_POINT,
    EVALUATIONS_DONE,
    HELD,
    HERE,
    LAMBDA,
    PENALISED,
    ROUND,
    ROUNDINGS,
    STOP,
    TOLERANCE_NOW,
    UNITS,
    VALUES,
    WEIGHT,
    WORST,
    multipliers_at,
    place_at,
    scalars_at,
    weights_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

ROUNDS = 30
"""Rounds of the multiplied penalties."""

ENOUGH = 1e2
"""The weight grows up to this, …"""

MOST = 1e6
"""… and up to this where a round does not bring the violations to the share SHRINKS."""

TIGHTER = 0.03
"""Standard deviations to which each round after the first is solved."""


def set_penalties(system: ConstantIntegers, data: ConstantIntegers, work: Reals) -> None:
    """Factors and shifts of the penalties, where the kernels' weights stand."""
    weight = work[scalars_at(system) + WEIGHT]
    multipliers = work[multipliers_at(system, LAMBDA) :]
    units = work[multipliers_at(system, UNITS) :]
    whitening = weights_at(system)
    done = 0
    for b in range(system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        if b >= system[BLOCKS]:
            lines = block[BLOCK_OUTPUTS]
            own = work[whitening:]
            for row in range(groups_of(rows) * LANES):
                for i in range(lines):
                    at = ((row // LANES) * 2 * lines + 2 * i) * LANES + row % LANES
                    own[at] = 0.0
                    own[at + LANES] = 0.0
                    if row < rows:
                        c = done + row * lines + i
                        own[at] = weight / units[c]
                        own[at + LANES] = multipliers[c] * units[c] / weight
            done += rows * lines
        whitening += groups_of(rows) * weights_width(block) * LANES


def update_multipliers(system: ConstantIntegers, data: ConstantIntegers, work: Reals) -> Real:
    """The multipliers that the penalties amount to, and the largest violation in units beyond rounding."""
    weight = work[scalars_at(system) + WEIGHT]
    multipliers = work[multipliers_at(system, LAMBDA) :]
    units = work[multipliers_at(system, UNITS) :]
    values = work[multipliers_at(system, VALUES) :]
    roundings = work[multipliers_at(system, ROUNDINGS) :]
    worst = 0.0
    done = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        lines = block[BLOCK_OUTPUTS]
        count = lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        for k in range(count):
            c = done + k
            equal = system[block[BLOCK_EQUALITY_AT] + k % lines]
            updated = multipliers[c] + values[c] / units[c] * weight * weight / units[c]
            missed = fabs(values[c])
            if equal == 0:
                if updated < 0.0:
                    updated = 0.0
                # One that pushes must hold as an equation does; one that does not must not be overstepped.
                if updated == 0.0 and values[c] < 0.0:
                    missed = 0.0
            multipliers[c] = updated
            missed -= roundings[c]
            if missed > worst * units[c]:
                worst = missed / units[c]
        done += count
    return worst


def begin_rounds(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> None:
    """The first round, from the point that place 0 holds."""
    place = work[place_at(system, 0) :]
    scalars = work[scalars_at(system) :]
    flags[ROUND] = 0
    filled(constraint_count(system, data), 0.0, work[multipliers_at(system, LAMBDA) :])
    flags[PENALISED] = 0
    begin(system, constants, data, index, columns, work, flags)
    # Coordinates that the constraints alone determine leave the residuals deficient: that is no reason to end.
    if flags[STOP] == NOT_FINITE_AT_START:
        return
    linearise(system, data, index, columns, place[AT_POINT:], work)
    set_units(system, data, place, 1, work)
    flags[PENALISED] = 1
    scalars[WEIGHT] = FIRST_WEIGHT
    scalars[WORST] = 1e300
    scalars[TOLERANCE_NOW] = LOOSE if constants[TOLERANCE] < LOOSE else constants[TOLERANCE]
    set_penalties(system, data, work)
    begin(system, constants, data, index, columns, work, flags)


def next_round(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> Integer:
    """What follows on a round that has ended: 1 where another one has begun, 0 where it is the end."""
    if flags[STOP] > FLAT:
        return 0
    scalars = work[scalars_at(system) :]
    here = work[place_at(system, flags[HERE]) :]
    linearise(system, data, index, columns, here[AT_POINT:], work)
    flags[EVALUATIONS_DONE] += 1
    set_units(system, data, here, 0, work)
    worst = update_multipliers(system, data, work)
    flags[ROUND] += 1
    if polish(system, constants, data, index, columns, work, flags) == 1:
        return 0
    linearise(system, data, index, columns, here[AT_POINT:], work)
    set_units(system, data, here, 0, work)
    settled = scalars[TOLERANCE_NOW] <= constants[TOLERANCE] and flags[STOP] != FLAT
    stalled = not worst <= SHRINKS * scalars[WORST]
    over = settled and (worst <= EXACT or (stalled and worst <= MET and scalars[WEIGHT] >= ENOUGH))
    if over or flags[ROUND] >= ROUNDS:
        scalars[WORST] = worst
        if over:
            return 0
        flags[STOP] = FLAT if worst <= MET else INFEASIBLE
        return 0
    if scalars[WEIGHT] < ENOUGH or (stalled and scalars[WEIGHT] < MOST):
        scalars[WEIGHT] *= HEAVIER
    if worst < scalars[WORST]:
        scalars[WORST] = worst
    scalars[TOLERANCE_NOW] *= TIGHTER
    if scalars[TOLERANCE_NOW] < constants[TOLERANCE]:
        scalars[TOLERANCE_NOW] = constants[TOLERANCE]
    set_penalties(system, data, work)
    if flags[HERE] == 1:
        first = work[place_at(system, 0) + AT_POINT :]
        copied(system[NUMBERS], here[AT_POINT:], first)
    begin(system, constants, data, index, columns, work, flags)
    return 1


def set_held(system: ConstantIntegers, data: ConstantIntegers, cost: Real, work: Reals) -> None:
    """Mark the constraints that hold the estimates, by their units; the others have no multiplier."""
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
            pushed = multipliers[c] * units[c] > PUSHED * (1.0 + sqrt(cost))
            if system[block[BLOCK_EQUALITY_AT] + k % lines] == 0 and not pushed:
                held[c] = 0.0
                multipliers[c] = 0.0
        done += count
