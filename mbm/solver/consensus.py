"""Consensus of one data set after the other: the units that agree, found from many minimal subsets.

Trials from minimal subsets (and by graduated non-convexity), the best few improved by fits to what they explain, the
best of those brought to the fixed point of fit, noise and inliers.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer
from mbm.solver.chi_square import inform_units
from mbm.solver.consensus_begin import begin_consensus
from mbm.solver.consensus_fixed_point import finished, rival
from mbm.solver.consensus_records import (
    ANSWERS,
    BY_MEDIAN,
    BY_RULE,
    BY_WIDE_LIMITS,
    NO_CANDIDATE,
    NOWHERE,
    ConsensusBatch,
    ConsensusWork,
    Verdict,
)
from mbm.solver.consensus_refine import NEARLY_STILL, TRIMMED, TRUNCATED, gnc_fit, refined
from mbm.solver.consensus_scores import GNC, LMEDS, robust_variance, variances_at
from mbm.solver.consensus_trials import fit_trials, limit_by_noise, score_trials
from mbm.solver.consensus_units import linearised, squares_at
from mbm.solver.decisions import (
    CANDIDATES,
    FEW_STARTS,
    LARGE_SUBSET,
    REFINING_STEPS,
    SAME_OBJECTIVE,
    STATED,
    STILL,
    WIDE_STEPS,
)
from mbm.solver.description import DataSet, Problem
from mbm.solver.linear_algebra import copied, filled, numbered


def put_trial(number: Integer, point: ConstantReals, problem: Problem, work: ConsensusWork) -> None:
    """A point among those that are scored."""
    copied(problem.numbers, point, work.trials[number * problem.numbers :])


def trials_by_gnc(count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Trials by graduated non-convexity from the starts in the work, put behind ``count`` others: how many then."""
    for k in range(work.rules.starts):
        for absolute in range(2):
            if k < FEW_STARTS:
                copied(problem.numbers, work.begun[k * problem.numbers :], work.here.point)
                gnc_fit(absolute, problem, work)
                put_trial(count, work.here.point, problem, work)
                count += 1
    return count


def refine_candidate(best: Integer, count: Integer, problem: Problem, work: ConsensusWork) -> None:
    """The best of the candidates brought to its fixed point, and what is to be said of it."""
    units = work.units
    copied(problem.numbers, work.candidates[best * problem.numbers :], work.here.point)
    if work.rules.groups > 0:
        own = work.candidate_squares[best * units.count :]
        variances_at(units, work.spent, work.rules.groups, own, work.sorted, units.variances)
    work.verdict.ambiguous = rival(best, count, work)
    work.verdict.inliers = finished(problem, work)
    if work.verdict.inliers > 0:
        work.verdict.agreed = 1


def settle_near_start(problem: Problem, work: ConsensusWork) -> None:
    """The start, which some of the units agree with already, brought to the fixed point of all of them."""
    units = work.units
    here = work.here
    copied(problem.numbers, work.begun, here.point)
    squares_at(problem, here.point, work, here.squares)
    variances_at(units, work.spent, work.rules.groups, here.squares, work.sorted, units.variances)
    work.verdict.inliers = finished(problem, work)
    if work.verdict.inliers > 0:
        work.verdict.agreed = 1


def end_consensus(problem: Problem, work: ConsensusWork) -> None:
    """The best of the trials that were made, improved and brought to its fixed point."""
    if work.size == NOWHERE:
        return
    if work.rules.near == 1:
        settle_near_start(problem, work)
        return
    kind = work.rules.kind
    judged = work.points_made
    count = 0
    if kind != GNC or work.rules.groups == 0:  # without stated noise, fits to all units come first
        for k in range(work.rules.starts):
            put_trial(judged + k, work.begun[k * problem.numbers :], problem, work)
        count = judged + work.rules.starts
    if kind == GNC or work.size >= LARGE_SUBSET:
        count = trials_by_gnc(count, problem, work)
    count = scored_candidates(judged, count, problem, work)
    count = improve(count, problem, work)
    if count > 0:
        refine_candidate(best_candidate(count, work.begun, problem, work), count, problem, work)


def find_consensus(problem: Problem, work: ConsensusWork) -> None:
    """The units of one data set that agree: where is the point of `here`, what is to be said of it the verdict.

    `inside`, `limits` and `noise` say of each unit whether it does, its limit and its variance.
    """
    begin_consensus(problem, work)
    fit_trials(work.trials_wanted, problem, work)
    end_consensus(problem, work)


def take_data_set(number: Integer, every: ConsensusBatch) -> None:
    """Let the work be for one of many data sets."""
    work = every.work
    rules = work.rules
    work.rows.data = view(DataSet, every.data[number * every.stride :])
    work.forms = every.forms[every.units_at[number] * rules.form_width :]
    work.starts = every.starts[number * rules.starts * rules.numbers :]
    work.verdict = view(Verdict, every.verdicts[number * ANSWERS :])


def put_answers(number: Integer, every: ConsensusBatch) -> None:
    """What one data set agrees on: its point, the first start where it does not, and its units."""
    work = every.work
    units = work.units
    first = every.units_at[number]
    point = every.numbers[number * work.rules.numbers :]
    copied(work.rules.numbers, work.starts, point)
    if work.verdict.agreed == 1:
        copied(work.rules.numbers, work.here.point, point)
        inform_units(units, work.rules.groups, work.here.squares)
    for u in range(units.count):
        every.inlier[first + u] = units.inlier[u]
        every.limits[first + u] = units.limits[u]
        every.noise[first + u] = units.noise[u]
        every.information[first + u] = units.information[u] if work.verdict.agreed == 1 else 1.0


