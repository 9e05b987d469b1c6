"""Fits to self-chosen units from one point: the local search of consensus (`mbm.solution.robust.refine`)."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import CANDIDATE_DAMPING, CANDIDATE_REGULARISATION
from mbm.target.solver.consensus_description import (
    GRADIENT,
    LIMITS,
    NO_CANDIDATE,
    SCALES,
    SQUARES,
    STEP,
    WEIGHTS_OF,
    bench_matrix_at,
    by_row_at,
    candidate_at,
    point_at,
    slot_at,
    small_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_rows import (
    linearised,
    moved,
    spread_weights,
    unit_squares,
    unruled_square,
    weigh_columns,
)
from mbm.target.solver.consensus_rules import GIVEN, TRUNCATED, judged
from mbm.target.solver.description import CHUNK, COORDINATES, NUMBERS, PLACES_AT
from mbm.target.solver.linear_algebra import cholesky, copied, dot
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

NEARLY_STILL = 1e-4
"""A step that promises to lower the objective by less than this has arrived, where a fit is only on the way."""

ALIKE = 1e-6
"""Squared distance of two points, in standard deviations of the residuals, below which they lead to one end."""

NEAR = 0.1
"""The same where they have the same units inside: the next fit, to these, leads from both to one point."""


def weighted_step(
    system: ConstantIntegers, rules: ConstantIntegers, count: Integer, slot: Integer, damping: Real, bench: Reals
) -> Real:
    """The Marquardt step by the weights of the rows, and the decrease of the weighted sum of squares it promises.

    Both are 0 where something is not finite. The diagonal of the normal equations, as roots, stays in `SCALES`.
    """
    n = system[COORDINATES]
    stride = system[CHUNK]
    chunk = bench[slot_at(system, rules, slot) :]
    weighted = bench[slot_at(system, rules, 2) :]
    normal = bench[bench_matrix_at(system, rules) :]
    gradient = bench[small_at(system, rules, GRADIENT) :]
    scale = bench[small_at(system, rules, SCALES) :]
    step = bench[small_at(system, rules, STEP) :]
    weigh_columns(n + 1, stride, count, bench[by_row_at(system, rules) :], chunk, weighted)
    finite = 1
    for i in range(n):
        gradient[i] = dot(count, weighted[i * stride :], chunk[n * stride :])
        step[i] = 0.0
        if not isfinite(gradient[i]):
            finite = 0
        for j in range(i + 1):
            normal[i * n + j] = dot(count, weighted[i * stride :], chunk[j * stride :])
            if not isfinite(normal[i * n + j]):
                finite = 0
    if finite == 0:
        return 0.0
    for i in range(n):
        scale[i] = sqrt(normal[i * n + i]) if normal[i * n + i] > 0.0 else 1.0
    for i in range(n):
        for j in range(i + 1):
            normal[i * n + j] = normal[i * n + j] / scale[i] / scale[j]
        normal[i * n + i] += damping + CANDIDATE_REGULARISATION
        gradient[i] = gradient[i] / scale[i]
    if cholesky(n, normal) == 0:
        return 0.0
    for i in range(n):
        total = gradient[i]
        for j in range(i):
            total -= normal[i * n + j] * step[j]
        step[i] = total / normal[i * n + i]
    for back in range(n):
        i = n - 1 - back
        total = step[i]
        for j in range(i + 1, n):
            total -= normal[j * n + i] * step[j]
        step[i] = total / normal[i * n + i]
    lowered = 0.0
    for i in range(n):
        lowered += gradient[i] * step[i] + damping * step[i] * step[i]
        step[i] = -step[i] / scale[i]
    return lowered if isfinite(lowered) else 0.0


def same_inside(units: Integer, weights: ConstantReals, squares: ConstantReals, limits: ConstantReals) -> Integer:
    """Whether units count (U,) just where their squared norms are within their limits."""
    different = 0
    for u in range(units):
        different += (weights[u] > 0.0) != (squares[u] <= limits[u])
    return different == 0


def candidate_alike(
    rule: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    first: Integer,
    last: Integer,
    objective: Real,
    point: ConstantReals,
    squares: ConstantReals,
    bench: Reals,
) -> Integer:
    """Which of the candidates ``first … last`` the point leads to for sure, `NO_CANDIDATE` if none.

    Candidates are ends by the limits in the bench.
    """
    weights = bench[unit_vector_at(rules, WEIGHTS_OF) :]
    scale = bench[small_at(system, rules, SCALES) :]
    for k in range(first, last):
        other = bench[candidate_at(system, rules, k) :]
        theirs = other[1 + system[NUMBERS] :]
        if fabs(other[0] - objective) < NEAR:
            near = ALIKE
            along = 1e-3
            if rule == TRUNCATED and same_inside(units, weights, theirs, bench[unit_vector_at(rules, LIMITS) :]) == 1:
                near = NEAR
                along = 0.1
            away = 0.0
            for j in range(system[COORDINATES]):
                place = system[system[PLACES_AT] + j]
                if place >= 0:
                    difference = scale[j] * (other[1 + place] - point[place])
                    away += along * difference * difference
            for u in range(units):
                if weights[u] > 0.0:
                    difference = squares[u] - theirs[u]
                    away += weights[u] * (difference * difference / (squares[u] + theirs[u] + 1e-300))
            if away < near:
                return k
    return NO_CANDIDATE


def measure(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    places: ConstantIntegers,
    units: Integer,
    count: Integer,
    chunk: ConstantReals,
    squares: Reals,
    bench: ConstantReals,
) -> Real:
    """The squared norms (U,) of the units, and the sum of squares that no rule touches."""
    residuals = chunk[system[COORDINATES] * system[CHUNK] :]
    unit_squares(rules, places, units, residuals, squares)
    return unruled_square(rules, places, count, residuals, bench[by_row_at(system, rules) + system[CHUNK] :])


def refined(
    rule: Integer,
    iterations: Integer,
    still: Real,
    size: Integer,
    units: Integer,
    first: Integer,
    last: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
    answer: Reals,
) -> Integer:
    """Point 0 of the bench after fits to the units that the rule picks, anew at every step; its squares follow it.

    Steps end where they promise less than ``still``. ``answer`` (1,) is the objective there, never above that at the
    start, infinite where there is no value. If the point comes to one of the candidates ``first … last`` it stays there
    and the number of that is given.
    """
    here = 0
    point = bench[point_at(system, rules, 0) :]
    chunk = bench[slot_at(system, rules, 0) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    count = linearised(system, data, index, columns, point, work, chunk)
    rest = measure(system, rules, places, units, count, chunk, squares, bench)
    objective = judged(rule, units, size, system, rules, squares, rest, bench, places)
    damping = CANDIDATE_DAMPING
    alike = NO_CANDIDATE
    if isfinite(objective):
        alike = candidate_alike(rule, system, rules, units, first, last, objective, point, squares, bench)
    done = 0
    while isfinite(objective) and damping < 1e6 and done < iterations and alike == NO_CANDIDATE:
        done += 1
        weights = bench[unit_vector_at(rules, WEIGHTS_OF) :]
        spread_weights(rules, places, units, count, weights, bench[by_row_at(system, rules) :])
        promise = weighted_step(system, rules, count, here, damping, bench)
        enough = still * objective if rule == GIVEN else still
        if not promise > enough:
            break
        there = bench[point_at(system, rules, 1 - here) :]
        tried = bench[slot_at(system, rules, 1 - here) :]
        tried_squares = bench[unit_vector_at(rules, SQUARES + 1 - here) :]
        moved(system, constants, point, bench[small_at(system, rules, STEP) :], there)
        linearised(system, data, index, columns, there, work, tried)
        rest_there = measure(system, rules, places, units, count, tried, tried_squares, bench)
        lower = judged(rule, units, size, system, rules, tried_squares, rest_there, bench, places)
        if lower < objective:
            objective = lower
            rest = rest_there
            here = 1 - here
            point = bench[point_at(system, rules, here) :]
            chunk = bench[slot_at(system, rules, here) :]
            squares = bench[unit_vector_at(rules, SQUARES + here) :]
            damping = max(damping * 0.1, 1e-12)
            alike = candidate_alike(rule, system, rules, units, first, last, objective, point, squares, bench)
        else:
            judged(rule, units, size, system, rules, squares, rest, bench, places)
            damping = max(damping * 30.0, 1e-4)
    if here == 1:
        copied(system[NUMBERS], point, bench[point_at(system, rules, 0) :])
        copied(units, squares, bench[unit_vector_at(rules, SQUARES) :])
    answer[0] = objective
    return alike
