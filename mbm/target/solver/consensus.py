"""Consensus of one data set after the other: the units that agree, as `mbm.solution.robust.agree` finds them.

Trials from minimal subsets (and by graduated non-convexity), the best few improved by fits to what they explain, the
best of those brought to the fixed point of fit, noise and inliers.
"""

from __future__ import annotations

from mbm.target.decisions import FEW_STARTS, LARGE_SUBSET
from mbm.target.solver.consensus_begin import begin_agreement
from mbm.target.solver.consensus_description import (
    AGREED,
    AMBIGUOUS,
    ANSWERS,
    FIRST,
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
    POINTS_MADE,
    SORTED,
    STARTS,
    SUBSET_SIZE,
    TRIALS,
    TRIALS_WANTED,
    UNIT_ROUNDINGS,
    UNITS_LISTED,
    VARIANCES,
    begun_at,
    candidate_at,
    place_vector_at,
    point_at,
    progress_at,
    small_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_graduate import graduated
from mbm.target.solver.consensus_improve import best_candidate, improve, scored_candidates
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_settle import finished, rival
from mbm.target.solver.consensus_trials import fit_trials
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


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
            bench[unit_vector_at(rules, UNIT_ROUNDINGS) :],
            bench[unit_vector_at(rules, SORTED) :],
            bench[unit_vector_at(rules, VARIANCES) :],
        )
    states[AMBIGUOUS] = rival(0, count, best, units, system, rules, bench)
    inliers = finished(units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer)
    states[INLIERS] = inliers
    if inliers > 0:
        states[AGREED] = 1


def end_agreement(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
    states: Integers,
) -> None:
    """The best of the trials that were made, improved and brought to its fixed point."""
    progress = places[progress_at(system, rules) :]
    units = progress[UNITS_LISTED]
    size = progress[SUBSET_SIZE]
    if size == 0:
        return
    scalars = places[place_vector_at(rules, FIRST) + units]
    answer = bench[small_at(system, rules, OBJECTIVE) :]
    begun = bench[begun_at(system, rules) :]
    judged = progress[POINTS_MADE]
    count = 0
    # fmt: off
    if rules[KIND] != GNC:
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
        return
    best = best_candidate(count, system, data, index, columns, rules, begun, work, bench)
    settle_candidate(
        best, count, units, scalars, system, constants, data, index, columns, rules, work, bench, places, answer, states
    )


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
    # fmt: off
    begin_agreement(
        system, constants, data, parameters, weights, index, columns, rules, levels, forms, starts, work, bench, places,
        states,
    )
    progress = places[progress_at(system, rules) :]
    fit_trials(
        progress[TRIALS_WANTED], system, constants, data, parameters, weights, index, columns, rules, forms,
        bench[begun_at(system, rules) :], work, desk, bench, places, states[TRIALS:],
    )
    end_agreement(system, constants, data, index, columns, rules, work, bench, places, states)
    # fmt: on
    return progress[UNITS_LISTED]


def put_answers(
    units: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    starts: ConstantReals,
    bench: ConstantReals,
    places: ConstantIntegers,
    states: ConstantIntegers,
    numbers: Reals,
    inside: Integers,
    limits: Reals,
    variances: Reals,
) -> None:
    """What one data set agrees on, from the bench: its point, the first start where it does not, and its units."""
    if states[AGREED] == 1:
        copied(system[NUMBERS], bench[point_at(system, rules, 0) :], numbers)
    else:
        copied(system[NUMBERS], starts, numbers)
    for u in range(units):
        inside[u] = places[place_vector_at(rules, INSIDE) + u]
        limits[u] = bench[unit_vector_at(rules, LIMITS) + u]
        variances[u] = bench[unit_vector_at(rules, NOISE) + u]


def agree_by_and_by(
    most: Integer,
    begin: Integer,
    end: Integer,
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
    numbers: Reals,
    states: Integers,
    inside: Integers,
    limits: Reals,
    variances: Reals,
) -> None:
    """One data set in portions of ``most`` trials, the first of which has ``begin`` 1, as `agree_many` takes it whole.

    ``end`` 1: no more trials, but the best of those there are. Between calls everything stays in the scratch arrays.
    """
    # fmt: off
    if begin == 1:
        begin_agreement(
            system, constants, data, parameters, weights, index, columns, rules, levels, forms, starts, work, bench,
            places, states,
        )
    progress = places[progress_at(system, rules) :]
    if end == 0:
        fit_trials(
            most, system, constants, data, parameters, weights, index, columns, rules, forms,
            bench[begun_at(system, rules) :], work, desk, bench, places, states[TRIALS:],
        )
    else:
        end_agreement(system, constants, data, index, columns, rules, work, bench, places, states)
        put_answers(
            progress[UNITS_LISTED], system, rules, starts, bench, places, states, numbers, inside, limits, variances
        )
    # fmt: on


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
        # fmt: off
        put_answers(
            units, system, rules, own, bench, places, states[k * ANSWERS :], numbers[k * system[NUMBERS] :],
            inside[at:], limits[at:], variances[at:],
        )
        # fmt: on
