"""Consensus of one data set after the other: the units that agree, as `mbm.solution.robust.agree` finds them.

Trials from minimal subsets (and by graduated non-convexity), the best few improved by fits to what they explain, the
best of those brought to the fixed point of fit, noise and inliers.
"""

from __future__ import annotations

from mbm.target.solver.consensus_description import (
    AGREED,
    AMBIGUOUS,
    ANSWERS,
    FEW_STARTS,
    FIRST,
    FORM,
    FORM_AT,
    FORM_WIDTH,
    GROUP_OF,
    GROUPS,
    INLIERS,
    INSIDE,
    KIND,
    LIMITS,
    MEDIANS,
    NOISE,
    OBJECTIVE,
    ROUNDINGS,
    SORTED,
    SPHERES,
    STARTLESS,
    STARTS,
    TRIALS,
    VARIANCES,
    begun_at,
    candidate_at,
    form_scratch_at,
    one_side_at,
    place_vector_at,
    point_at,
    slot_at,
    small_at,
    small_places_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_graduate import graduated
from mbm.target.solver.consensus_improve import best_candidate, improve, scored_candidates
from mbm.target.solver.consensus_judge import empty_lists
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_planes import one_sided
from mbm.target.solver.consensus_rows import linearised
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_settle import finished, rival
from mbm.target.solver.consensus_trials import fit_trials, size_of_subsets
from mbm.target.solver.consensus_units import judge_rounding, list_units, norm_directions
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.equations import load_rows
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals

LARGE_SUBSET = 7
"""From so many units in a subset on, trials free of outliers are rare: graduated non-convexity gives one more."""


def put_trial(
    system: ConstantIntegers, rules: ConstantIntegers, number: Integer, point: ConstantReals, bench: Reals
) -> None:
    """A point among those that are scored."""
    copied(system[NUMBERS], point, bench[trials_at(system, rules) + number * system[NUMBERS] :])


def put_trials(
    system: ConstantIntegers, rules: ConstantIntegers, number: Integer, points: ConstantReals, bench: Reals
) -> Integer:
    """All the starts likewise, behind ``number`` points: how many there are then."""
    for k in range(rules[STARTS]):
        put_trial(system, rules, number + k, points[k * system[NUMBERS] :], bench)
    return number + rules[STARTS]


def begin_anywhere(
    system: ConstantIntegers,
    rules: ConstantIntegers,
    forms: ConstantReals,
    units: Integer,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The first point that units one behind the other give in closed form as the start in the bench; 0 if none do."""
    begun = bench[begun_at(system, rules) :]
    target = begun[rules[STARTS] * system[NUMBERS] :]
    chosen = places[small_places_at(system, rules, 0) :]
    size = 3
    if rules[FORM] == SPHERES:
        size = rules[rules[FORM_AT]] + rules[rules[FORM_AT] + 1]
    for first in range(units - size + 1):
        for k in range(size):
            chosen[k] = first + k
        if points_in_closed_form(system, rules, forms, size, chosen, begun, bench, places, target) > 0:
            copied(system[NUMBERS], target, begun)
            return 1
    return 0


def graduate_trials(
    count: Integer,
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
    """Trials by graduated non-convexity from the starts in the bench, put behind ``count`` others: how many then."""
    begun = bench[begun_at(system, rules) :]
    for k in range(rules[STARTS]):
        for absolute in range(2):
            if k < FEW_STARTS:
                copied(system[NUMBERS], begun[k * system[NUMBERS] :], bench[point_at(system, rules, 0) :])
                graduated(
                    absolute,
                    units,
                    scalars,
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
                put_trial(system, rules, count, bench[point_at(system, rules, 0) :], bench)
                count += 1
    return count


def settle_candidate(
    best: Integer,
    count: Integer,
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
    states: Integers,
) -> None:
    """The best of the candidates brought to its fixed point, and what is to be said of it."""
    own = bench[candidate_at(system, rules, best) + 1 :]
    copied(system[NUMBERS], own, bench[point_at(system, rules, 0) :])
    if rules[GROUPS] > 0:
        variances_at(
            units,
            scalars,
            system[COORDINATES],
            rules[GROUPS],
            own[system[NUMBERS] :],
            bench[unit_vector_at(rules, MEDIANS) :],
            places[place_vector_at(rules, GROUP_OF) :],
            bench[unit_vector_at(rules, ROUNDINGS) :],
            bench[unit_vector_at(rules, SORTED) :],
            bench[unit_vector_at(rules, VARIANCES) :],
        )
    states[AMBIGUOUS] = rival(0, count, best, units, system, rules, bench)
    inliers = finished(units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer)
    states[INLIERS] = inliers
    if inliers > 0:
        states[AGREED] = 1


def agree(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    levels: ConstantReals,
    forms: ConstantReals,
    starts: ConstantReals,
    work: Reals,
    desk: Reals,
    bench: Reals,
    places: Integers,
    states: Integers,
) -> Integer:
    """The units of one data set that agree, from its ``starts``: how many units there are.

    Point 0 of the bench is where they agree, `INSIDE`, `LIMITS` and `NOISE` say of each unit whether it does, its limit
    and its variance. ``states`` (ANSWERS,); `AGREED` is 0 where another method should take over.
    """
    for k in range(ANSWERS):
        states[k] = 0
    load_rows(system, data, parameters, weights, work)
    units = list_units(system, data, rules, levels, bench, places)
    scalars = places[place_vector_at(rules, FIRST) + units]
    answer = bench[small_at(system, rules, OBJECTIVE) :]
    begun = bench[begun_at(system, rules) :]
    places[one_side_at(system, rules)] = one_sided(rules, units, forms, bench[form_scratch_at(system, rules) :])
    copied(rules[STARTS] * system[NUMBERS], starts, begun)
    if rules[STARTLESS] == 1 and begin_anywhere(system, rules, forms, units, bench, places) == 0:
        return units
    linearised(system, data, index, columns, begun, work, bench[slot_at(system, rules, 0) :])
    judge_rounding(system, rules, units, begun, bench, places)
    empty_lists(system, rules, places)
    size = system[COORDINATES]
    count = 0
    judged = 0
    # fmt: off
    if rules[KIND] != GNC:
        norm_directions(system, rules, units, bench, places)
        size = size_of_subsets(system, rules, units, bench, places)
        if size == 0:
            return units
        judged = fit_trials(
            system, constants, data, parameters, weights, index, columns, rules, forms, begun, units, size, work, desk,
            bench, places, states[TRIALS:],
        )
        count = put_trials(system, rules, judged, begun, bench)
    if rules[KIND] == GNC or size >= LARGE_SUBSET:
        count = graduate_trials(
            count, units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer
        )
    count = scored_candidates(
        units, scalars, size, judged, count, system, constants, data, index, rules, work, bench, places
    )
    count = improve(
        units, scalars, size, count, system, constants, data, index, columns, rules, work, bench, places, answer
    )
    # fmt: on
    if count == 0:
        return units
    best = best_candidate(count, system, data, index, columns, rules, begun, work, bench)
    settle_candidate(
        best, count, units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer, states
    )
    return units


def agree_many(
    first: Integer,
    last: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    every_data: ConstantIntegers,
    stride: Integer,
    parameters: ConstantReals,
    weights: ConstantReals,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    levels: ConstantReals,
    units_at: ConstantIntegers,
    forms: ConstantReals,
    starts: ConstantReals,
    work: Reals,
    desk: Reals,
    bench: Reals,
    places: Integers,
    numbers: Reals,
    states: Integers,
    inside: Integers,
    limits: Reals,
    variances: Reals,
) -> None:
    """The data sets ``first … last``, each by itself.

    ``every_data`` has ``stride`` integers of each data set; ``units_at`` says where its units begin in ``forms`` (times
    their width) and in the answers by unit: ``inside``, ``limits`` and ``variances``. ``starts`` are (data sets,
    STARTS, N), ``numbers`` (data sets, N), ``states`` (data sets, ANSWERS).
    """
    for k in range(first, last):
        at = units_at[k]
        own = starts[k * rules[STARTS] * system[NUMBERS] :]
        units = agree(
            system,
            constants,
            every_data[k * stride :],
            parameters,
            weights,
            index,
            columns,
            rules,
            levels,
            forms[at * rules[FORM_WIDTH] :],
            own,
            work,
            desk,
            bench,
            places,
            states[k * ANSWERS :],
        )
        if states[k * ANSWERS + AGREED] == 1:
            copied(system[NUMBERS], bench[point_at(system, rules, 0) :], numbers[k * system[NUMBERS] :])
        else:
            copied(system[NUMBERS], own, numbers[k * system[NUMBERS] :])
        for u in range(units):
            inside[at + u] = places[place_vector_at(rules, INSIDE) + u]
            limits[at + u] = bench[unit_vector_at(rules, LIMITS) + u]
            variances[at + u] = bench[unit_vector_at(rules, NOISE) + u]


ROUTINES = (put_trial, put_trials, begin_anywhere, graduate_trials, settle_candidate, agree, agree_many)
