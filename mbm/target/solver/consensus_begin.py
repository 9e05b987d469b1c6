"""What consensus has before its first trial: the rows, their units, and a start where these determine the unknowns."""

from __future__ import annotations

from mbm.target.decisions import ATTEMPTS
from mbm.target.solver.consensus_description import (
    ANSWERS,
    FORM,
    FORM_AT,
    KIND,
    POINTS_MADE,
    SPHERES,
    STARTLESS,
    STARTS,
    SUBSET_SIZE,
    TRIALS_MADE,
    TRIALS_WANTED,
    UNITS_LISTED,
    begun_at,
    form_scratch_at,
    one_side_at,
    progress_at,
    slot_at,
    small_places_at,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_judge import empty_lists
from mbm.target.solver.consensus_planes import one_sided
from mbm.target.solver.consensus_rows import linearised
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_trials import begin_trials, size_of_subsets
from mbm.target.solver.consensus_units import judge_rounding, list_units, norm_directions
from mbm.target.solver.description import COORDINATES, NUMBERS
from mbm.target.solver.equations import load_rows
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


def begin_anywhere(
    first: Integer,
    system: ConstantIntegers,
    rules: ConstantIntegers,
    forms: ConstantReals,
    units: Integer,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The first point that units one behind the other give in closed form as the start in the bench, from ``first`` on.

    Where to go on from if that is no good is given; 0 if none give a point.
    """
    begun = bench[begun_at(system, rules) :]
    target = begun[rules[STARTS] * system[NUMBERS] :]
    chosen = places[small_places_at(system, rules, 0) :]
    size = 3
    if rules[FORM] == SPHERES:
        size = rules[rules[FORM_AT]] + rules[rules[FORM_AT] + 1]
    for one in range(first, units - size + 1):
        for k in range(size):
            chosen[k] = one + k
        if points_in_closed_form(system, rules, forms, size, chosen, begun, bench, places, target) > 0:
            copied(system[NUMBERS], target, begun)
            return one + 1
    return 0


def begun_where_units_tell(
    system: ConstantIntegers,
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

    Far off all of them say the same: where a closed form gives the start, and one of the units that it is made of is
    grossly wrong, the next ones do.
    """
    begun = bench[begun_at(system, rules) :]
    following = 0
    size = 0
    for _ in range(ATTEMPTS):
        copied(rules[STARTS] * system[NUMBERS], starts, begun)
        if rules[STARTLESS] == 1:
            following = begin_anywhere(following, system, rules, forms, units, bench, places)
            if following == 0:
                return 0
        linearised(system, data, index, columns, begun, work, bench[slot_at(system, rules, 0) :])
        if rules[KIND] == GNC:
            size = system[COORDINATES]
        else:
            norm_directions(system, rules, units, bench, places)
            size = size_of_subsets(system, rules, units, bench, places)
        if size > 0 or rules[STARTLESS] == 0:
            break
    return size


def begin_agreement(
    system: ConstantIntegers,
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
    size = begun_where_units_tell(system, data, index, columns, rules, forms, starts, units, work, bench, places)
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


ROUTINES = (begin_anywhere, begun_where_units_tell, begin_agreement)
