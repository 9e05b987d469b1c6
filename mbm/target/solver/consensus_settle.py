"""From the best candidate to the fixed point of fit, noise and inliers; whether another candidate is as good."""

from __future__ import annotations

from math import sqrt

from mbm.target.chi_square import consistency
from mbm.target.decisions import APART, AS_GOOD, CONTRADICTED, REFINING_STEPS, SETTLING_ROUNDS, STATED, STILL
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
    SORTED,
    SQUARES,
    UNIT_ROUNDINGS,
    VARIANCES,
    candidate_at,
    place_vector_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_joint import joined
from mbm.target.solver.consensus_laws import mark_inliers
from mbm.target.solver.consensus_order import robust_variance, variances_at
from mbm.target.solver.consensus_refine import refined
from mbm.target.solver.consensus_rules import TRUNCATED
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


def contradicted(
    system: ConstantIntegers, rules: ConstantIntegers, units: Integer, bench: ConstantReals, places: ConstantIntegers
) -> Integer:
    """Whether the inliers with stated noise scatter by more than that."""
    components = places[place_vector_at(rules, COMPONENTS) :]
    groups = places[place_vector_at(rules, GROUP_OF) :]
    inside = places[place_vector_at(rules, INSIDE) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    cuts = bench[unit_vector_at(rules, CUTS) :]
    total = 0
    expected = 0.0
    summed = 0.0
    last_cut = -1.0
    last_size = 0
    left = 1.0
    for u in range(units):
        if inside[u] == 1 and groups[u] == STATED:
            if cuts[u] != last_cut or components[u] != last_size:
                last_cut = cuts[u]
                last_size = components[u]
                left = consistency(last_cut, last_size)
            total += components[u]
            expected += float(components[u]) * left
            summed += squares[u]
    freedom = float(total - system[COORDINATES])
    if not freedom > 0.0:
        return 0
    excess = summed / freedom * float(total) / expected - 1.0
    return excess > CONTRADICTED * sqrt(2.0 / freedom)


def renew_variances(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    scalars: Integer,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """The noise at the present squares: of unknown groups, and of stated ones that the data contradict."""
    n = system[COORDINATES]
    groups = places[place_vector_at(rules, GROUP_OF) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    medians = bench[unit_vector_at(rules, MEDIANS) :]
    rounding = bench[unit_vector_at(rules, UNIT_ROUNDINGS) :]
    scratch = bench[unit_vector_at(rules, SORTED) :]
    fresh = bench[unit_vector_at(rules, FRESH) :]
    variances = bench[unit_vector_at(rules, VARIANCES) :]
    variances_at(units, scalars, n, rules[GROUPS], squares, medians, groups, rounding, scratch, fresh)
    wide = -1.0
    if contradicted(system, rules, units, bench, places) == 1:
        wide = max(robust_variance(units, scalars, n, squares, medians, groups, STATED, scratch), 1.0)
    for u in range(units):
        if groups[u] != STATED:
            variances[u] = fresh[u]
        elif wide > 0.0:
            variances[u] = wide


def set_limits(rules: ConstantIntegers, units: Integer, bench: Reals) -> None:
    """Limits (U,) from cuts and variances."""
    for u in range(units):
        variance = bench[unit_vector_at(rules, VARIANCES) + u]
        bench[unit_vector_at(rules, LIMITS) + u] = bench[unit_vector_at(rules, CUTS) + u] * variance


def settled(
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
    answer: Reals,
) -> None:
    """Point 0 of the bench where fit, scale and inliers agree with one another, from the variances in the bench."""
    inside = places[place_vector_at(rules, INSIDE) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    for u in range(units):
        inside[u] = -1
    for _ in range(SETTLING_ROUNDS):
        set_limits(rules, units, bench)
        refined(
            TRUNCATED,
            REFINING_STEPS,
            STILL,
            0,
            units,
            0,
            0,
            system,
            constants,
            data,
            index,
            columns,
            rules,
            work,
            bench,
            places,
            answer,
        )
        if mark_inliers(units, squares, limits, inside) == 1:
            break
        renew_variances(system, rules, units, scalars, bench, places)
    set_limits(rules, units, bench)


def finished(
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
    answer: Reals,
) -> Integer:
    """The fixed point reached from point 0 and the variances in the bench; how many units are inside.

    `LIMITS` and `INSIDE` hold at it, `NOISE` is the variance of the noise.
    """
    settled(units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer)
    inside = places[place_vector_at(rules, INSIDE) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    mark_inliers(units, squares, bench[unit_vector_at(rules, LIMITS) :], inside)
    copied(units, bench[unit_vector_at(rules, VARIANCES) :], bench[unit_vector_at(rules, NOISE) :])
    if rules[GROUPS] > 0:
        joined(units, scalars, system, constants, data, index, columns, rules, work, bench, places)
    count = 0
    for u in range(units):
        count += inside[u]
    return count


def rival(
    first: Integer,
    last: Integer,
    best: Integer,
    units: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    bench: ConstantReals,
) -> Integer:
    """Whether another candidate explains the data as well, at a place that contradicts the best one's inliers.

    Inliers are judged by the cuts and variances in the bench.
    """
    cuts = bench[unit_vector_at(rules, CUTS) :]
    variances = bench[unit_vector_at(rules, VARIANCES) :]
    own = bench[candidate_at(system, rules, best) + 1 + system[NUMBERS] :]
    lowest = bench[candidate_at(system, rules, best)]
    here = 0.0
    for u in range(units):
        if own[u] <= cuts[u] * variances[u]:
            here += own[u]
    for k in range(first, last):
        if bench[candidate_at(system, rules, k)] < lowest + AS_GOOD:
            theirs = bench[candidate_at(system, rules, k) + 1 + system[NUMBERS] :]
            there = 0.0
            for u in range(units):
                if own[u] <= cuts[u] * variances[u]:
                    there += min(theirs[u], 1e6)
            if there > here + APART:
                return 1
    return 0
