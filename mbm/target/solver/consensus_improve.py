"""The best of the trials, improved by fits to the units that they explain; the best of those."""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import CANDIDATES, REFINING_STEPS, SAME_OBJECTIVE, STATED, STILL, WIDE_STEPS
from mbm.target.solver.consensus_description import (
    BY_MEDIAN,
    BY_RULE,
    BY_WIDE_LIMITS,
    CUTS,
    GROUP_OF,
    GROUPS,
    KIND,
    LIMITS,
    LISTS,
    MEDIANS,
    NO_CANDIDATE,
    SCALES,
    SORTED,
    SQUARES,
    VARIANCES,
    best_at,
    candidate_at,
    place_vector_at,
    point_at,
    slot_at,
    small_at,
    trials_at,
    unit_vector_at,
)
from mbm.target.solver.consensus_judge import judge_trials, limit_by_noise, listed
from mbm.target.solver.consensus_order import robust_variance
from mbm.target.solver.consensus_refine import NEARLY_STILL, refined
from mbm.target.solver.consensus_rows import linearised, unit_squares
from mbm.target.solver.consensus_rules import TRIMMED, TRUNCATED
from mbm.target.solver.consensus_scores import LMEDS
from mbm.target.solver.description import CHUNK, COORDINATES, NUMBERS, PLACES_AT
from mbm.target.solver.equations import residuals_at_point
from mbm.target.solver.linear_algebra import copied
from mbm.target.solver.workspace import residuals_at
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals


def put_candidate(
    system: ConstantIntegers, rules: ConstantIntegers, number: Integer, units: Integer, objective: Reals, bench: Reals
) -> None:
    """Point 0 and its squares as a candidate with an objective (1,)."""
    target = bench[candidate_at(system, rules, number) :]
    target[0] = objective[0]
    copied(system[NUMBERS], bench[point_at(system, rules, 0) :], target[1:])
    copied(units, bench[unit_vector_at(rules, SQUARES) :], target[1 + system[NUMBERS] :])


def merged_lists(
    system: ConstantIntegers, rules: ConstantIntegers, target: Integer, other: Integer, places: Integers
) -> None:
    """What one list of the best has more than another, put behind that one's, up to `CANDIDATES` of each."""
    best = places[best_at(system, rules) :]
    counts = best[LISTS * CANDIDATES :]
    mine = best[target * CANDIDATES :]
    theirs = best[other * CANDIDATES :]
    found = counts[target]
    kept = found
    for k in range(counts[other]):
        new = 1
        for i in range(found):
            if mine[i] == theirs[k]:
                new = 0
        if new == 1:
            mine[kept] = theirs[k]
            kept += 1
    counts[target] = kept


