"""Trials: subsets of units, each fitted, until one is free of the outliers of what the best of them explains."""

from __future__ import annotations

from mbm.target.decisions import MOST_FITS
from mbm.target.solver.consensus_description import (
    COMPONENTS,
    CUTS,
    EVERY_SUBSET,
    FIRST,
    FIRST_STATE,
    FORM,
    GROUPS,
    KIND,
    LIMITS,
    MOST_INSIDE,
    MOST_POINTS,
    ORDER,
    POINTS_MADE,
    SECOND_STATE,
    STARTS,
    SUBSET_SIZE,
    TRIALS_AT,
    TRIALS_MADE,
    TRIALS_WANTED,
    UNITS_LISTED,
    UNTIL_ENOUGH,
    UNTIL_SURE,
    basis_at,
    directions_at,
    place_vector_at,
    progress_at,
    small_places_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_draw import (
    FEWEST_TRIALS,
    combinations_of,
    drawn_below,
    jump_to_next_trial,
    next_combination,
    subset_drawn,
    subset_taken,
    trials_for_share,
    unit_added,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_judge import judge_trials
from mbm.target.solver.consensus_subset import fitted_to_subset, gather_subset
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals

DRAWS = 40
"""Subsets that are looked at: so many cost what a few trials do, and most often show what befalls a tenth of them."""


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


def seldom_in_vain(
    system: ConstantIntegers, rules: ConstantIntegers, units: Integer, bench: Reals, places: Integers
) -> Integer:
    """Whether less than a tenth of `DRAWS` subsets of units drawn at random leave unknowns open at the start."""
    n = system[COORDINATES]
    state = places[small_places_at(system, rules, 2) + 2 :]
    first = places[place_vector_at(rules, FIRST) :]
    order = places[place_vector_at(rules, ORDER) :]
    rows = bench[directions_at(system, rules) :]
    basis = bench[basis_at(system, rules) :]
    for i in range(units):
        order[i] = i
    vain = 0
    for _ in range(DRAWS):
        rank = 0
        for position in range(n if n < units else units):
            other = position + drawn_below(state, units - position)
            unit = order[other]
            order[other] = order[position]
            order[position] = unit
            before = rank
            rank = unit_added(unit, rank, n, first, rows, basis)
            if (rank - before) * (n - rank) == 0:  # enough, or one that says nothing new
                break
        if rank < n:
            vain += 1
    return 10 * vain < DRAWS


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


def fit_subset(
    trial: Integer,
    trials: Integer,
    count: Integer,
    done: Integer,
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
    desk: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """Points that fit the ``count`` chosen units, put behind ``done`` others: how many there are then."""
    numbers = system[NUMBERS]
    target = bench[trials_at(system, rules) :]
    chosen = places[small_places_at(system, rules, 0) :]
    if rules[FORM] != 0:
        here = target[done * numbers :]
        found = points_in_closed_form(system, rules, forms, count, chosen, starts, bench, places, here)
        if found > 0:
            return done + found
    fits = trials * rules[STARTS]
    if fits > MOST_FITS:
        fits = MOST_FITS
    if fits < trials:
        fits = trials
    gather_subset(system, data, parameters, weights, index, columns, rules, count, chosen, desk, bench, places)
    turn = 0
    while turn * trials + trial < fits and done < rules[MOST_POINTS] - 4:
        start = starts[(turn + trial) % rules[STARTS] * numbers :]
        fitted_to_subset(system, constants, rules, start, desk, bench, places, target[done * numbers :])
        done += 1
        turn += 1
        if rules[FORM] != 0:
            break
    return done


def begin_trials(
    system: ConstantIntegers, rules: ConstantIntegers, units: Integer, size: Integer, bench: Reals, places: Integers
) -> None:
    """None is made yet: the number that is wanted, and the generator or the first combination."""
    progress = places[progress_at(system, rules) :]
    trials = rules[rules[TRIALS_AT] + size]
    most = combinations_of(units, size, trials)
    progress[EVERY_SUBSET] = 0
    progress[UNTIL_ENOUGH] = rules[UNTIL_SURE]
    if most <= trials:
        trials = most
        progress[UNTIL_ENOUGH] = 0
        progress[EVERY_SUBSET] = all_alike(rules, units, places)
    progress[TRIALS_WANTED] = trials
    progress[TRIALS_MADE] = 0
    progress[POINTS_MADE] = 0
    progress[MOST_INSIDE] = 0
    state = places[small_places_at(system, rules, 2) :]
    state[0] = rules[FIRST_STATE]
    state[1] = rules[SECOND_STATE]
    for i in range(size):
        places[small_places_at(system, rules, 1) + i] = i
    copied(units, bench[unit_vector_at(rules, CUTS) :], bench[unit_vector_at(rules, LIMITS) :])


def fit_trials(
    most: Integer,
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
    work: Reals,
    desk: Reals,
    bench: Reals,
    places: Integers,
    answer: Integers,
) -> None:
    """``most`` trials more: points that fit subsets, from the ``starts`` (STARTS, N) where no closed form does.

    Where the noise is stated they are judged as they are made, and end when they are enough. ``answer`` (1,) counts
    the subsets; the progress is among the places.
    """
    progress = places[progress_at(system, rules) :]
    units = progress[UNITS_LISTED]
    size = progress[SUBSET_SIZE]
    trials = progress[TRIALS_WANTED]
    first = progress[TRIALS_MADE]
    last = first + most
    if last > trials:
        last = trials
    for trial in range(first, last):
        count = next_subset(progress[EVERY_SUBSET], size, system, rules, units, bench, places)
        before = progress[POINTS_MADE]
        done = before
        if count > 0 and done < rules[MOST_POINTS] - 4:
            answer[0] += 1
            # fmt: off
            done = fit_subset(
                trial, trials, count, done, system, constants, data, parameters, weights, index, columns, rules, forms,
                starts, desk, bench, places,
            )
            # fmt: on
        if rules[GROUPS] == 0:
            here = judge_trials(
                rules[KIND], before, done, size, units, system, constants, data, index, rules, work, bench, places
            )
            if here > progress[MOST_INSIDE]:
                progress[MOST_INSIDE] = here
        progress[POINTS_MADE] = done
        progress[TRIALS_MADE] = trial + 1
        if enough_made(system, rules, places) == 1:
            progress[TRIALS_WANTED] = trial + 1
            break


def enough_made(system: ConstantIntegers, rules: ConstantIntegers, places: ConstantIntegers) -> Integer:
    """Whether one of the trials made has met only units of a solution as good as the best, or better."""
    progress = places[progress_at(system, rules) :]
    made = progress[TRIALS_MADE]
    if progress[UNTIL_ENOUGH] == 0 or made < FEWEST_TRIALS or progress[MOST_INSIDE] == 0:
        return 0
    return float(made) >= trials_for_share(progress[MOST_INSIDE], progress[UNITS_LISTED], progress[SUBSET_SIZE])
