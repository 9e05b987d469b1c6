"""Constraints by multiplied penalties: the augmented Lagrange function as squares (Hestenes 1969, Powell 1969).

To the residuals come ``weight · (c/unit + shift)``, for inequalities only where positive, with ``shift`` the
multiplier in units of the penalty. Rounds of Marquardt's method, with growing weights and updated multipliers, until
the constraints hold to rounding; units and constants are those of `solution.constrained`.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.target.solver.beginning import begin, constraint_count
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_EQUALITY_AT,
    BLOCK_JACOBIAN,
    BLOCK_NONZEROS,
    BLOCK_NONZEROS_AT,
    BLOCK_OUTPUTS,
    BLOCK_PARAMETERS,
    BLOCK_VARIABLES,
    BLOCKS,
    BLOCKS_AT,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_ROWS,
    FLAT,
    INFEASIBLE,
    LANES,
    NONZERO,
    NONZERO_OUTPUT,
    NONZERO_TANGENT,
    NOT_FINITE_AT_START,
    NUMBERS,
    PLACES_AT,
    TOLERANCE,
)
from mbm.target.solver.equations import gather, groups_of, portion, weights_width
from mbm.target.solver.linear_algebra import copied, filled
from mbm.target.solver.united import rows_apart
from mbm.target.solver.workspace import (
    AT_POINT,
    EVALUATIONS_DONE,
    HERE,
    NORMS,
    PENALISED,
    ROUND,
    STOP,
    TOLERANCE_NOW,
    WEIGHT,
    WORST,
    X,
    inputs_at,
    multipliers_at,
    outputs_at,
    place_at,
    scalars_at,
    slopes_at,
    vector_at,
    weights_at,
)
from mbm.target.words import (
    ConstantIntegers,
    ConstantReals,
    Integer,
    Integers,
    Real,
    Reals,
    call_kernel,
    distinct_arrays,
)

ROUNDS = 30
FIRST_WEIGHT = 3.0
"""A violation by one standard deviation costs half the square of this at first."""

HEAVIER = 10.0
ENOUGH = 1e2
"""The weight grows up to this, …"""

SHRINKS = 0.25
MOST = 1e6
"""… and up to this where a round does not bring the violations to a quarter."""

LOOSE = 1e-2
TIGHTER = 0.03
"""Standard deviations to which the first round is solved, and each after it."""

EXACT = 1e-12
"""A constraint holds where its violation is below this share of its unit, or rounding."""

HOLDS = 1e-8
"""… and where rounds get no better, below this: far below any standard deviation."""

SIGNIFICANCE = 1e-6
"""What the data would gain, in standard deviations, by which they push against a constraint; less is none."""

EPSILON = 2.220446049250313e-16
NOISE = 4.0

LAMBDA = 0
UNITS = 1
VALUES = 2
ROUNDINGS = 3
HELD = 4
"""Vectors (K,) of scratch: multipliers, units, values, their roundings, and units of those that hold (else 0)."""


@distinct_arrays
def add_slopes(
    system: ConstantIntegers,
    block: ConstantIntegers,
    columns: ConstantIntegers,
    first: Integer,
    rows: Integer,
    outputs: ConstantReals,
    values: Reals,
    slopes: Reals,
) -> None:
    """Values and derivatives of the constraints of one portion: row by row, output by output."""
    n = system[COORDINATES]
    lines = block[BLOCK_OUTPUTS]
    width = lines + block[BLOCK_NONZEROS]
    for row in range(rows):
        group = row // LANES
        lane = row % LANES
        for i in range(lines):
            values[row * lines + i] = outputs[(group * width + i) * LANES + lane]
        for k in range(block[BLOCK_NONZEROS]):
            nonzero = system[block[BLOCK_NONZEROS_AT] + k * NONZERO :]
            column = columns[(first + row) * block[BLOCK_COLUMNS] + nonzero[NONZERO_TANGENT]]
            if column >= 0:
                value = outputs[(group * width + lines + k) * LANES + lane]
                slopes[(row * lines + nonzero[NONZERO_OUTPUT]) * n + column] += value


def linearise(
    system: ConstantIntegers,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    work: Reals,
) -> None:
    """Values and slopes of all constraints at a point."""
    n = system[COORDINATES]
    values = work[multipliers_at(system, VALUES) :]
    slopes = work[slopes_at(system) :]
    outputs = work[outputs_at(system) :]
    filled(constraint_count(system, data) * n, 0.0, slopes)
    inputs = inputs_at(system)
    done = 0
    for b in range(system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        rows = rows_apart(system, data, b, work) if LANES > 1 else data[at + DATA_ROWS]
        width = (block[BLOCK_VARIABLES] + block[BLOCK_PARAMETERS]) * LANES
        if b >= system[BLOCKS]:
            gather(block, rows, index[data[at + DATA_INDEX] :], point, work[inputs:])
            first = 0
            while first < rows:
                count = portion(system, block) * LANES
                if first + count > rows:
                    count = rows - first
                call_kernel(block[BLOCK_JACOBIAN], work[inputs + first // LANES * width :], outputs, groups_of(count))
                own = columns[data[at + DATA_COLUMNS] :]
                add_slopes(system, block, own, first, count, outputs, values[done:], slopes[done * n :])
                done += count * block[BLOCK_OUTPUTS]
                first += count
        inputs += groups_of(rows) * width


def set_units(
    system: ConstantIntegers, data: ConstantIntegers, place: ConstantReals, first: Integer, work: Reals
) -> None:
    """Units and roundings of the constraints at a place; at ``first`` its norms alone are the measure."""
    n = system[COORDINATES]
    norms = place[vector_at(system, NORMS) :]
    x = place[vector_at(system, X) :]
    units = work[multipliers_at(system, UNITS) :]
    values = work[multipliers_at(system, VALUES) :]
    roundings = work[multipliers_at(system, ROUNDINGS) :]
    slopes = work[slopes_at(system) :]
    for c in range(constraint_count(system, data)):
        square = 0.0
        terms = fabs(values[c])
        longest = 0.0
        for j in range(n):
            slope = fabs(slopes[c * n + j])
            size = fabs(x[j]) if system[system[PLACES_AT] + j] >= 0 else 1.0
            terms += slope * size
            if slope > longest:
                longest = slope
            if norms[j] > 0.0:
                square += slope / norms[j] * (slope / norms[j])
        if first == 1:
            units[c] = sqrt(square) if square > 0.0 else longest
            if not units[c] > 0.0:
                units[c] = 1.0
        roundings[c] = NOISE * EPSILON * terms


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
    settled = scalars[TOLERANCE_NOW] <= constants[TOLERANCE] and flags[STOP] != FLAT
    stalled = not worst <= SHRINKS * scalars[WORST]
    over = settled and (worst <= EXACT or (stalled and worst <= HOLDS and scalars[WEIGHT] >= ENOUGH))
    if over or flags[ROUND] >= ROUNDS:
        scalars[WORST] = worst
        if over:
            return 0
        flags[STOP] = FLAT if worst <= HOLDS else INFEASIBLE
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


def set_held(system: ConstantIntegers, data: ConstantIntegers, cost: Real, work: Reals) -> Integer:
    """Mark the constraints that hold the estimates, by their units; how many they are."""
    multipliers = work[multipliers_at(system, LAMBDA) :]
    units = work[multipliers_at(system, UNITS) :]
    held = work[multipliers_at(system, HELD) :]
    found = 0
    done = 0
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        block = system[system[BLOCKS_AT] + b * BLOCK :]
        lines = block[BLOCK_OUTPUTS]
        count = lines * data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]
        for k in range(count):
            c = done + k
            held[c] = units[c]
            pushed = multipliers[c] * units[c] > SIGNIFICANCE * (1.0 + sqrt(cost))
            if system[block[BLOCK_EQUALITY_AT] + k % lines] == 0 and not pushed:
                held[c] = 0.0
                multipliers[c] = 0.0
            if held[c] != 0.0:
                found += 1
        done += count
    return found


ROUTINES = (
    add_slopes,
    linearise,
    set_units,
    set_penalties,
    update_multipliers,
    begin_rounds,
    next_round,
    set_held,
)
