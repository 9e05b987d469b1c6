"""Trials: subsets of units, each fitted; then the points that explain the units best."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.solver.consensus_description import (
    CANDIDATES,
    COMPONENTS,
    CUTS,
    FIRST,
    FIRST_STATE,
    FORM,
    GROUP_OF,
    GROUPS,
    LIMITS,
    MEDIANS,
    MOST_POINTS,
    ORDER,
    ROUNDINGS,
    SECOND_STATE,
    SORTED,
    SQUARES,
    STARTS,
    TRIALS_AT,
    VARIANCES,
    basis_at,
    directions_at,
    place_vector_at,
    small_places_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_draw import (
    combinations_of,
    jump_to_next_trial,
    next_combination,
    subset_drawn,
    subset_taken,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_rows import unit_squares
from mbm.target.solver.consensus_scores import LMEDS, RANSAC, least_median, outlier_count, truncated
from mbm.target.solver.consensus_subset import fitted_to_subset, gather_subset
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.workspace import residuals_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals

MOST_FITS = 4000
"""Several starts are tried with each subset, up to so many fits; beyond, subsets and starts are paired off."""


def size_of_subsets(
    system: ConstantIntegers, rules: ConstantIntegers, units: Integer, bench: Reals, places: Integers
) -> Integer:
    """The units that the first trial takes; 0 where all units together do not determine the unknowns."""
    state = places[small_places_at(system, rules, 2) :]
    state[2] = rules[FIRST_STATE]
    state[3] = rules[SECOND_STATE]
    return subset_drawn(
        state[2:],
        units,
        system[COORDINATES],
        places[place_vector_at(rules, FIRST) :],
        bench[directions_at(system, rules) :],
        places[place_vector_at(rules, ORDER) :],
        bench[basis_at(system, rules) :],
        places[small_places_at(system, rules, 0) :],
    )


def next_subset(
    every: Integer,
    size: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The units of the next trial among the places: how many; 0 for a combination that leaves unknowns open."""
    first = places[place_vector_at(rules, FIRST) :]
    rows = bench[directions_at(system, rules) :]
    basis = bench[basis_at(system, rules) :]
    chosen = places[small_places_at(system, rules, 0) :]
    n = system[COORDINATES]
    if every == 1:
        combination = places[small_places_at(system, rules, 1) :]
        found = subset_taken(size, n, combination, first, rows, basis, chosen)
        next_combination(units, size, combination)
        return found
    state = places[small_places_at(system, rules, 2) :]
    state[2] = state[0]
    state[3] = state[1]
    jump_to_next_trial(state)
    return subset_drawn(state[2:], units, n, first, rows, places[place_vector_at(rules, ORDER) :], basis, chosen)


def all_alike(rules: ConstantIntegers, units: Integer, places: ConstantIntegers) -> Integer:
    """Whether all units have as many components."""
    components = places[place_vector_at(rules, COMPONENTS) :]
    for u in range(units):
        if components[u] != components[0]:
            return 0
    return 1


