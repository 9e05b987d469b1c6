"""Consensus before a solve: the units that agree (`mbm.target.solver.consensus`), and what follows for the equations.

As `mbm.solution.robust.consensus`: `:robust` leaves out what does not agree, and what agrees informs by the share κ of
its variance that the limits leave; losses keep all units, but begin where consensus is, and noise that goes with a loss
is as large as the units that agree say. ``kappa`` has one number for each unit of each block of residuals.
"""

from __future__ import annotations

from math import sqrt

from mbm.target.chi_square import consistency
from mbm.target.decisions import STATED
from mbm.target.solver.beginning import constraint_count
from mbm.target.solver.consensus import agree
from mbm.target.solver.consensus_description import (
    AGREED,
    BLOCKS_AT,
    COMPONENTS,
    GROUP_OF,
    INSIDE,
    LIMITS,
    NOISE,
    RULED,
    RULED_GROUP,
    RULED_TYPE,
    STARTLESS,
    UNIT_ROUNDINGS,
    place_vector_at,
    point_at,
    unit_vector_at,
)
from mbm.target.solver.covariance import set_covariance
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_NOISE,
    BLOCK_UNITS,
    BLOCK_UNITS_AT,
    BLOCK_WEIGHTS,
    BLOCKS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COUNT,
    DATA_HEAD,
    DATA_ROWS,
    DATA_WEIGHTS,
    NO_LOSS,
    NUMBERS,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
    UNIT_LOSS,
    UNIT_MATRIX,
    UNIT_WEIGHTS,
)
from mbm.target.solver.description import BLOCKS_AT as SYSTEM_BLOCKS_AT
from mbm.target.solver.equations import load_rows
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.workspace import HELD, PENALISED, multipliers_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def weigh_unit(
    system: ConstantIntegers,
    data: ConstantIntegers,
    b: Integer,
    row: Integer,
    unit: ConstantIntegers,
    factor: Real,
    weights: Reals,
) -> None:
    """The weights of a unit times a factor; 0: it takes no part any more."""
    size = unit[UNIT_LAST] - unit[UNIT_FIRST]
    if unit[UNIT_MATRIX] != 0:
        size = size * size
    step = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK + BLOCK_WEIGHTS]
    first = data[DATA_HEAD + b * DATA_BLOCK + DATA_WEIGHTS] + row * step + unit[UNIT_WEIGHTS]
    for i in range(size):
        weights[first + i] *= factor


def weigh_units(
    system: ConstantIntegers, data: ConstantIntegers, b: Integer, u: Integer, factor: Real, weights: Reals
) -> None:
    """The same for unit ``u`` of all rows of a block."""
    unit = system[system[system[SYSTEM_BLOCKS_AT] + b * BLOCK + BLOCK_UNITS_AT] + u * UNIT :]
    for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
        weigh_unit(system, data, b, row, unit, factor, weights)


def leave_out(
    system: ConstantIntegers,
    data: Integers,
    rules: ConstantIntegers,
    bench: ConstantReals,
    places: ConstantIntegers,
    kappa: Reals,
    weights: Reals,
) -> None:
    """Take out the units that do not agree, and set κ of the others; a loss sees the tails itself, so it has 1."""
    n = 0
    first = 0
    for b in range(system[BLOCKS]):
        at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
        count = system[at + BLOCK_UNITS]
        if rules[rules[BLOCKS_AT] + b * RULED + RULED_TYPE] >= 0:
            for row in range(data[DATA_HEAD + b * DATA_BLOCK + DATA_ROWS]):
                for u in range(count):
                    unit = system[system[at + BLOCK_UNITS_AT] + u * UNIT :]
                    components = places[place_vector_at(rules, COMPONENTS) + n]
                    if places[place_vector_at(rules, INSIDE) + n] == 0:
                        weigh_unit(system, data, b, row, unit, 0.0, weights)
                        data[DATA_COUNT] -= components
                    elif unit[UNIT_LOSS] == NO_LOSS:
                        limit = bench[unit_vector_at(rules, LIMITS) + n]
                        left = consistency(limit / bench[unit_vector_at(rules, NOISE) + n], components)
                        kappa[first + u] = left
                    n += 1
        first += count


