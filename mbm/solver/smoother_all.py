"""The smoother of all steps: the path of least cost, and the least of its minima where losses leave rows out.

Rows that a loss leaves out along one path may fit another one. Where they are many, or far off, two more paths are
looked at: the one that least squares lead to, with losses that are wide at first (graduated non-convexity), and the one
that begins where the first step is carried on by the transitions, as all steps at once do.
"""

from __future__ import annotations

from mbm.machine.words import Integer
from mbm.solver.charts import step_between
from mbm.solver.filter_moves import move_on
from mbm.solver.filter_records import Walk, load_step, plain_step_cost, step_cost
from mbm.solver.filter_update import COUNTED
from mbm.solver.linear_algebra import copied, filled
from mbm.solver.smoother_losses import narrowed
from mbm.solver.smoothers import backward, begin_path, load_noise, path_of, settle_base, smooth, spread_path


def smooth_all(walk: Walk) -> Integer:
    """All steps, each given all rows, along the path that begins with the steps in `points`; how many were made."""
    chain = walk.chain
    copied(chain.steps * chain.numbers, walk.points, walk.path)
    free = smooth_path(walk)
    if free >= 0 and chain.rivals == 1 and left_out(walk) == 1:
        free = least_of_paths(walk)
    if free < 0:
        walk.failed = 1
        return 0
    spread_path(walk, 0, chain.steps - 1, free)
    return chain.steps


def spread_along(walk: Walk) -> Integer:
    """The factors of all steps, given all rows, along the path and the noises as they are; 0 where there are none."""
    begin_path(walk)
    step_between(walk.seen, walk.base_mean, walk.path, walk.turn, walk.base_step)
    if backward(walk, 0, walk.chain.steps - 1) == 0:
        return 0
    spread_path(walk, 0, walk.chain.steps - 1, settle_base(walk, 0))
    return 1


def smooth_path(walk: Walk) -> Integer:
    """`smooth` over all steps, from the points of the path on."""
    begin_path(walk)
    filled(walk.chain.steps * walk.chain.noises, 0.0, walk.noises)
    return smooth(walk, 0, walk.chain.steps - 1)


def left_out(walk: Walk) -> Integer:
    """1: losses leave so little of the squares along the path that other minima are looked for."""
    kept = 0.0
    plain = 0.0
    for k in range(walk.chain.steps):
        load_step(walk, k)
        kept += step_cost(walk, path_of(walk, k))
        plain += plain_step_cost(walk, path_of(walk, k))
    return 1 if kept < COUNTED * plain else 0


def carried_path(walk: Walk) -> Integer:
    """`smooth_path` from where the transitions carry the first step."""
    chain = walk.chain
    begin_path(walk)
    copied(chain.numbers, walk.base_mean, walk.path)
    filled(chain.steps * chain.noises, 0.0, walk.noises)
    for k in range(chain.steps - 1):
        load_noise(walk, k, walk.noises)
        copied(chain.numbers, path_of(walk, k), walk.ahead)
        if move_on(walk, path_of(walk, k)) == 0:
            return -1
        copied(chain.numbers, walk.ahead, path_of(walk, k + 1))
    return smooth_path(walk)


def least_of_paths(walk: Walk) -> Integer:
    """The path of less cost of the one from which `smooth` has come and the two others; `points` are overwritten."""
    chain = walk.chain
    settled = walk.settled
    cost = walk.last_cost
    copied(chain.steps * chain.numbers, walk.path, walk.points)
    for rival in range(2):
        free = narrowed(walk, 0, chain.steps - 1) if rival == 0 else carried_path(walk)
        if free >= 0 and walk.last_cost < cost and walk.settled >= settled:
            settled = walk.settled
            cost = walk.last_cost
            copied(chain.steps * chain.numbers, walk.path, walk.points)
    copied(chain.steps * chain.numbers, walk.points, walk.path)
    return smooth_path(walk)
