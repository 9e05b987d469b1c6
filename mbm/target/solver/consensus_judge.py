"""How well trials explain the units: the best of them by each score, in lists that grow as trials are made."""

from __future__ import annotations

from math import inf, isfinite

from mbm.target.decisions import CANDIDATES, WIDE
from mbm.target.solver.consensus_description import BY_MEDIAN, BY_RULE, BY_WIDE_LIMITS, LISTS, Bench
from mbm.target.solver.consensus_order import variances_at
from mbm.target.solver.consensus_rows import squares_at
from mbm.target.solver.consensus_scores import LMEDS, RANSAC, inside_count, least_median, outlier_count, truncated
from mbm.target.solver.description import Problem
from mbm.target.solver.trials import same_point
from mbm.target.words import ConstantReals, Integer, Real


def empty_lists(bench: Bench) -> None:
    """No trial is among the best yet."""
    for k in range(LISTS):
        bench.listed[k] = 0


def put_in_list(system: Problem, which: Integer, most: Integer, trial: Integer, score: Real, bench: Bench) -> None:
    """Put a trial into a list of the best, lowest score first, ``most`` of them; not twice the same point."""
    numbers = bench.best[which * CANDIDATES :]
    scores = bench.best_scores[which * CANDIDATES :]
    points = bench.trials
    count = bench.listed[which]
    place = count
    while place > 0 and scores[place - 1] > score:
        place = place - 1
    same = place
    while same > 0 and scores[same - 1] == score:
        same = same - 1
        if same_point(system, points[numbers[same] * system.numbers :], points[trial * system.numbers :]) == 1:
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
    bench.listed[which] = last + 1


def bound_of(which: Integer, most: Integer, bench: Bench) -> Real:
    """The score from which on a trial does not come into a list."""
    if bench.listed[which] < most:
        return inf
    return bench.best_scores[which * CANDIDATES + most - 1]


def judge_trials(kind: Integer, first: Integer, last: Integer, system: Problem, bench: Bench) -> Integer:
    """The trials ``first … last`` into the lists of the best, by a kind of score; limits are those in the bench.

    The least median has a list by itself; other scores stand beside that with `WIDE` limits. The largest number of
    units is given that are within their cuts at one of these trials.
    """
    units = bench.units
    squares = bench.here.squares
    limits = units.limits
    half = CANDIDATES // 2
    inside = 0
    for trial in range(first, last):
        squares_at(system, bench.trials[trial * system.numbers :], bench, squares)
        here = inside_count(units.count, squares, units.cuts)
        if here > inside:
            inside = here
        if kind == LMEDS:
            bound = bound_of(BY_MEDIAN, CANDIDATES, bench)
            score = least_median(
                units.count, bench.rules.groups, bench.size, squares, units.medians, units.group, bound, bench.sorted
            )
            if isfinite(score):
                put_in_list(system, BY_MEDIAN, CANDIDATES, trial, score, bench)
        else:
            score = truncated(units.count, 1.0, squares, limits)
            if kind == RANSAC:
                score = outlier_count(units.count, squares, limits, score)
            if score < bound_of(BY_RULE, half, bench):
                put_in_list(system, BY_RULE, half, trial, score, bench)
            wide = truncated(units.count, WIDE, squares, limits)
            if wide < bound_of(BY_WIDE_LIMITS, half, bench):
                put_in_list(system, BY_WIDE_LIMITS, half, trial, wide, bench)
    return inside


def limit_by_noise(system: Problem, point: ConstantReals, bench: Bench) -> None:
    """Limits and variances (U,) in the bench from the noise at a point."""
    units = bench.units
    squares = bench.here.squares
    squares_at(system, point, bench, squares)
    variances_at(units, 0, bench.rules.groups, squares, bench.sorted, units.variances)
    for u in range(units.count):
        units.limits[u] = units.cuts[u] * units.variances[u]