def factor_of_loss(
    group: Integer,
    units: Integer,
    dimension: Integer,
    rules: ConstantIntegers,
    bench: ConstantReals,
    places: ConstantIntegers,
) -> Real:
    """How large the noise of a group is by the units that agree; 1 where they do not tell, or fit exactly."""
    components = places[place_vector_at(rules, COMPONENTS) :]
    inside = places[place_vector_at(rules, INSIDE) :]
    total = 0
    count = 0
    variance = 1.0
    rounding = 0.0
    for u in range(units):
        total += inside[u] * components[u]
        if places[place_vector_at(rules, GROUP_OF) + u] == group:
            count += inside[u] * components[u]
            variance = bench[unit_vector_at(rules, NOISE) + u]
            if inside[u] == 1:
                rounding = max(bench[unit_vector_at(rules, UNIT_ROUNDINGS) + u], rounding)
    if count == 0 or total <= dimension or variance <= rounding:
        return 1.0
    return sqrt(variance)


def scale_losses(
    units: Integer,
    system: ConstantIntegers,
    data: ConstantIntegers,
    rules: ConstantIntegers,
    bench: ConstantReals,
    places: ConstantIntegers,
    factors: Reals,
    weights: Reals,
) -> None:
    """Weights of blocks with a loss and unknown noise, by the noise that the units that agree show."""
    for b in range(system[BLOCKS]):
        at = system[SYSTEM_BLOCKS_AT] + b * BLOCK
        own = rules[rules[BLOCKS_AT] + b * RULED :]
        lossy = system[system[at + BLOCK_UNITS_AT] + UNIT_LOSS] != NO_LOSS
        if own[RULED_TYPE] >= 0 and own[RULED_GROUP] != STATED and lossy:
            factor = factor_of_loss(own[RULED_GROUP], units, system[COORDINATES], rules, bench, places)
            factors[system[at + BLOCK_NOISE]] = factor
            for u in range(system[at + BLOCK_UNITS]):
                weigh_units(system, data, b, u, 1.0 / factor, weights)


def come_to_agreement(
    kept: Integer,
    scalars: Integer,
    system: ConstantIntegers,
    wide: ConstantIntegers,
    constants: ConstantReals,
    data: Integers,
    parameters: ConstantReals,
    weights: Reals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    levels: ConstantReals,
    forms: ConstantReals,
    start: Reals,
    work: Reals,
    desk: Reals,
    bench: Reals,
    places: Integers,
    states: Integers,
    kappa: Reals,
    factors: Reals,
) -> Integer:
    """Equations and start as consensus leaves them; how many units there are, 0: no consensus was looked for.

    ``kept`` 1: what does not agree is left out (`:robust`). ``scalars``: residuals of the units that are ruled.
    ``wide`` is ``system`` with room for all rows in one chunk. ``states`` (ANSWERS,) say how it went, as `agree`.
    """
    states[AGREED] = 0
    n = system[COORDINATES]
    if n == 0 or scalars == 0 or (kept == 1 and rules[STARTLESS] == 0 and scalars <= n):
        return 0
    units = agree(
        wide, constants, data, parameters, weights, index, columns, rules, levels, forms, start, work, desk, bench,
        places, states,
    )  # fmt: skip
    if states[AGREED] == 1:
        copied(system[NUMBERS], bench[point_at(wide, rules, 0) :], start)
        scale_losses(units, system, data, rules, bench, places, factors, weights)
        if kept == 1:
            leave_out(system, data, rules, bench, places, kappa, weights)
    return units


def inform(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: Reals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    point: ConstantReals,
    kappa: ConstantReals,
    sides: ConstantIntegers,
    work: Reals,
    flags: Integers,
    triangle: Reals,
    covariance: Reals,
) -> Integer:
    """The covariance (n, n) at the end of a solve, with the information that is left of the units; 1: there is one.

    The weights are multiplied by √κ, so that nothing but the covariance should be asked for afterwards.
    """
    first = 0
    for b in range(system[BLOCKS]):
        count = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK + BLOCK_UNITS]
        for u in range(count):
            if kappa[first + u] != 1.0:
                weigh_units(system, data, b, u, sqrt(kappa[first + u]), weights)
        first += count
    load_rows(system, data, parameters, weights, work)
    sweep(system, constants, data, index, columns, point, 0, 0, work, constants, triangle)
    held = work[multipliers_at(system, HELD) :]
    count = 0
    if flags[PENALISED] == 1:
        count = constraint_count(system, data)
    return set_covariance(system, triangle, sides, count, held, work, flags, covariance) < 1e300
