"""How well trials explain the units: the best of them by each score, in lists that grow as trials are made."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.decisions import CANDIDATES, WIDE
from mbm.target.solver.consensus_description import (
    BY_MEDIAN,
    BY_RULE,
    BY_WIDE_LIMITS,
    CUTS,
    GROUP_OF,
    GROUPS,
    LIMITS,
    LISTS,
    MEDIANS,
    SORTED,
    SQUARES,
    UNIT_ROUNDINGS,
    VARIANCES,
    best_at,
    best_scores_at,
    place_vector_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_rows import unit_squares
from mbm.target.solver.consensus_scores import LMEDS, RANSAC, inside_count, least_median, outlier_count, truncated
from mbm.target.solver.description import NUMBERS
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.workspace import residuals_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def empty_lists(system: ConstantIntegers, rules: ConstantIntegers, places: Integers) -> None:
    """No trial is among the best yet."""
    for k in range(LISTS):
        places[best_at(system, rules) + LISTS * CANDIDATES + k] = 0


def listed(system: ConstantIntegers, rules: ConstantIntegers, which: Integer, places: ConstantIntegers) -> Integer:
    """How many trials there are in a list."""
    return places[best_at(system, rules) + LISTS * CANDIDATES + which]


def points_equal(system: ConstantIntegers, a: ConstantReals, b: ConstantReals) -> Integer:
    """Whether two points are equal."""
    for i in range(system[NUMBERS]):
        if a[i] != b[i]:
            return 0
    return 1


def put_in_list(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    which: Integer,
    most: Integer,
    trial: Integer,
    score: Real,
    bench: Reals,
    places: Integers,
) -> None:
    """Put a trial into a list of the best, lowest score first, ``most`` of them; not twice the same point."""
    numbers = places[best_at(system, rules) + which * CANDIDATES :]
    counts = places[best_at(system, rules) + LISTS * CANDIDATES :]
    scores = bench[best_scores_at(system, rules) + which * CANDIDATES :]
    points = bench[trials_at(system, rules) :]
    count = counts[which]
    place = count
    while place > 0 and scores[place - 1] > score:
        place = place - 1
    same = place
    while same > 0 and scores[same - 1] == score:
        same = same - 1
        if points_equal(system, points[numbers[same] * system[NUMBERS] :], points[trial * system[NUMBERS] :]) == 1:
            return
    if place >= most:
        return
    last = count
    if last >= most:
        last = most - 1
    for back in range(last - place):
        numbers[last - back] = numbers[last - back - 1]
        scores[last - back] = scores[last - back - 1]
    numbers[place] = trial
    scores[place] = score
    counts[which] = last + 1


def bound_of(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    which: Integer,
    most: Integer,
    bench: ConstantReals,
    places: ConstantIntegers,
) -> Real:
    """The score from which on a trial does not come into a list."""
    if listed(system, rules, which, places) < most:
        return inf
    return bench[best_scores_at(system, rules) + which * CANDIDATES + most - 1]


def judge_trials(
    kind: Integer,
    first: Integer,
    last: Integer,
    size: Integer,
    units: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The trials ``first … last`` into the lists of the best, by a kind of score; limits are those in the bench.

    The least median has a list by itself; other scores stand beside that with `WIDE` limits. The largest number of
    units is given that are within their cuts at one of these trials.
    """
    groups = places[place_vector_at(rules, GROUP_OF) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    residuals = work[residuals_at(system, 0) :]
    half = CANDIDATES // 2
    inside = 0
    for trial in range(first, last):
        point = bench[trials_at(system, rules) + trial * system[NUMBERS] :]
        residuals_at_point(system, constants, data, index, point, 0, 0, work, residuals)
        unit_squares(rules, places, units, residuals, squares)
        here = inside_count(units, squares, bench[unit_vector_at(rules, CUTS) :])
        if here > inside:
            inside = here
        if kind == LMEDS:
            medians = bench[unit_vector_at(rules, MEDIANS) :]
            scratch = bench[unit_vector_at(rules, SORTED) :]
            bound = bound_of(system, rules, BY_MEDIAN, CANDIDATES, bench, places)
            score = least_median(units, rules[GROUPS], size, squares, medians, groups, bound, scratch)
            if isfinite(score):
                put_in_list(system, rules, BY_MEDIAN, CANDIDATES, trial, score, bench, places)
        else:
            score = truncated(units, 1.0, squares, limits)
            if kind == RANSAC:
                score = outlier_count(units, squares, limits, score)
            if score < bound_of(system, rules, BY_RULE, half, bench, places):
                put_in_list(system, rules, BY_RULE, half, trial, score, bench, places)
            wide = truncated(units, WIDE, squares, limits)
            if wide < bound_of(system, rules, BY_WIDE_LIMITS, half, bench, places):
                put_in_list(system, rules, BY_WIDE_LIMITS, half, trial, wide, bench, places)
    return inside


def limit_by_noise(
    system: ConstantIntegers,
    data: ConstantIntegers,
    constants: ConstantReals,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    scalars: Integer,
    point: ConstantReals,
    work: Reals,
    bench: Reals,
    places: ConstantIntegers,
) -> None:
    """Limits and variances (U,) in the bench from the noise at a point."""
    residuals = work[residuals_at(system, 0) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    variances = bench[unit_vector_at(rules, VARIANCES) :]
    residuals_at_point(system, constants, data, index, point, 0, 0, work, residuals)
    unit_squares(rules, places, units, residuals, squares)
    variances_at(
        units,
        scalars,
        0,
        rules[GROUPS],
        squares,
        bench[unit_vector_at(rules, MEDIANS) :],
        places[place_vector_at(rules, GROUP_OF) :],
        bench[unit_vector_at(rules, UNIT_ROUNDINGS) :],
        bench[unit_vector_at(rules, SORTED) :],
        variances,
    )
    for u in range(units):
        bench[unit_vector_at(rules, LIMITS) + u] = bench[unit_vector_at(rules, CUTS) + u] * variances[u]