def fit_trials(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    forms: ConstantReals,
    starts: ConstantReals,
    units: Integer,
    size: Integer,
    desk: Reals,
    bench: Reals,
    places: Integers,
    answer: Integers,
) -> Integer:
    """Points that fit subsets, from the ``starts`` (STARTS, N) where no closed form does: how many.

    ``answer`` (1,) is the number of subsets.
    """
    numbers = system[NUMBERS]
    target = bench[trials_at(system, rules) :]
    room = rules[MOST_POINTS] - 4
    trials = rules[rules[TRIALS_AT] + size]
    most = combinations_of(units, size, trials)
    every = 0
    if most <= trials:
        trials = most
        every = all_alike(rules, units, places)
    state = places[small_places_at(system, rules, 2) :]
    state[0] = rules[FIRST_STATE]
    state[1] = rules[SECOND_STATE]
    for i in range(size):
        places[small_places_at(system, rules, 1) + i] = i
    chosen = places[small_places_at(system, rules, 0) :]
    fits = trials * rules[STARTS]
    if fits > MOST_FITS:
        fits = MOST_FITS
    if fits < trials:
        fits = trials
    done = 0
    subsets = 0
    for trial in range(trials):
        count = next_subset(every, size, system, rules, units, bench, places)
        if count > 0 and done < room:
            subsets += 1
            found = 0
            if rules[FORM] != 0:
                here = target[done * numbers :]
                found = points_in_closed_form(system, rules, forms, count, chosen, starts, bench, places, here)
                done += found
            if found == 0:
                gather_subset(
                    system, data, parameters, weights, index, columns, rules, count, chosen, desk, bench, places
                )
                turn = 0
                while turn * trials + trial < fits and done < room:
                    start = starts[(turn + trial) % rules[STARTS] * numbers :]
                    here = target[done * numbers :]
                    fitted_to_subset(system, constants, rules, start, desk, bench, places, here)
                    done += 1
                    turn += 1
                    if rules[FORM] != 0:
                        break
    answer[0] = subsets
    return done


def insert_best(count: Integer, trial: Integer, score: Real, numbers: Integers, scores: Reals) -> Integer:
    """Put a trial into the list of the best, lowest score first; how many it has then."""
    place = count
    while place > 0 and scores[place - 1] > score:
        place = place - 1
    if place >= CANDIDATES:
        return count
    last = count
    if last >= CANDIDATES:
        last = CANDIDATES - 1
    for back in range(last - place):
        numbers[last - back] = numbers[last - back - 1]
        scores[last - back] = scores[last - back - 1]
    numbers[place] = trial
    scores[place] = score
    return last + 1


def points_equal(system: ConstantIntegers, a: ConstantReals, b: ConstantReals) -> Integer:
    """Whether two points are equal."""
    for i in range(system[NUMBERS]):
        if a[i] != b[i]:
            return 0
    return 1


def best_trials(
    kind: Integer,
    size: Integer,
    units: Integer,
    count: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: ConstantIntegers,
    best: Integers,
    scores: Reals,
) -> Integer:
    """The trials with the lowest scores, best first, no point twice: how many; limits are those in the bench."""
    points = bench[trials_at(system, rules) :]
    groups = places[place_vector_at(rules, GROUP_OF) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    limits = bench[unit_vector_at(rules, LIMITS) :]
    medians = bench[unit_vector_at(rules, MEDIANS) :]
    scratch = bench[unit_vector_at(rules, SORTED) :]
    residuals = work[residuals_at(system, 0) :]
    found = 0
    for trial in range(count):
        point = points[trial * system[NUMBERS] :]
        bound = scores[CANDIDATES - 1] if found == CANDIDATES else inf
        residuals_at_point(system, constants, data, index, point, 0, 0, work, residuals)
        unit_squares(rules, places, units, residuals, squares)
        if kind == LMEDS:
            score = least_median(units, rules[GROUPS], size, squares, medians, groups, bound, scratch)
        elif kind == RANSAC:
            score = outlier_count(units, squares, limits, bound)
        else:
            score = truncated(units, squares, limits, bound)
        new = isfinite(score)
        for k in range(found):
            if new and scores[k] == score:
                new = not points_equal(system, points[best[k] * system[NUMBERS] :], point)
        if new:
            found = insert_best(found, trial, score, best, scores)
    return found


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
        bench[unit_vector_at(rules, ROUNDINGS) :],
        bench[unit_vector_at(rules, SORTED) :],
        variances,
    )
    for u in range(units):
        bench[unit_vector_at(rules, LIMITS) + u] = bench[unit_vector_at(rules, CUTS) + u] * variances[u]


ROUTINES = (
    size_of_subsets,
    next_subset,
    all_alike,
    fit_trials,
    insert_best,
    points_equal,
    best_trials,
    limit_by_noise,
)