def consensus_in_portions(most: Integer, begin: Integer, end: Integer, every: ConsensusBatch) -> Integer:
    """The first data set in portions of ``most`` trials, the first of which has ``begin`` 1, as `consensus_many`.

    ``end`` 1: no more trials, but the best of those there are. How many trials are still to be made.
    """
    work = every.work
    if begin == 1:
        take_data_set(0, every)
        begin_consensus(every.problem, work)
    if end == 0:
        fit_trials(most, every.problem, work)
    else:
        end_consensus(every.problem, work)
        put_answers(0, every)
    return work.trials_wanted - work.trials_made


def consensus_many(every: ConsensusBatch) -> None:
    """The data sets, each by itself."""
    for k in range(every.first, every.last):
        take_data_set(k, every)
        find_consensus(every.problem, every.work)
        put_answers(k, every)


def put_candidate(number: Integer, problem: Problem, work: ConsensusWork) -> None:
    """The point where the fit is, and its squares, as a candidate with the objective."""
    units = work.units.count
    work.objectives[number] = work.objective
    copied(problem.numbers, work.here.point, work.candidates[number * problem.numbers :])
    copied(units, work.here.squares, work.candidate_squares[number * units :])


def merged_lists(target: Integer, other: Integer, work: ConsensusWork) -> None:
    """What one list of the best has more than another, put behind that one's, up to `CANDIDATES` of each."""
    mine = work.best[target * CANDIDATES :]
    theirs = work.best[other * CANDIDATES :]
    found = work.listed[target]
    kept = found
    for k in range(work.listed[other]):
        new = 1
        for i in range(found):
            if mine[i] == theirs[k]:
                new = 0
        if new == 1:
            mine[kept] = theirs[k]
            kept += 1
    work.listed[target] = kept


def scored_candidates(scored_before: Integer, count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """The best of the trials by the rule's score, and with wide limits, and by the least median if noise is unknown.

    How many there are in the list by the rule. So many trials have been judged before.
    """
    units = work.units
    rules = work.rules
    if count <= CANDIDATES:
        numbered(count, work.best)
        return count
    copied(units.count, units.cuts, units.limits)
    kind = rules.kind
    if rules.groups > 0:
        score_trials(LMEDS, 0, count, problem, work)
        if kind != LMEDS and work.listed[BY_MEDIAN] > 0:
            limit_by_noise(problem, work.trials[work.best[BY_MEDIAN * CANDIDATES] * problem.numbers :], work)
        scored_before = 0
    if kind == LMEDS:
        if rules.groups == 0:
            score_trials(kind, scored_before, count, problem, work)
        merged_lists(BY_RULE, BY_MEDIAN, work)
    else:
        score_trials(kind, scored_before, count, problem, work)
        merged_lists(BY_RULE, BY_WIDE_LIMITS, work)
        # The rule needs the noise; where that is unknown, trials with the least median may be the ones that know it.
        merged_lists(BY_RULE, BY_MEDIAN, work)
    return work.listed[BY_RULE]


def widen_for_point(problem: Problem, work: ConsensusWork) -> Integer:
    """Limits as wide as the units scatter about the point; 0 where they are no wider than they were."""
    units = work.units
    here = work.here
    squares_at(problem, here.point, work, here.squares)
    own = robust_variance(units, work.spent, here.squares, STATED, work.sorted)
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * max(own, 1.0)
    return own > 1.0


def improve_one(wide: Integer, found: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Candidates with what the point leads to: how many, ``found`` of them before; ``wide`` 1: in two stages."""
    units = work.units
    rule = TRIMMED if work.rules.groups > 0 else TRUNCATED
    if wide == 1:
        if widen_for_point(problem, work) == 0:
            return found  # this way has been gone
        refined(rule, WIDE_STEPS, NEARLY_STILL, 0, problem, work)
    copied(units.count, units.cuts, units.limits)
    alike = refined(rule, REFINING_STEPS, STILL, found, problem, work)
    if alike == NO_CANDIDATE and isfinite(work.objective):
        put_candidate(found, problem, work)
        return found + 1
    return found


def improve(count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Candidates after fits to the units that they explain, no end twice: how many; ``count`` trials are improved."""
    filled(problem.n, 1.0, work.scale)
    filled(work.units.count, 1.0, work.units.variances)
    found = 0
    for way in range(2):
        for k in range(count):
            copied(problem.numbers, work.trials[work.best[k] * problem.numbers :], work.here.point)
            found = improve_one(way, found, problem, work)
        if work.rules.groups > 0:
            break
    return found


def best_candidate(count: Integer, start: ConstantReals, problem: Problem, work: ConsensusWork) -> Integer:
    """The candidate with the lowest objective; of equals (mirrored ones, say) the nearest to the start (N,)."""
    n = problem.n
    chunk = work.here.chunk
    scale = work.scale
    objectives = work.objectives
    rows = linearised(problem, work.rows, start, work, chunk)
    for j in range(n):
        total = 0.0
        for i in range(rows):
            slope = chunk[j * problem.chunk + i]
            if isfinite(slope):
                total += slope * slope
        scale[j] = sqrt(total)
    lowest = objectives[0]
    for k in range(1, count):
        lowest = min(objectives[k], lowest)
    reach = lowest + SAME_OBJECTIVE * max(fabs(lowest), 1.0)
    best = 0
    nearest = -1.0
    for k in range(count):
        if objectives[k] <= reach:
            own = work.candidates[k * problem.numbers :]
            away = 0.0
            for j in range(n):
                place = problem.number_of[j]
                if place >= 0:
                    difference = (own[place] - start[place]) * scale[j]
                    away += difference * difference
            if nearest < 0.0 or away < nearest:
                nearest = away
                best = k
    return best
