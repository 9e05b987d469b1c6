"""Consensus of one data set after the other: the units that agree, as `mbm.solution.robust.agree` finds them.

Trials from minimal subsets (and by graduated non-convexity), the best few improved by fits to what they explain, the
best of those brought to the fixed point of fit, noise and inliers.
"""

from __future__ import annotations

from mbm.target.decisions import FEW_STARTS, LARGE_SUBSET
from mbm.target.records import view
from mbm.target.solver.consensus_begin import begin_agreement
from mbm.target.solver.consensus_description import ANSWERS, Agreements, Bench, Verdict
from mbm.target.solver.consensus_graduate import graduated
from mbm.target.solver.consensus_improve import best_candidate, improve, scored_candidates
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_scores import GNC
from mbm.target.solver.consensus_settle import finished, rival
from mbm.target.solver.consensus_trials import fit_trials
from mbm.target.solver.description import DataSet, Problem
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import ConstantReals, Integer


def put_trial(number: Integer, point: ConstantReals, system: Problem, bench: Bench) -> None:
    """A point among those that are scored."""
    copied(system.numbers, point, bench.trials[number * system.numbers :])


def graduate_trials(count: Integer, system: Problem, bench: Bench) -> Integer:
    """Trials by graduated non-convexity from the starts in the bench, put behind ``count`` others: how many then."""
    for k in range(bench.rules.starts):
        for absolute in range(2):
            if k < FEW_STARTS:
                copied(system.numbers, bench.begun[k * system.numbers :], bench.here.point)
                graduated(absolute, system, bench)
                put_trial(count, bench.here.point, system, bench)
                count += 1
    return count


def settle_candidate(best: Integer, count: Integer, system: Problem, bench: Bench) -> None:
    """The best of the candidates brought to its fixed point, and what is to be said of it."""
    units = bench.units
    copied(system.numbers, bench.candidates[best * system.numbers :], bench.here.point)
    if bench.rules.groups > 0:
        own = bench.candidate_squares[best * units.count :]
        variances_at(units, system.n, bench.rules.groups, own, bench.sorted, units.variances)
    bench.verdict.ambiguous = rival(best, count, bench)
    bench.verdict.inliers = finished(system, bench)
    if bench.verdict.inliers > 0:
        bench.verdict.agreed = 1


def end_agreement(system: Problem, bench: Bench) -> None:
    """The best of the trials that were made, improved and brought to its fixed point."""
    if bench.size == 0:
        return
    kind = bench.rules.kind
    judged = bench.points_made
    count = 0
    if kind != GNC:
        for k in range(bench.rules.starts):
            put_trial(judged + k, bench.begun[k * system.numbers :], system, bench)
        count = judged + bench.rules.starts
    if kind == GNC or bench.size >= LARGE_SUBSET:
        count = graduate_trials(count, system, bench)
    count = scored_candidates(judged, count, system, bench)
    count = improve(count, system, bench)
    if count > 0:
        settle_candidate(best_candidate(count, bench.begun, system, bench), count, system, bench)


def agree(system: Problem, bench: Bench) -> None:
    """The units of one data set that agree: where is the point of `here`, what is to be said of it the verdict.

    `inside`, `limits` and `noise` say of each unit whether it does, its limit and its variance.
    """
    begin_agreement(system, bench)
    fit_trials(bench.trials_wanted, system, bench)
    end_agreement(system, bench)


def take_data_set(number: Integer, every: Agreements) -> None:
    """Let the bench be for one of many data sets."""
    bench = every.bench
    rules = bench.rules
    bench.rows.data = view(DataSet, every.data[number * every.stride :])
    bench.forms = every.forms[every.units_at[number] * rules.form_width :]
    bench.starts = every.starts[number * rules.starts * rules.numbers :]
    bench.verdict = view(Verdict, every.verdicts[number * ANSWERS :])


def put_answers(number: Integer, every: Agreements) -> None:
    """What one data set agrees on: its point, the first start where it does not, and its units."""
    bench = every.bench
    units = bench.units
    first = every.units_at[number]
    point = every.numbers[number * bench.rules.numbers :]
    copied(bench.rules.numbers, bench.starts, point)
    if bench.verdict.agreed == 1:
        copied(bench.rules.numbers, bench.here.point, point)
    for u in range(units.count):
        every.inside[first + u] = units.inside[u]
        every.limits[first + u] = units.limits[u]
        every.noise[first + u] = units.noise[u]


def agree_by_and_by(most: Integer, begin: Integer, end: Integer, every: Agreements) -> Integer:
    """The first data set in portions of ``most`` trials, the first of which has ``begin`` 1, as `agree_many` takes it.

    ``end`` 1: no more trials, but the best of those there are. How many trials are still to be made.
    """
    bench = every.bench
    if begin == 1:
        take_data_set(0, every)
        begin_agreement(every.problem, bench)
    if end == 0:
        fit_trials(most, every.problem, bench)
    else:
        end_agreement(every.problem, bench)
        put_answers(0, every)
    return bench.trials_wanted - bench.trials_made


def agree_many(every: Agreements) -> None:
    """The data sets, each by itself."""
    for k in range(every.first, every.last):
        take_data_set(k, every)
        agree(every.problem, every.bench)
        put_answers(k, every)
