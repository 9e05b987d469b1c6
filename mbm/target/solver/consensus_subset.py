"""The fit to the units of one subset, with what no rule touches, by Marquardt's method on the few rows it takes.

The damping is Nielsen's (1999), bounds are kept by holding what meets them, as in `mbm.solution.solvers.batched`.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import (
    FIRST_DAMPING,
    FIT_STEPS,
    HOPELESS_DAMPING,
    LEAST_GAIN_RATIO,
    POSITIVE_KEPT,
    REGULARISATION,
    REVISIONS,
)
from mbm.target.solver.consensus_description import (
    AWAY,
    BLOCK_OF,
    BLOCKS_AT,
    GRADIENT,
    HOLD,
    MOST_ROWS,
    ROW_OF,
    RULED,
    RULED_TYPE,
    SCALES,
    STEP,
    UNIT_OF,
    basis_at,
    bench_matrix_at,
    place_vector_at,
    point_at,
    slot_at,
    small_at,
    subset_data_at,
    subset_index_at,
    subset_rows_at,
)
from mbm.target.solver.consensus_rows import linearised, moved
from mbm.target.solver.description import (
    BLOCK,
    BLOCK_COLUMNS,
    BLOCK_INDEX,
    BLOCK_PARAMETERS,
    BLOCK_TANGENTS,
    BLOCK_UNITS_AT,
    BLOCK_VARIABLES,
    BLOCK_WEIGHTS,
    BLOCKS,
    BOUNDS_AT,
    CHUNK,
    CONSTRAINTS,
    COORDINATES,
    DATA_BLOCK,
    DATA_COLUMNS,
    DATA_HEAD,
    DATA_INDEX,
    DATA_PARAMETERS,
    DATA_ROWS,
    DATA_WEIGHTS,
    NUMBERS,
    PLACES_AT,
    POSITIVE_AT,
    UNIT,
    UNIT_FIRST,
    UNIT_LAST,
    UNIT_MATRIX,
    UNIT_WEIGHTS,
)
from mbm.target.solver.description import BLOCKS_AT as SYSTEM_BLOCKS_AT
from mbm.target.solver.equations import load_rows
from mbm.target.solver.linear_algebra import cholesky, copied, dot
from mbm.target.solver.manifolds import coordinates_of
from mbm.target.step_control import damping_factor
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

SMALL = 1e-14
"""Square of the tolerance: the fit is over where a step promises no more of the cost."""


def copied_integers(n: Integer, a: ConstantIntegers, target: Integers) -> None:
    """``target = a``."""
    for i in range(n):
        target[i] = a[i]


def add_row(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    b: Integer,
    row: Integer,
    only: Integer,
    bench: Reals,
    places: Integers,
) -> None:
    """One more row of block b behind those of the subset; all its units count (``only`` -1), or one of them."""
    block = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK :]
    at = DATA_HEAD + b * DATA_BLOCK
    mine = places[subset_data_at(system, rules) + at :]
    own = bench[subset_rows_at(system, rules) :]
    marks = places[subset_index_at(system, rules) :]
    done = mine[DATA_ROWS]
    wide = block[BLOCK_PARAMETERS]
    heavy = block[BLOCK_WEIGHTS]
    copied(wide, parameters[data[at + DATA_PARAMETERS] + row * wide :], own[mine[DATA_PARAMETERS] + done * wide :])
    theirs = weights[data[at + DATA_WEIGHTS] + row * heavy :]
    here = own[rules[MOST_ROWS] + mine[DATA_WEIGHTS] + done * heavy :]
    if only < 0:
        copied(heavy, theirs, here)
    else:
        for w in range(heavy):
            here[w] = 0.0
        unit = system[block[BLOCK_UNITS_AT] + only * UNIT :]
        size = unit[UNIT_LAST] - unit[UNIT_FIRST]
        if unit[UNIT_MATRIX] != 0:
            size = size * size
        copied(size, theirs[unit[UNIT_WEIGHTS] :], here[unit[UNIT_WEIGHTS] :])
    step = block[BLOCK_INDEX]
    if step > 0 or done == 0:
        first = data[at + DATA_INDEX] + row * step
        copied_integers(block[BLOCK_VARIABLES], index[first:], marks[mine[DATA_INDEX] + done * step :])
    step = block[BLOCK_COLUMNS]
    if step > 0 or done == 0:
        first = data[at + DATA_COLUMNS] + row * step
        behind = marks[rules[MOST_ROWS] + mine[DATA_COLUMNS] + done * step :]
        copied_integers(block[BLOCK_TANGENTS], columns[first:], behind)
    mine[DATA_ROWS] = done + 1


def gather_subset(
    system: ConstantIntegers,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    count: Integer,
    chosen: ConstantIntegers,
    desk: Reals,
    bench: Reals,
    places: Integers,
) -> None:
    """The rows of the chosen units (count,), and all that no rule acts on, as a data set of its own, on the desk."""
    subset = places[subset_data_at(system, rules) :]
    subset[0] = 0
    wide = 0
    heavy = 0
    variables = 0
    tangents = 0
    for b in range(system[BLOCKS]):
        block = system[system[SYSTEM_BLOCKS_AT] + b * BLOCK :]
        at = DATA_HEAD + b * DATA_BLOCK
        subset[at + DATA_PARAMETERS] = wide
        subset[at + DATA_WEIGHTS] = heavy
        subset[at + DATA_INDEX] = variables
        subset[at + DATA_COLUMNS] = tangents
        subset[at + DATA_ROWS] = 0
        if rules[rules[BLOCKS_AT] + b * RULED + RULED_TYPE] >= 0:
            for k in range(count):
                unit = chosen[k]
                if places[place_vector_at(rules, BLOCK_OF) + unit] == b:
                    row = places[place_vector_at(rules, ROW_OF) + unit]
                    only = places[place_vector_at(rules, UNIT_OF) + unit]
                    add_row(system, data, parameters, weights, index, columns, rules, b, row, only, bench, places)
        else:
            for row in range(data[at + DATA_ROWS]):
                add_row(system, data, parameters, weights, index, columns, rules, b, row, -1, bench, places)
        rows = subset[at + DATA_ROWS]
        wide += rows * block[BLOCK_PARAMETERS]
        heavy += rows * block[BLOCK_WEIGHTS]
        variables += block[BLOCK_VARIABLES] + rows * block[BLOCK_INDEX]
        tangents += block[BLOCK_TANGENTS] + rows * block[BLOCK_COLUMNS]
    for b in range(system[BLOCKS], system[BLOCKS] + system[CONSTRAINTS]):
        for i in range(DATA_BLOCK):
            subset[DATA_HEAD + b * DATA_BLOCK + i] = 0
    own = bench[subset_rows_at(system, rules) :]
    load_rows(system, subset, own, own[rules[MOST_ROWS] :], desk)


def normal_equations(
    system: ConstantIntegers, rules: ConstantIntegers, count: Integer, slot: Integer, bench: Reals
) -> Integer:
    """``JᵀJ`` and ``Jᵀr`` of a slot, columns scaled by the largest norms they have had; 0 where not all is finite."""
    n = system[COORDINATES]
    stride = system[CHUNK]
    chunk = bench[slot_at(system, rules, slot) :]
    normal = bench[bench_matrix_at(system, rules) :]
    gradient = bench[small_at(system, rules, GRADIENT) :]
    scale = bench[small_at(system, rules, SCALES) :]
    for i in range(n):
        gradient[i] = dot(count, chunk[i * stride :], chunk[n * stride :])
        if not isfinite(gradient[i]):
            return 0
        for j in range(i + 1):
            normal[i * n + j] = dot(count, chunk[i * stride :], chunk[j * stride :])
            normal[j * n + i] = normal[i * n + j]
            if not isfinite(normal[i * n + j]):
                return 0
        scale[i] = max(sqrt(normal[i * n + i]), scale[i])
    for i in range(n):
        by = scale[i] if scale[i] > 0.0 else 1.0
        gradient[i] = gradient[i] / by
        for j in range(n):
            normal[i * n + j] = normal[i * n + j] / by
            normal[j * n + i] = normal[j * n + i] / by
    return 1


def solve_free(
    n: Integer,
    damping: Real,
    normal: ConstantReals,
    gradient: ConstantReals,
    hold: ConstantReals,
    factor: Reals,
    step: Reals,
) -> None:
    """``(normal + damping) step = -gradient`` for what is not held; held coordinates keep their step."""
    for i in range(n):
        for j in range(i + 1):
            factor[i * n + j] = normal[i * n + j]
            if hold[i] + hold[j] > 0.0:
                factor[i * n + j] = 0.0
        factor[i * n + i] = 1.0 if hold[i] > 0.0 else normal[i * n + i] + damping + REGULARISATION
    good = cholesky(n, factor)
    for i in range(n):
        if hold[i] == 0.0:
            total = -gradient[i]
            for j in range(n):
                if hold[j] > 0.0:
                    total -= normal[i * n + j] * step[j]
            for j in range(i):
                if hold[j] == 0.0:
                    total -= factor[i * n + j] * step[j]
            step[i] = total / factor[i * n + i] if good == 1 else 0.0
    for back in range(n):
        i = n - 1 - back
        if hold[i] == 0.0:
            total = step[i]
            for j in range(i + 1, n):
                if hold[j] == 0.0:
                    total -= factor[j * n + i] * step[j]
            step[i] = total / factor[i * n + i] if good == 1 else 0.0


def bounded_step(
    system: ConstantIntegers,
    constants: ConstantReals,
    rules: ConstantIntegers,
    damping: Real,
    point: ConstantReals,
    bench: Reals,
) -> Real:
    """The damped step inside of the bounds; the largest slope along a coordinate that is free to move is given."""
    n = system[COORDINATES]
    gradient = bench[small_at(system, rules, GRADIENT) :]
    scale = bench[small_at(system, rules, SCALES) :]
    hold = bench[small_at(system, rules, HOLD) :]
    here = bench[small_at(system, rules, AWAY) :]
    step = bench[small_at(system, rules, STEP) :]
    normal = bench[bench_matrix_at(system, rules) :]
    factor = bench[basis_at(system, rules) :]
    coordinates_of(system, point, here)
    slope = 0.0
    for i in range(n):
        hold[i] = 0.0
        step[i] = 0.0
        if system[system[PLACES_AT] + i] >= 0:
            if here[i] <= constants[BOUNDS_AT + i] and gradient[i] >= 0.0:
                hold[i] = 1.0
            if here[i] >= constants[BOUNDS_AT + n + i] and gradient[i] <= 0.0:
                hold[i] = 1.0
        if hold[i] == 0.0:
            slope = max(slope, fabs(gradient[i]))
    for _ in range(REVISIONS + 1):
        solve_free(n, damping, normal, gradient, hold, factor, step)
        beyond = 0
        for i in range(n):
            if hold[i] == 0.0 and system[system[PLACES_AT] + i] >= 0:
                by = scale[i] if scale[i] > 0.0 else 1.0
                down = (constants[BOUNDS_AT + i] - here[i]) * by
                up = (constants[BOUNDS_AT + n + i] - here[i]) * by
                if system[system[POSITIVE_AT] + i] == 1:
                    down = max(down, (POSITIVE_KEPT - 1.0) * here[i] * by)
                if step[i] < down:
                    step[i] = down
                    hold[i] = 1.0
                    beyond = 1
                if step[i] > up:
                    step[i] = up
                    hold[i] = 1.0
                    beyond = 1
        if beyond == 0:
            break
    return slope


def fitted_to_subset(
    system: ConstantIntegers,
    constants: ConstantReals,
    rules: ConstantIntegers,
    start: ConstantReals,
    desk: Reals,
    bench: Reals,
    places: ConstantIntegers,
    target: Reals,
) -> None:
    """The point (N,) that the start leads to with the rows on the desk; never worse than the start."""
    n = system[COORDINATES]
    right = n * system[CHUNK]
    data = places[subset_data_at(system, rules) :]
    index = places[subset_index_at(system, rules) :]
    columns = index[rules[MOST_ROWS] :]
    step = bench[small_at(system, rules, STEP) :]
    scale = bench[small_at(system, rules, SCALES) :]
    gradient = bench[small_at(system, rules, GRADIENT) :]
    normal = bench[bench_matrix_at(system, rules) :]
    here = 0
    copied(system[NUMBERS], start, bench[point_at(system, rules, 0) :])
    for i in range(n):
        scale[i] = 0.0
    count = linearised(system, data, index, columns, start, desk, bench[slot_at(system, rules, 0) :])
    residuals = bench[slot_at(system, rules, 0) + right :]
    cost = dot(count, residuals, residuals)
    damping = FIRST_DAMPING
    growth = 2.0
    for _ in range(FIT_STEPS):
        if not isfinite(cost) or not damping <= HOPELESS_DAMPING:
            break
        if normal_equations(system, rules, count, here, bench) == 0:
            break
        point = bench[point_at(system, rules, here) :]
        slope = bounded_step(system, constants, rules, damping, point, bench)
        promise = 0.0
        for i in range(n):
            image = 0.0
            for j in range(n):
                image += normal[i * n + j] * step[j]
            promise -= step[i] * (image + 2.0 * gradient[i])
        if slope * slope <= SMALL * cost or cost <= SMALL * float(count):
            break
        last = damping <= FIRST_DAMPING and promise >= 0.0 and promise <= SMALL * cost
        for i in range(n):
            if scale[i] > 0.0:
                step[i] = step[i] / scale[i]
        there = bench[point_at(system, rules, 1 - here) :]
        moved(system, constants, point, step, there)
        linearised(system, data, index, columns, there, desk, bench[slot_at(system, rules, 1 - here) :])
        residuals = bench[slot_at(system, rules, 1 - here) + right :]
        lower = dot(count, residuals, residuals)
        share = (cost - lower) / promise if promise > 0.0 else -1.0
        if share > LEAST_GAIN_RATIO and isfinite(lower):
            here = 1 - here
            cost = lower
            damping *= damping_factor(share)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
        if last:
            break
    copied(system[NUMBERS], bench[point_at(system, rules, here) :], target)