def scored_candidates(
    units: Integer,
    scalars: Integer,
    size: Integer,
    judged_before: Integer,
    count: Integer,
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """The best of the trials by the rule's score, and with wide limits, and by the least median if noise is unknown.

    How many: their numbers stand at `best_at`. So many trials have been judged before.
    """
    best = places[best_at(system, rules) :]
    if count <= CANDIDATES:
        for k in range(count):
            best[k] = k
        return count
    copied(units, bench[unit_vector_at(rules, CUTS) :], bench[unit_vector_at(rules, LIMITS) :])
    kind = rules[KIND]
    if rules[GROUPS] > 0:
        judge_trials(LMEDS, 0, count, size, units, system, constants, data, index, rules, work, bench, places)
        if kind != LMEDS and listed(system, rules, BY_MEDIAN, places) > 0:
            point = bench[trials_at(system, rules) + best[BY_MEDIAN * CANDIDATES] * system[NUMBERS] :]
            limit_by_noise(system, data, constants, index, rules, units, scalars, point, work, bench, places)
        judged_before = 0
    if kind == LMEDS:
        if rules[GROUPS] == 0:
            # fmt: off
            judge_trials(
                kind, judged_before, count, size, units, system, constants, data, index, rules, work, bench, places
            )
            # fmt: on
        merged_lists(system, rules, BY_RULE, BY_MEDIAN, places)
    else:
        judge_trials(
            kind, judged_before, count, size, units, system, constants, data, index, rules, work, bench, places
        )
        merged_lists(system, rules, BY_RULE, BY_WIDE_LIMITS, places)
        # The rule needs the noise; where that is unknown, trials with the least median may be the ones that know it.
        merged_lists(system, rules, BY_RULE, BY_MEDIAN, places)
    return listed(system, rules, BY_RULE, places)


def widen_for_point(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    rules: ConstantIntegers,
    units: Integer,
    scalars: Integer,
    work: Reals,
    bench: Reals,
    places: Integers,
) -> Integer:
    """Limits as wide as the units scatter about point 0 of the bench; 0 where they are no wider than they were."""
    limits = bench[unit_vector_at(rules, LIMITS) :]
    cuts = bench[unit_vector_at(rules, CUTS) :]
    squares = bench[unit_vector_at(rules, SQUARES) :]
    residuals = work[residuals_at(system, 0) :]
    residuals_at_point(system, constants, data, index, bench[point_at(system, rules, 0) :], 0, 0, work, residuals)
    unit_squares(rules, places, units, residuals, squares)
    own = robust_variance(
        units,
        scalars,
        system[COORDINATES],
        squares,
        bench[unit_vector_at(rules, MEDIANS) :],
        places[place_vector_at(rules, GROUP_OF) :],
        STATED,
        bench[unit_vector_at(rules, SORTED) :],
    )
    for u in range(units):
        limits[u] = cuts[u] * max(own, 1.0)
    return own > 1.0


def improve_one(
    wide: Integer,
    found: Integer,
    units: Integer,
    scalars: Integer,
    size: Integer,
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
    """How many candidates there are with what point 0 leads to, ``found`` of them before; ``wide`` 1: in two stages."""
    rule = TRIMMED if rules[GROUPS] > 0 else TRUNCATED
    if wide == 1:
        if widen_for_point(system, constants, data, index, rules, units, scalars, work, bench, places) == 0:
            return found  # this way has been gone
        # fmt: off
        refined(
            rule, WIDE_STEPS, NEARLY_STILL, size, units, 0, 0, system, constants, data, index, columns, rules, work,
            bench, places, answer,
        )
        # fmt: on
    copied(units, bench[unit_vector_at(rules, CUTS) :], bench[unit_vector_at(rules, LIMITS) :])
    # fmt: off
    alike = refined(
        rule, REFINING_STEPS, STILL, size, units, 0, found, system, constants, data, index, columns, rules, work, bench,
        places, answer,
    )
    # fmt: on
    if alike == NO_CANDIDATE and isfinite(answer[0]):
        put_candidate(system, rules, found, units, answer, bench)
        return found + 1
    return found


def improve(
    units: Integer,
    scalars: Integer,
    size: Integer,
    count: Integer,
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
    """Candidates after fits to the units that they explain, no end twice: how many; ``count`` trials are improved."""
    best = places[best_at(system, rules) :]
    scale = bench[small_at(system, rules, SCALES) :]
    trials = bench[trials_at(system, rules) :]
    for j in range(system[COORDINATES]):
        scale[j] = 1.0
    for u in range(units):
        bench[unit_vector_at(rules, VARIANCES) + u] = 1.0
    found = 0
    for way in range(2):
        for k in range(count):
            copied(system[NUMBERS], trials[best[k] * system[NUMBERS] :], bench[point_at(system, rules, 0) :])
            found = improve_one(
                way,
                found,
                units,
                scalars,
                size,
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
        if rules[GROUPS] > 0:
            break
    return found


def best_candidate(
    count: Integer,
    system: ConstantIntegers,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    rules: ConstantIntegers,
    start: ConstantReals,
    work: Reals,
    bench: Reals,
) -> Integer:
    """The candidate with the lowest objective; of equals (mirrored ones, say) the nearest to the start (N,)."""
    n = system[COORDINATES]
    chunk = bench[slot_at(system, rules, 0) :]
    scale = bench[small_at(system, rules, SCALES) :]
    rows = linearised(system, data, index, columns, start, work, chunk)
    for j in range(n):
        total = 0.0
        for i in range(rows):
            slope = chunk[j * system[CHUNK] + i]
            if isfinite(slope):
                total += slope * slope
        scale[j] = sqrt(total)
    lowest = bench[candidate_at(system, rules, 0)]
    for k in range(1, count):
        lowest = min(bench[candidate_at(system, rules, k)], lowest)
    reach = lowest + SAME_OBJECTIVE * max(fabs(lowest), 1.0)
    best = 0
    nearest = -1.0
    for k in range(count):
        own = bench[candidate_at(system, rules, k) :]
        if own[0] <= reach:
            away = 0.0
            for j in range(n):
                place = system[system[PLACES_AT] + j]
                if place >= 0:
                    difference = (own[1 + place] - start[place]) * scale[j]
                    away += difference * difference
            if nearest < 0.0 or away < nearest:
                nearest = away
                best = k
    return best
