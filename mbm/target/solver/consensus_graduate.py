"""Graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020): from least squares to the truncated loss.

As `mbm.solution.robust.gnc`: from the least squares and from the least absolute deviations.
"""

from __future__ import annotations

from math import inf, isfinite, sqrt

from mbm.target.decisions import ABSOLUTE_ROUNDS, CONTROL_GROWTH, GRADUATED_FITS, GRADUATED_ROUNDS, STILL
from mbm.target.solver.consensus_description import (
    CUTS,
    GROUP_OF,
    GROUPS,
    LIMITS,
    MEDIANS,
    SORTED,
    SQUARES,
    WEIGHTS_OF,
    place_vector_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_order import median, robust_variance
from mbm.target.solver.consensus_refine import refined
from mbm.target.solver.consensus_rules import GIVEN
from mbm.target.solver.description import COORDINATES
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def widen_limits(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    scalars: Integer,
    fresh: Integer,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """Limits by the noise at the present squares; smaller ones stay unless ``fresh`` is 1."""
    groups = places[place_vector_at(rules, GROUP_OF) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    medians = bench[unit_vector_at(rules, MEDIANS) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    for group in range(-1, rules[GROUPS]):
        variance = 1.0
        if group >= 0:
            scratch = bench[unit_vector_at(rules, SORTED) :]
            variance = robust_variance(units, scalars, system[COORDINATES], squares, medians, groups, group, scratch)
        for u in range(units):
            if groups[u] == group:
                wide = bench[unit_vector_at(rules, CUTS) + u] * variance
                limits[u] = wide if fresh == 1 else min(limits[u], wide)


def graduated_weight(square: Real, limit: Real, control: Real) -> Real:
    """The weight of the truncated loss made smooth (eq. 14 of the paper)."""
    if square <= control / (control + 1.0) * limit:
        return 1.0
    if square >= (control + 1.0) / control * limit:
        return 0.0
    between = sqrt(limit * control * (control + 1.0) / max(square, 1e-300)) - control
    return min(max(between, 0.0), 1.0)


def graduated(
    absolute: Integer,
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
    """Point 0 of the bench where weights have become 0 or 1, begun at least squares or least absolute deviations."""
    weights = bench[unit_vector_at(rules, WEIGHTS_OF) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    sorted_ = bench[unit_vector_at(rules, SORTED) :]
    for u in range(units):
        weights[u] = 1.0
    refined(
        GIVEN, GRADUATED_FITS, STILL, 0, units, 0, 0, system, constants, data, index, columns, rules, work, bench,
        places, answer,
    )  # fmt: skip
    for _ in range(absolute * ABSOLUTE_ROUNDS):
        for u in range(units):
            sorted_[u] = sqrt(squares[u])
        least = 1e-3 * median(units, sorted_) + 1e-300
        for u in range(units):
            weights[u] = 1.0 / max(sqrt(squares[u]), least)
        refined(
            GIVEN, 1, STILL, 0, units, 0, 0, system, constants, data, index, columns, rules, work, bench, places, answer
        )
    widen_limits(system, rules, units, scalars, 1, bench, places)
    control = inf
    for u in range(units):
        if isfinite(squares[u]):
            control = min(limits[u] / max(2.0 * squares[u] - limits[u], 1e-300), control)
    if not (control > 0.0 and isfinite(control)):
        return
    for _ in range(GRADUATED_ROUNDS):
        decided = 1
        for u in range(units):
            weights[u] = graduated_weight(squares[u], limits[u], control)
            if weights[u] >= 1e-6 and weights[u] <= 1.0 - 1e-6:
                decided = 0
        refined(
            GIVEN, 1, STILL, 0, units, 0, 0, system, constants, data, index, columns, rules, work, bench, places, answer
        )
        widen_limits(system, rules, units, scalars, 0, bench, places)
        if decided == 1:
            break
        control = control * CONTROL_GROWTH
