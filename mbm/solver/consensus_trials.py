"""Trials: subsets of units, each fitted, until one is free of the outliers of what the best of them explains.

How well trials explain the units: the best of them by each score, in lists that grow as trials are made.
"""

from __future__ import annotations

from math import inf, isfinite

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.consensus_forms import points_in_closed_form
from mbm.solver.consensus_records import BY_MEDIAN, BY_RULE, BY_WIDE_LIMITS, LISTS, ConsensusWork
from mbm.solver.consensus_sample import (
    FEWEST_TRIALS,
    combinations_of,
    count_chosen,
    drawn_below,
    jump_to_next_trial,
    next_combination,
    subset_sampled,
    subset_taken,
    trials_for_share,
    unit_added,
)
from mbm.solver.consensus_scores import (
    LMEDS,
    RANSAC,
    inlier_count,
    least_median,
    outlier_count,
    truncated,
    variances_at,
)
from mbm.solver.consensus_subset import fitted_to_subset, gather_subset
from mbm.solver.consensus_units import squares_at
from mbm.solver.decisions import CANDIDATES, MOST_FITS, WIDE
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied, numbered
from mbm.solver.trial_steps import same_point

DRAWS = 40
"""Subsets that are looked at: so many cost what a few trials do, and most often show what befalls a tenth of them."""


def size_of_subsets(problem: Problem, work: ConsensusWork) -> Integer:
    """The units that the first trial takes, with the rank that they have in the work; 0 where that is 0.

    Unknowns that it does not tell are left where they are by all trials.
    """
    state = work.state_used
    state[0] = work.rules.first_state
    state[1] = work.rules.second_state
    n = problem.n
    work.rank = subset_sampled(state, work.units, work.left, n, work.directions, work.order, work.basis, work.chosen)
    return count_chosen(work.chosen)


def seldom_in_vain(problem: Problem, work: ConsensusWork) -> Integer:
    """Whether less than a tenth of `DRAWS` subsets of units drawn at random leave unknowns open at the start."""
    n = problem.n
    units = work.units.count
    order = work.order
    numbered(units, order)
    vain = 0
    for _ in range(DRAWS):
        rank = 0
        for position in range(work.left if work.left < units else units):
            other = position + drawn_below(work.state_used, units - position)
            unit = order[other]
            order[other] = order[position]
            order[position] = unit
            before = rank
            rank = unit_added(unit, rank, n, work.units.first, work.directions, work.basis)
            if (rank - before) * (work.left - rank) == 0:  # enough, or one that says nothing new
                break
        if rank < work.left:
            vain += 1
    return 10 * vain < DRAWS


def next_subset(problem: Problem, work: ConsensusWork) -> Integer:
    """The units of the next trial in the work: how many; 0 for those that leave more unknowns open than the first."""
    units = work.units
    rows = work.directions
    n = problem.n
    if work.every_subset == 1:
        rank = subset_taken(work.size, n, work.combination, units.first, rows, work.basis, work.chosen)
        next_combination(units.count, work.size, work.combination)
    else:
        state = work.state_used
        state[0] = work.state[0]
        state[1] = work.state[1]
        jump_to_next_trial(work.state)
        rank = subset_sampled(state, units, work.rank, n, rows, work.order, work.basis, work.chosen)
    return count_chosen(work.chosen) if rank >= work.rank else 0


def all_alike(work: ConsensusWork) -> Integer:
    """Whether all units have as many components."""
    components = work.units.components
    for u in range(work.units.count):
        if components[u] != components[0]:
            return 0
    return 1


def fit_subset(trial: Integer, count: Integer, problem: Problem, work: ConsensusWork) -> Integer:
    """Points that fit the ``count`` chosen units, put behind those that are made: how many there are then."""
    rules = work.rules
    numbers = problem.numbers
    trials = work.trials_wanted
    done = work.points_made
    if rules.form != 0 and work.told == 0:
        found = points_in_closed_form(problem, count, work.begun, work, work.trials[done * numbers :])
        if found > 0:
            return done + found
    fits = trials * rules.starts
    if fits > MOST_FITS:
        fits = MOST_FITS
    if fits < trials:
        fits = trials
    gather_subset(problem, count, work)
    turn = 0
    while turn * trials + trial < fits and done < rules.most_points - 4:
        start = work.begun[(turn + trial) % rules.starts * numbers :]
        fitted_to_subset(problem, start, work, work.trials[done * numbers :])
        done += 1
        turn += 1
        if rules.form != 0:
            break
    return done


def begin_trials(work: ConsensusWork) -> None:
    """None is made yet: the number that is wanted, and the generator or the first combination."""
    rules = work.rules
    units = work.units
    trials = rules.trials[work.size]
    most = combinations_of(units.count, work.size, trials)
    work.every_subset = 0
    work.until_enough = rules.until_sure
    if most <= trials:
        trials = most
        work.until_enough = 0
        work.every_subset = all_alike(work)
    work.trials_wanted = trials
    work.trials_made = 0
    work.points_made = 0
    work.most_inliers = 0
    work.state[0] = rules.first_state
    work.state[1] = rules.second_state
    numbered(work.size, work.combination)
    copied(units.count, units.cuts, units.limits)


def fit_trials(most: Integer, problem: Problem, work: ConsensusWork) -> None:
    """``most`` trials more: points that fit subsets, from the starts where no closed form does.

    Where the noise is stated they are judged as they are made, and end when they are enough.
    """
    last = work.trials_made + most
    if last > work.trials_wanted:
        last = work.trials_wanted
    for trial in range(work.trials_made, last):
        count = next_subset(problem, work)
        before = work.points_made
        if count > 0 and before < work.rules.most_points - 4:
            work.verdict.trials += 1
            work.points_made = fit_subset(trial, count, problem, work)
        if work.rules.groups == 0:
            here = score_trials(work.rules.kind, before, work.points_made, problem, work)
            if here > work.most_inliers:
                work.most_inliers = here
        work.trials_made = trial + 1
        if enough_made(work) == 1:
            work.trials_wanted = trial + 1
            break


def enough_made(work: ConsensusWork) -> Integer:
    """Whether one of the trials made has met only units of a solution as good as the best, or better."""
    if work.until_enough == 0 or work.trials_made < FEWEST_TRIALS or work.most_inliers == 0:
        return 0
    return float(work.trials_made) >= trials_for_share(work.most_inliers, work.units.count, work.size)


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
                units.count, work.rules.groups, units.subset, squares, units.medians, units.group, bound, work.sorted
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
