"""Smoothers: Gauss-Newton's method over all steps at once, or over a window that moves on.

A step of it is the least-squares solution for the linearised problem of all steps (`filter_backward`), so that where
it ends is where the batch solution is. The paths that are tried follow the transitions exactly, with the policies as a
feedback, so that nothing drifts; a step that does not lower the cost enough is shortened.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import Integer
from mbm.solver.filter_backward import backward, path_of, settle_base
from mbm.solver.filter_forward import forward, spread_first, spread_next, swap_paths
from mbm.solver.filter_keeping import keep_step
from mbm.solver.filter_records import Walk
from mbm.solver.filter_update import (
    ENOUGH_DECREASE,
    FIRST_COST,
    MOST_HALVINGS,
    ROUNDING_OF_COST,
)
from mbm.solver.linear_algebra import copied, filled


def begin_path(walk: Walk) -> None:
    """The prior that the walk has becomes that of the path."""
    copied(walk.chain.numbers, walk.point, walk.base_mean)
    copied(walk.chain.n * walk.chain.n, walk.factor, walk.base_factor)
    filled(walk.chain.n, 0.0, walk.base_step)
    filled(walk.chain.n, 0.0, walk.base_share)
    walk.loose = 1


def shortened_path(walk: Walk, first: Integer, last: Integer, free: Integer) -> Integer:
    """Try parts of a step until one lowers the cost enough: 1, it is the path now; 0, none does."""
    promise = walk.promise
    part = 1.0
    for _ in range(MOST_HALVINGS):
        cost = forward(walk, first, last, free, part)
        if walk.loose == 1 and cost < FIRST_COST:
            walk.last_cost = cost
            swap_paths(walk)
            return 1
        if cost <= (1.0 + ROUNDING_OF_COST) * walk.last_cost - 2.0 * ENOUGH_DECREASE * part * promise:
            walk.last_cost = cost
            swap_paths(walk)
            return 1
        if walk.loose == 1:
            return 0
        part *= 0.5
    return 0


def smooth(walk: Walk, first: Integer, last: Integer) -> Integer:
    """The path of least cost over some steps: how many open vectors it determines; -1: none is found."""
    walk.settled = 0
    free = 0
    for _ in range(walk.chain.iterations):
        loose = walk.loose
        if backward(walk, first, last) == 0:
            return -1
        free = settle_base(walk, first)
        if loose == 0 and sqrt(walk.promise) <= walk.tolerance:
            walk.settled = 1
            return free
        if shortened_path(walk, first, last, free) == 0:
            return free if loose == 0 else -1
        if walk.chain.linear == 1:
            walk.settled = 1
            return free
    return free


def drop_open(walk: Walk, free: Integer) -> None:
    """The open vectors without the first ones, which are determined now."""
    walk.open_count -= free
    for i in range(walk.open_count * walk.chain.n):
        walk.open[i] = walk.open[free * walk.chain.n + i]


def keep_path(walk: Walk, k: Integer) -> None:
    """Let the answer for step k be the path's, with the factor where the walk is."""
    copied(walk.chain.numbers, path_of(walk, k), walk.point)
    keep_step(walk, k)


def spread_path(walk: Walk, first: Integer, last: Integer, free: Integer) -> Integer:
    """The answers for the steps ``first … last``; 0 where something is not finite."""
    spread_first(walk, free)
    drop_open(walk, free)
    keep_path(walk, first)
    for k in range(first, last):
        if spread_next(walk, k) == 0:
            return 0
        keep_path(walk, k + 1)
    return 1


def smooth_all(walk: Walk) -> Integer:
    """All steps, each given all rows, along the path that begins with the steps in `points`; how many were made."""
    chain = walk.chain
    begin_path(walk)
    copied(chain.steps * chain.numbers, walk.points, walk.path)
    filled(chain.steps * chain.noises, 0.0, walk.noises)
    free = smooth(walk, 0, chain.steps - 1)
    if free < 0 or spread_path(walk, 0, chain.steps - 1, free) == 0:
        walk.failed = 1
        return 0
    return chain.steps
