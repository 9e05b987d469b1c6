"""Consensus of one data set after the other: the units that agree, found from many minimal subsets.

Trials from minimal subsets (and by graduated non-convexity), the best few improved by fits to what they explain, the
best of those brought to the fixed point of fit, noise and inliers.
"""

from __future__ import annotations

from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer
from mbm.solver.consensus_begin import begin_consensus
from mbm.solver.consensus_fixed_point import finished, rival
from mbm.solver.consensus_gnc import gnc_fit
from mbm.solver.consensus_improve import best_candidate, improve, scored_candidates
from mbm.solver.consensus_order import variances_at
from mbm.solver.consensus_records import ANSWERS, NOWHERE, ConsensusBatch, ConsensusWork, Verdict
from mbm.solver.consensus_rows import squares_at
from mbm.solver.consensus_scores import GNC
from mbm.solver.consensus_trials import fit_trials
from mbm.solver.decisions import FEW_STARTS, LARGE_SUBSET
from mbm.solver.description import DataSet, Problem
from mbm.solver.linear_algebra import copied


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
        variances_at(units, problem.n, work.rules.groups, own, work.sorted, units.variances)
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
    variances_at(units, problem.n, work.rules.groups, here.squares, work.sorted, units.variances)
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
    if kind != GNC:
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
    for u in range(units.count):
        every.inlier[first + u] = units.inlier[u]
        every.limits[first + u] = units.limits[u]
        every.noise[first + u] = units.noise[u]


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
