"""Trials: subsets of units, each fitted, until one is free of the outliers of what the best of them explains."""

from __future__ import annotations

from mbm.target.decisions import MOST_FITS
from mbm.target.solver.consensus_description import Bench
from mbm.target.solver.consensus_draw import (
    FEWEST_TRIALS,
    combinations_of,
    drawn_below,
    jump_to_next_trial,
    next_combination,
    subset_drawn,
    subset_taken,
    trials_for_share,
    unit_added,
)
from mbm.target.solver.consensus_forms import points_in_closed_form
from mbm.target.solver.consensus_judge import judge_trials
from mbm.target.solver.consensus_subset import fitted_to_subset, gather_subset
from mbm.target.solver.description import Problem
from mbm.target.solver.linear_algebra import copied
from mbm.target.words import Integer

DRAWS = 40
"""Subsets that are looked at: so many cost what a few trials do, and most often show what befalls a tenth of them."""


def size_of_subsets(system: Problem, bench: Bench) -> Integer:
    """The units that the first trial takes; 0 where all units together do not determine the unknowns."""
    units = bench.units
    bench.state_used[0] = bench.rules.first_state
    bench.state_used[1] = bench.rules.second_state
    return subset_drawn(
        bench.state_used,
        units.count,
        system.n,
        units.first,
        bench.directions,
        bench.order,
        bench.basis,
        bench.chosen,
    )


def seldom_in_vain(system: Problem, bench: Bench) -> Integer:
    """Whether less than a tenth of `DRAWS` subsets of units drawn at random leave unknowns open at the start."""
    n = system.n
    units = bench.units.count
    order = bench.order
    for i in range(units):
        order[i] = i
    vain = 0
    for _ in range(DRAWS):
        rank = 0
        for position in range(n if n < units else units):
            other = position + drawn_below(bench.state_used, units - position)
            unit = order[other]
            order[other] = order[position]
            order[position] = unit
            before = rank
            rank = unit_added(unit, rank, n, bench.units.first, bench.directions, bench.basis)
            if (rank - before) * (n - rank) == 0:  # enough, or one that says nothing new
                break
        if rank < n:
            vain += 1
    return 10 * vain < DRAWS


def next_subset(system: Problem, bench: Bench) -> Integer:
    """The units of the next trial in the bench: how many; 0 for a combination that leaves unknowns open."""
    first = bench.units.first
    rows = bench.directions
    n = system.n
    if bench.every_subset == 1:
        found = subset_taken(bench.size, n, bench.combination, first, rows, bench.basis, bench.chosen)
        next_combination(bench.units.count, bench.size, bench.combination)
        return found
    state = bench.state_used
    state[0] = bench.state[0]
    state[1] = bench.state[1]
    jump_to_next_trial(bench.state)
    return subset_drawn(state, bench.units.count, n, first, rows, bench.order, bench.basis, bench.chosen)


def all_alike(bench: Bench) -> Integer:
    """Whether all units have as many components."""
    components = bench.units.components
    for u in range(bench.units.count):
        if components[u] != components[0]:
            return 0
    return 1


def fit_subset(trial: Integer, count: Integer, system: Problem, bench: Bench) -> Integer:
    """Points that fit the ``count`` chosen units, put behind those that are made: how many there are then."""
    rules = bench.rules
    numbers = system.numbers
    trials = bench.trials_wanted
    done = bench.points_made
    if rules.form != 0:
        found = points_in_closed_form(system, count, bench.begun, bench, bench.trials[done * numbers :])
        if found > 0:
            return done + found
    fits = trials * rules.starts
    if fits > MOST_FITS:
        fits = MOST_FITS
    if fits < trials:
        fits = trials
    gather_subset(system, count, bench)
    turn = 0
    while turn * trials + trial < fits and done < rules.most_points - 4:
        start = bench.begun[(turn + trial) % rules.starts * numbers :]
        fitted_to_subset(system, start, bench, bench.trials[done * numbers :])
        done += 1
        turn += 1
        if rules.form != 0:
            break
    return done


def begin_trials(bench: Bench) -> None:
    """None is made yet: the number that is wanted, and the generator or the first combination."""
    rules = bench.rules
    units = bench.units
    trials = rules.trials[bench.size]
    most = combinations_of(units.count, bench.size, trials)
    bench.every_subset = 0
    bench.until_enough = rules.until_sure
    if most <= trials:
        trials = most
        bench.until_enough = 0
        bench.every_subset = all_alike(bench)
    bench.trials_wanted = trials
    bench.trials_made = 0
    bench.points_made = 0
    bench.most_inside = 0
    bench.state[0] = rules.first_state
    bench.state[1] = rules.second_state
    for i in range(bench.size):
        bench.combination[i] = i
    copied(units.count, units.cuts, units.limits)


def fit_trials(most: Integer, system: Problem, bench: Bench) -> None:
    """``most`` trials more: points that fit subsets, from the starts where no closed form does.

    Where the noise is stated they are judged as they are made, and end when they are enough.
    """
    last = bench.trials_made + most
    if last > bench.trials_wanted:
        last = bench.trials_wanted
    for trial in range(bench.trials_made, last):
        count = next_subset(system, bench)
        before = bench.points_made
        if count > 0 and before < bench.rules.most_points - 4:
            bench.verdict.trials += 1
            bench.points_made = fit_subset(trial, count, system, bench)
        if bench.rules.groups == 0:
            here = judge_trials(bench.rules.kind, before, bench.points_made, system, bench)
            if here > bench.most_inside:
                bench.most_inside = here
        bench.trials_made = trial + 1
        if enough_made(bench) == 1:
            bench.trials_wanted = trial + 1
            break


def enough_made(bench: Bench) -> Integer:
    """Whether one of the trials made has met only units of a solution as good as the best, or better."""
    if bench.until_enough == 0 or bench.trials_made < FEWEST_TRIALS or bench.most_inside == 0:
        return 0
    return float(bench.trials_made) >= trials_for_share(bench.most_inside, bench.units.count, bench.size)
