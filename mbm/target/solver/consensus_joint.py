"""Where noise is unknown: fit, noise and limits of the units that agree, together (`mbm.solution.robust.joint`)."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.decisions import ARRIVED, JOINT_STEPS, STATED
from mbm.target.solver.consensus_description import (
    COMPONENTS,
    CUTS,
    FRESH,
    GROUP_OF,
    GROUPS,
    INSIDE,
    LIMITS,
    MEDIANS,
    NOISE,
    REACHES,
    SORTED,
    SQUARES,
    STEP,
    THRESHOLDED,
    UNIT_ROUNDINGS,
    VARIANCES,
    WEIGHTS_OF,
    by_row_at,
    place_vector_at,
    point_at,
    slot_at,
    small_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_laws import untruncated
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_refine import measure, weighted_step
from mbm.target.solver.consensus_rows import linearised, moved, spread_weights
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def group_noise(
    group: Integer,
    units: Integer,
    freedom_each: Real,
    rules: ConstantIntegers,
    squares: ConstantReals,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """`NOISE` and `LIMITS` of one group of unknown noise, from its inliers and the variances that are there.

    ``freedom_each`` is the redundancy of one residual: unknowns are shared out by the number of residuals.
    """
    groups = places[place_vector_at(rules, GROUP_OF) :]
    components = places[place_vector_at(rules, COMPONENTS) :]
    inside = places[place_vector_at(rules, INSIDE) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    reaches = bench[unit_vector_at(rules, REACHES) :]
    rounding = bench[unit_vector_at(rules, UNIT_ROUNDINGS) :]
    noise = bench[unit_vector_at(rules, NOISE) :]
    count = 0
    wide = 0
    summed = 0.0
    least = 1e-300
    for u in range(units):
        if groups[u] == group and inside[u] == 1:
            count += components[u]
            summed += squares[u]
            least = max(least, rounding[u])
            if rules[THRESHOLDED] == 0 and squares[u] > limits[u]:
                wide = 1
    freedom = float(count) * freedom_each
    if freedom > 0.0:
        raw = max(summed / freedom, least)
        found = untruncated(units, group, wide, raw, limits, reaches, components, groups, inside)
        for u in range(units):
            if groups[u] == group:
                noise[u] = found
    if wide == 1:
        for u in range(units):
            if groups[u] == group:
                limits[u] = max(limits[u], reaches[u] * noise[u])


def noise_and_limits(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    scalars: Integer,
    squares: ConstantReals,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """`NOISE` (U,), as stated or that of the inliers, and `LIMITS` (U,) at squared norms (U,); `INSIDE` stays.

    Where the limits of the robust scale leave out units that are inside, three deviations of their noise are the limit.
    """
    n = system[COORDINATES]
    groups = places[place_vector_at(rules, GROUP_OF) :]
    components = places[place_vector_at(rules, COMPONENTS) :]
    inside = places[place_vector_at(rules, INSIDE) :]
    medians = bench[unit_vector_at(rules, MEDIANS) :]
    rounding = bench[unit_vector_at(rules, UNIT_ROUNDINGS) :]
    scratch = bench[unit_vector_at(rules, SORTED) :]
    fresh = bench[unit_vector_at(rules, FRESH) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    cuts = bench[unit_vector_at(rules, CUTS) :]
    noise = bench[unit_vector_at(rules, NOISE) :]
    variances_at(units, scalars, n, rules[GROUPS], squares, medians, groups, rounding, scratch, fresh)
    total = 0
    for u in range(units):
        noise[u] = fresh[u] if groups[u] != STATED else bench[unit_vector_at(rules, VARIANCES) + u]
        limits[u] = cuts[u] * noise[u]
        if inside[u] == 1:
            total += components[u]
    freedom_each = 1.0 - float(n) / float(total) if total > 0 else 0.0
    for group in range(rules[GROUPS]):
        group_noise(group, units, freedom_each, rules, squares, bench, places)
    for u in range(units):
        if inside[u] == 1:
            limits[u] = max(limits[u], squares[u])


def promised(
    here: Integer,
    count: Integer,
    rest: Real,
    units: Integer,
    scalars: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    bench: Reals,
    places: ConstantIntegers,
) -> Real:
    """What a step from point ``here`` promises, with weights by the noise of the inliers there; infinite: no value."""
    inside = places[place_vector_at(rules, INSIDE) :]
    squares = bench[unit_vector_at(rules, SQUARES + here) :]
    noise = bench[unit_vector_at(rules, NOISE) :]
    weights = bench[unit_vector_at(rules, WEIGHTS_OF) :]
    noise_and_limits(system, rules, units, scalars, squares, bench, places)
    total = rest
    for u in range(units):
        weights[u] = 0.0
        if inside[u] == 1:
            weights[u] = 1.0 / noise[u]
            total += squares[u]
    if not isfinite(total):
        return inf
    spread_weights(rules, places, units, count, weights, bench[by_row_at(system, rules) :])
    return weighted_step(system, rules, count, here, 0.0, bench)


def fitted_jointly(
    units: Integer,
    scalars: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> None:
    """Point 0 of the bench at the fit to the inliers: Gauss-Newton steps as long as they promise less and less."""
    here = 0
    point = bench[point_at(system, rules, 0) :]
    chunk = bench[slot_at(system, rules, 0) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    count = linearised(system, data, index, columns, point, work, chunk)
    rest = measure(system, rules, places, units, count, chunk, squares, bench)
    promise = promised(0, count, rest, units, scalars, system, rules, bench, places)
    for _ in range(JOINT_STEPS):
        if not (promise > ARRIVED and isfinite(promise)):
            break
        there = bench[point_at(system, rules, 1 - here) :]
        tried = bench[slot_at(system, rules, 1 - here) :]
        tried_squares = bench[unit_vector_at(rules, SQUARES + 1 - here) :]
        moved(system, constants, point, bench[small_at(system, rules, STEP) :], there)
        linearised(system, data, index, columns, there, work, tried)
        rest_there = measure(system, rules, places, units, count, tried, tried_squares, bench)
        further = promised(1 - here, count, rest_there, units, scalars, system, rules, bench, places)
        if not further < promise:
            break
        promise = further
        here = 1 - here
        point = bench[point_at(system, rules, here) :]
        squares = bench[unit_vector_at(rules, SQUARES + here) :]
    if here == 1:
        copied(system[NUMBERS], point, bench[point_at(system, rules, 0) :])
        copied(units, squares, bench[unit_vector_at(rules, SQUARES) :])
    noise_and_limits(system, rules, units, scalars, bench[unit_vector_at(rules, SQUARES) :], bench, places)


def joined(
    units: Integer,
    scalars: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> None:
    """The joint solution near point 0, with the units that come in by it.

    Three standard deviations of the inliers take units back where the robust scale came out low, unless limits are
    stated. `VARIANCES` hold for stated noise; `INSIDE`, `LIMITS` and `NOISE` are answered.
    """
    groups = places[place_vector_at(rules, GROUP_OF) :]
    inside = places[place_vector_at(rules, INSIDE) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    reaches = bench[unit_vector_at(rules, REACHES) :]
    noise = bench[unit_vector_at(rules, NOISE) :]
    more = 1
    while more == 1:
        more = 0
        fitted_jointly(units, scalars, system, constants, data, index, columns, rules, work, bench, places)
        for u in range(units):
            wider = limits[u]
            if rules[THRESHOLDED] == 0 and groups[u] != STATED:
                wider = max(wider, reaches[u] * noise[u])
            if inside[u] == 0 and squares[u] <= wider:
                inside[u] = 1
                more = 1
