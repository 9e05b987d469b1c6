"""A smoother's step, from the first row to the last: the path that the policies lead to, and its covariances."""

from __future__ import annotations

from math import isfinite

from mbm.machine.words import Integer, Real, Reals
from mbm.solver.charts import step_between
from mbm.solver.filter_backward import load_noise, path_of, set_base_vectors, slot_of
from mbm.solver.filter_moves import add_noise, carry_lines, move_on
from mbm.solver.filter_records import Walk
from mbm.solver.filter_rows import load_step, step_cost
from mbm.solver.filter_update import FIRST_COST, set_new_factor
from mbm.solver.linear_algebra import add_multiple, copied, dot, filled
from mbm.solver.manifolds import retract


def begin_forward(walk: Walk, first: Integer, free: Integer, part: Real) -> Real:
    """Let the path that is tried begin where a ``part`` of the step leads; what that adds to the cost."""
    n = walk.chain.n
    copied(n, walk.base_step, walk.base_step_tried)
    copied(n, walk.base_share, walk.base_share_tried)
    if walk.loose == 1:
        filled(n, 0.0, walk.base_step_tried)
        filled(n, 0.0, walk.base_share_tried)
    for j in range(free):
        add_multiple(n, part * walk.base_wanted[j], walk.open[j * n :], walk.base_step_tried)
    for j in range(n):
        walk.base_share_tried[j] += part * walk.base_wanted[free + j]
        add_multiple(n, part * walk.base_wanted[free + j], walk.base_factor[j * n :], walk.base_step_tried)
    target = walk.path_tried[slot_of(walk, first) * walk.chain.numbers :]
    retract(walk.seen, walk.base_mean, walk.base_step_tried, target)
    return dot(n, walk.base_share_tried, walk.base_share_tried)


def tried_noise(walk: Walk, k: Integer, part: Real) -> Real:
    """The noise that the policy of step k has for the path that is tried; what it adds to the cost."""
    n = walk.chain.n
    q = walk.chain.noises
    at = slot_of(walk, k)
    gains = walk.gains[at * q * (n + 1) :]
    step_between(walk.seen, path_of(walk, k), walk.path_tried[at * walk.chain.numbers :], walk.turn, walk.step)
    total = 0.0
    for i in range(q):
        value = walk.noises[at * q + i] - part * gains[i * (n + 1) + n]
        value -= dot(n, gains[i * (n + 1) :], walk.step)
        walk.noises_tried[at * q + i] = value
        total += value * value
    return total


def forward(walk: Walk, first: Integer, last: Integer, free: Integer, part: Real) -> Real:
    """The cost of the path that a ``part`` of the step leads to."""
    chain = walk.chain
    cost = begin_forward(walk, first, free, part)
    for k in range(first, last + 1):
        own = walk.path_tried[slot_of(walk, k) * chain.numbers :]
        load_step(walk, k)
        cost += step_cost(walk, own)
        if not isfinite(cost):
            return FIRST_COST
        if k < last:
            cost += tried_noise(walk, k, part)
            load_noise(walk, k, walk.noises_tried)
            copied(chain.numbers, path_of(walk, k + 1), walk.ahead)
            if move_on(walk, own) == 0:
                return FIRST_COST
            copied(chain.numbers, walk.ahead, walk.path_tried[slot_of(walk, k + 1) * chain.numbers :])
    return cost


def swap_paths(walk: Walk) -> None:
    """Let the path that was tried be the path."""
    path = walk.path
    walk.path = walk.path_tried
    walk.path_tried = path
    noises = walk.noises
    walk.noises = walk.noises_tried
    walk.noises_tried = noises
    copied(walk.chain.n, walk.base_step_tried, walk.base_step)
    copied(walk.chain.n, walk.base_share_tried, walk.base_share)
    walk.loose = 0


def closed(walk: Walk, k: Integer, count: Integer, lines: Reals) -> None:
    """Vectors (count, n) of step k → of the next one, with the noise that the policy answers them with."""
    n = walk.chain.n
    q = walk.chain.noises
    still = walk.chain.still
    gains = walk.gains[slot_of(walk, k) * q * (n + 1) :]
    for i in range(count):
        own = lines[i * n :]
        for j in range(q):
            walk.noise[j] = dot(n, gains[j * (n + 1) :], own)
        carry_lines(walk, 1, own)
        for j in range(n - still):
            own[still + j] -= dot(q, walk.push[j * q :], walk.noise)


def spread_first(walk: Walk, free: Integer) -> None:
    """The factor of the first step, given everything; `square` is the triangle that the last step back has left."""
    set_base_vectors(walk, free)
    filled(walk.chain.n, 0.0, walk.step)
    copied((free + walk.chain.n) * walk.chain.n, walk.local, walk.basis)
    set_new_factor(walk, free + walk.chain.n)


def spread_next(walk: Walk, k: Integer) -> Integer:
    """The factor of step k + 1 from that of step k, given everything."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    load_noise(walk, k, walk.noises)
    copied(chain.numbers, path_of(walk, k + 1), walk.ahead)
    if move_on(walk, path_of(walk, k)) == 0:
        return 0
    closed(walk, k, n, walk.factor)
    closed(walk, k, walk.open_count, walk.open)
    roots = walk.roots[slot_of(walk, k) * q * q :]
    for i in range(n - chain.still):
        own = walk.push[i * q :]
        copied(q, own, walk.noise)
        for j in range(q):
            own[j] = 0.0
            for part in range(j + 1):
                own[j] += walk.noise[part] * roots[part * q + j]
    add_noise(walk, n, walk.factor)
    return 1
