"""The smoother of all steps that come one by one: what a new step changes is solved anew, and no more.

The priors of all steps, of all rows before them, are kept. A new step moves those before it less and less: the window
that is solved anew begins where it moves a step by so little that those before it stay where they are (as the wildfire
threshold of iSAM2 does, Kaess et al. 2012). Where more than that arrives at the first step of the window, it begins
earlier. All its steps are linearised anew where the path is, those before it where they were when they moved last.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import Integer, Real
from mbm.solver.charts import step_between
from mbm.solver.filter_moves import CLOSE
from mbm.solver.filter_records import Walk
from mbm.solver.linear_algebra import copied, dot, filled
from mbm.solver.smoother_lag import advance, extend_path, find_newest
from mbm.solver.smoothers import drop_open, keep_path, path_of, slot_of, smooth, spread_first, spread_next

UNMOVED = 0.1
"""Standard deviations by which a step may move without those before it being solved, and linearised, anew. What they
then say of the steps behind them is off by less than a thousandth of that."""

SHOWN = 1e-3
"""The same where steps are shown."""

EARLY = 0.5
"""The next window begins with the first step that has moved by this share of it: the one after would be too late."""


def put_prior(walk: Walk) -> None:
    """Keep the prior of the step where the window begins."""
    n = walk.chain.n
    at = slot_of(walk, walk.base)
    copied(walk.chain.numbers, walk.base_mean, walk.prior_means[at * walk.chain.numbers :])
    copied(n * n, walk.base_factor, walk.prior_factors[at * n * n :])
    filled(n * n, 0.0, walk.prior_opens[at * n * n :])
    copied(walk.open_count * n, walk.open, walk.prior_opens[at * n * n :])


def begin_at(walk: Walk, k: Integer) -> None:
    """Let the window begin at step k, with the prior that was kept of it."""
    n = walk.chain.n
    at = slot_of(walk, k)
    walk.base = k
    copied(walk.chain.numbers, walk.prior_means[at * walk.chain.numbers :], walk.base_mean)
    copied(n * n, walk.prior_factors[at * n * n :], walk.base_factor)
    copied(n * n, walk.prior_opens[at * n * n :], walk.open)
    walk.open_count = 0
    for i in range(n):
        if dot(n, walk.open[i * n :], walk.open[i * n :]) > 0.0:
            walk.open_count += 1
    step_between(walk.seen, walk.base_mean, path_of(walk, k), walk.turn, walk.base_step)
    filled(n, 0.0, walk.base_share)
    walk.loose = 1


def move_window(walk: Walk) -> None:
    """Let the window begin where it is to."""
    begin_at(walk, walk.base)
    while walk.base < walk.next_base:
        advance(walk)
        put_prior(walk)


def has_moved(walk: Walk, k: Integer, most: Real) -> Integer:
    """1: step k, whose factor the walk has, is farther from where the steps before it were solved with it than so many
    standard deviations.
    """
    chain = walk.chain
    n = chain.n
    own = path_of(walk, k)
    step_between(walk.seen, walk.points[k % chain.held * chain.numbers :], own, walk.turn, walk.step)
    for j in range(n):
        square = 0.0
        for i in range(n):
            part = walk.factor[i * n + j]
            square += part * part
        place = walk.seen.number_of[j]
        rounding = CLOSE * (fabs(own[place]) if place >= 0 else 1.0)
        if fabs(walk.step[j]) > most * sqrt(square) + rounding:
            return 1
    return 0


def solve_window(walk: Walk, k: Integer, unmoved: Real) -> Integer:
    """The path up to step k, given all rows so far, and its answers; 0 where something is not finite.

    The first step moves by less than ``unmoved`` standard deviations then.
    """
    first = walk.base + 1
    free = 0
    while walk.base < first:
        first = walk.base
        free = smooth(walk, first, k)
        if free < 0:
            return 0
        spread_first(walk, free)
        if first > 0 and has_moved(walk, first, unmoved) == 1:
            begin_at(walk, 0 if 2 * first <= k else 2 * first - k - 1)
    drop_open(walk, free)
    if first == 0:
        keep_path(walk, 0)
    walk.next_base = k
    for i in range(first, k):
        if i > first:
            if walk.next_base == k and has_moved(walk, i, EARLY * UNMOVED) == 1:
                walk.next_base = i
            keep_path(walk, i)
        spread_next(walk, i)
    keep_path(walk, k)
    return 1


def growing_step(walk: Walk, k: Integer) -> Integer:
    """Step k comes in: the answer for it is given all rows so far; 0 where something is not finite."""
    begun = 0
    if walk.chain.rivals == 1 and k > 0 and walk.open_count == 0:
        begun = find_newest(walk, k)
    if extend_path(walk, k) == 0:
        return 0
    if k == 0:
        put_prior(walk)
    else:
        move_window(walk)
    if begun == 1:
        copied(walk.chain.numbers, walk.newest, path_of(walk, k))
    return solve_window(walk, k, UNMOVED)


def growing_steps(walk: Walk, first: Integer, last: Integer) -> Integer:
    """Steps ``first … last`` come in; how many did."""
    for k in range(first, last):
        if growing_step(walk, k) == 0:
            walk.failed = k + 1
            return k - first
    return last - first


def growing_answers(walk: Walk, first: Integer, k: Integer) -> Integer:
    """The answers for steps from ``first`` to the last one, k, given all rows; 0 where one is not finite."""
    begin_at(walk, walk.base if walk.base < first else first - 1 if first > 0 else 0)
    return solve_window(walk, k, SHOWN)
