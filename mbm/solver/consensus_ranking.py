"""How well trials explain the units: the best of them by each score, in lists that grow as trials are made."""

from __future__ import annotations

from math import inf, isfinite

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.consensus_order import variances_at
from mbm.solver.consensus_records import BY_MEDIAN, BY_RULE, BY_WIDE_LIMITS, LISTS, ConsensusWork
from mbm.solver.consensus_rows import squares_at
from mbm.solver.consensus_scores import LMEDS, RANSAC, inlier_count, least_median, outlier_count, truncated
from mbm.solver.decisions import CANDIDATES, WIDE
from mbm.solver.description import Problem
from mbm.solver.trial_steps import same_point


def empty_lists(work: ConsensusWork) -> None:
    """No trial is among the best yet."""
    for k in range(LISTS):
        work.listed[k] = 0


def put_in_list(
    problem: Problem, which: Integer, most: Integer, trial: Integer, score: Real, work: ConsensusWork
) -> None:
    """Put a trial into a list of the best, lowest score first, ``most`` of them; not twice the same point."""
    numbers = work.best[which * CANDIDATES :]
    scores = work.best_scores[which * CANDIDATES :]
    points = work.trials
    count = work.listed[which]
    place = count
    while place > 0 and scores[place - 1] > score:
        place = place - 1
    same = place
    while same > 0 and scores[same - 1] == score:
        same = same - 1
        if same_point(problem, points[numbers[same] * problem.numbers :], points[trial * problem.numbers :]) == 1:
            return
    if place >= most:
        return
    last = count
    if last >= most:
        last = most - 1
    for back in range(last - place):
        numbers[last - back] = numbers[last - back - 1]
        scores[last - back] = scores[last - back - 1]
    numbers[place] = trial
    scores[place] = score
    work.listed[which] = last + 1


def bound_of(which: Integer, most: Integer, work: ConsensusWork) -> Real:
    """The score from which on a trial does not come into a list."""
    if work.listed[which] < most:
        return inf
    return work.best_scores[which * CANDIDATES + most - 1]


def score_trials(kind: Integer, first: Integer, last: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """The trials ``first … last`` into the lists of the best, by a kind of score; limits are those in the work.

    The least median has a list by itself; other scores stand beside that with `WIDE` limits. The largest number of
    units is given that are within their cuts at one of these trials.
    """
    units = work.units
    squares = work.here.squares
    limits = units.limits
    half = CANDIDATES // 2
    inside = 0
    for trial in range(first, last):
        squares_at(problem, work.trials[trial * problem.numbers :], work, squares)
        here = inlier_count(units.count, squares, units.cuts)
        if here > inside:
            inside = here
        if kind == LMEDS:
            bound = bound_of(BY_MEDIAN, CANDIDATES, work)
            score = least_median(
                units.count, work.rules.groups, work.size, squares, units.medians, units.group, bound, work.sorted
            )
            if isfinite(score):
                put_in_list(problem, BY_MEDIAN, CANDIDATES, trial, score, work)
        else:
            score = truncated(units.count, 1.0, squares, limits)
            if kind == RANSAC:
                score = outlier_count(units.count, squares, limits, score)
            if score < bound_of(BY_RULE, half, work):
                put_in_list(problem, BY_RULE, half, trial, score, work)
            wide = truncated(units.count, WIDE, squares, limits)
            if wide < bound_of(BY_WIDE_LIMITS, half, work):
                put_in_list(problem, BY_WIDE_LIMITS, half, trial, wide, work)
    return inside


def limit_by_noise(problem: Problem, point: ConstantReals, work: ConsensusWork) -> None:
    """Limits and variances (U,) in the work from the noise at a point."""
    units = work.units
    squares = work.here.squares
    squares_at(problem, point, work, squares)
    variances_at(units, 0, work.rules.groups, squares, work.sorted, units.variances)
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * units.variances[u]
