"""What consensus has before its first trial: the rows, their units, and a start where these determine the unknowns."""

from __future__ import annotations

from math import inf

from mbm.target.decisions import ATTEMPTS, FAR
from mbm.target.solver.consensus_description import (
    ANSWERS,
    FORM,
    FORM_AT,
    KIND,
    POINTS_MADE,
    SPHERES,
    SQUARES,
    STARTLESS,
    STARTS,
    SUBSET_SIZE,
    TRIALS_MADE,
    TRIALS_WANTED,
    UNITS_LISTED,
    begun_at,
    form_scratch_at,
    one_side_at,
    point_at,
    progress_at,
    slot_at,
    small_places_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_judge import empty_lists
from mbm.target.solver.consensus_order import median
from mbm.target.solver.consensus_planes import one_sided
from mbm.target.solver.consensus_rows import linearised, unit_squares
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_trials import begin_trials, seldom_in_vain, size_of_subsets
from mbm.target.solver.consensus_units import judge_rounding, list_units, norm_directions
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.equations import load_rows, residuals_at_point
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.workspace import residuals_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def units_of_form(rules: ConstantIntegers) -> Integer:
    """How many units the closed form takes."""
    if rules[FORM] == SPHERES:
        return rules[rules[FORM_AT]] + rules[rules[FORM_AT] + 1]
    return 3


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
    size = units_of_form(rules)
    for one in range(units - size + 1):
        for k in range(size):
            chosen[k] = one + k
        if points_in_closed_form(system, rules, forms, size, chosen, begun, bench, places, target) > 0:
            copied(system[NUMBERS], target, begun)
            return 1
    return 0


def size_where_told(
    system: ConstantIntegers,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The rows linearised at the start in the bench, and the size of subsets there; 0: units leave unknowns open."""
    linearised(system, data, index, columns, bench[begun_at(system, rules) :], work, bench[slot_at(system, rules, 0) :])
    if rules[KIND] == GNC:
        return system[COORDINATES]
    norm_directions(system, rules, units, bench, places)
    return size_of_subsets(system, rules, units, bench, places)


def median_misfit(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    point: ConstantReals,
    work: Reals,
    bench: Reals,
    places: ConstantIntegers,
) -> Real:
    """The median of the units' squared misfits at a point; infinite where most have no value."""
    residuals = work[residuals_at(system, 0) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    residuals_at_point(system, constants, data, index, point, 0, 0, work, residuals)
    unit_squares(rules, places, units, residuals, squares)
    return median(units, squares)


def begun_where_most_fit(
    below: Real,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    forms: ConstantReals,
    starts: ConstantReals,
    units: Integer,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> None:
    """The start in the bench becomes what units one behind the other give with the least median of squared misfits.

    Of at most `ATTEMPTS` such, if its median is less than ``below`` and all units determine the unknowns there.
    """
    numbers = system[NUMBERS]
    begun = bench[begun_at(system, rules) :]
    best = bench[point_at(system, rules, 2) :]
    found = begun[rules[STARTS] * numbers :]
    chosen = places[small_places_at(system, rules, 0) :]
    size = units_of_form(rules)
    copied(numbers, begun, best)
    attempts = units - size + 1
    if attempts > ATTEMPTS:
        attempts = ATTEMPTS
    for one in range(attempts):
        for k in range(size):
            chosen[k] = one + k
        count = points_in_closed_form(system, rules, forms, size, chosen, starts, bench, places, found)
        for k in range(count):
            own = found[k * numbers :]
            misfit = median_misfit(system, constants, data, index, rules, units, own, work, bench, places)
            if misfit < below:
                copied(numbers, own, begun)
                if size_where_told(system, data, index, columns, rules, units, work, bench, places) > 0:
                    below = misfit
                    copied(numbers, own, best)
    copied(numbers, best, begun)


def begun_where_units_tell(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    forms: ConstantReals,
    starts: ConstantReals,
    units: Integer,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The start in the bench, linearised, and the size of subsets there; 0: all units do not determine the unknowns.

    Where a closed form gives the start, one of the units that it is made of may be grossly wrong. Far off the others
    say nearly the same, so that trials would hardly ever be made of them alone: where a tenth of the subsets that
    are drawn leaves unknowns open there, the start is what fits most units, if it does `FAR`² times better.
    """
    begun = bench[begun_at(system, rules) :]
    copied(rules[STARTS] * system[NUMBERS], starts, begun)
    if rules[STARTLESS] == 1 and begin_anywhere(system, rules, forms, units, bench, places) == 0:
        return 0
    size = size_where_told(system, data, index, columns, rules, units, work, bench, places)
    if rules[STARTLESS] == 0 or rules[KIND] == GNC:
        return size
    below = inf
    if size > 0:
        if seldom_in_vain(system, rules, units, bench, places) == 1:
            return size
        misfit = median_misfit(system, constants, data, index, rules, units, begun, work, bench, places)
        below = misfit / (FAR * FAR)
    begun_where_most_fit(
        below, system, constants, data, index, columns, rules, forms, starts, units, work, bench, places
    )
    return size_where_told(system, data, index, columns, rules, units, work, bench, places)


def begin_agreement(
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
    bench: Reals,
    places: Integers,
    states: Integers,
) -> None:
    """What there is before the first trial: the rows, their units, where to start."""
    for k in range(ANSWERS):
        states[k] = 0
    load_rows(system, data, parameters, weights, work)
    units = list_units(system, data, rules, levels, bench, places)
    begun = bench[begun_at(system, rules) :]
    places[one_side_at(system, rules)] = one_sided(rules, units, forms, bench[form_scratch_at(system, rules) :])
    size = begun_where_units_tell(
        system, constants, data, index, columns, rules, forms, starts, units, work, bench, places
    )
    progress = places[progress_at(system, rules) :]
    progress[UNITS_LISTED] = units
    progress[SUBSET_SIZE] = size
    progress[TRIALS_WANTED] = 0
    progress[TRIALS_MADE] = 0
    progress[POINTS_MADE] = 0
    if size > 0:
        judge_rounding(system, rules, units, begun, bench, places)
        empty_lists(system, rules, places)
        if rules[KIND] != GNC:
            begin_trials(system, rules, units, size, bench, places)
