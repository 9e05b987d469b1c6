"""Smoothers: Gauss-Newton's method over all steps at once, or over a window that moves on.

A step of it is the least-squares solution for the linearised problem of all steps, so that where it
ends is where the batch solution is. The paths that are tried follow the transitions exactly, with the policies as a
feedback, so that nothing drifts; a step that does not lower the cost enough is shortened.

A smoother's step, from the first row to the last: the path that the policies lead to, and its covariances.

A smoother's step, from the last row to the first: what is still to come, as a function of each step.

The least-squares problem of all steps, in what the first step and the noises are, is taken apart from behind: the rows
of a step and of all those behind it are a triangle of n + 1 numbers; with the transition that leads there it is one of
the noise and of the step before, and the noise is eliminated by reflections. What is left of it is a policy: how the
best noise follows from the step. No covariance is inverted, so that all of them may be singular, and the time grows
with the number of steps.
"""

from __future__ import annotations

from math import isfinite, sqrt

from mbm.machine.words import Integer, Real, Reals
from mbm.solver.charts import step_between, transport
from mbm.solver.filter_keeping import keep_step
from mbm.solver.filter_moves import NEAR, add_noise, carried, carry_lines, move_on, reach, to_columns
from mbm.solver.filter_records import Walk, hold_move, load_move, load_step, step_cost, step_lines
from mbm.solver.filter_update import (
    ENOUGH_DECREASE,
    FIRST_COST,
    MOST_HALVINGS,
    ROUNDING_OF_COST,
    TOLD,
    best_part,
    set_new_factor,
    turn_open,
)
from mbm.solver.linear_algebra import (
    add_multiple,
    append_rows,
    column_product,
    copied,
    corner,
    dot,
    filled,
    inverted_upper,
    solve_upper,
)
from mbm.solver.manifolds import retract
from mbm.solver.smoother_cuts import cut_cost, cut_lines


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
    whole = forward(walk, first, last, free, 1.0)
    if walk.loose == 1:
        if whole >= FIRST_COST:
            return 0
        walk.last_cost = whole
        swap_paths(walk)
        return 1
    part = best_part(walk, walk.last_cost, whole, promise)
    cost = whole
    if part != 1.0:
        cost = forward(walk, first, last, free, part)
        if cost >= whole and promise > TOLD * walk.last_cost:
            part = 1.0
            cost = forward(walk, first, last, free, part)
    walk.stretched = 1 if part > 1.0 else 0
    for _ in range(MOST_HALVINGS):
        if cost <= (1.0 + ROUNDING_OF_COST) * walk.last_cost - 2.0 * ENOUGH_DECREASE * part * promise:
            walk.last_cost = cost
            swap_paths(walk)
            return 1
        part *= 0.5
        cost = forward(walk, first, last, free, part)
    return 0


def smooth(walk: Walk, first: Integer, last: Integer) -> Integer:
    """The path of least cost over some steps: how many open vectors it determines; -1: none is found."""
    walk.settled = 0
    walk.stretched = 0
    walk.vertex = 1.0
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
    keep_step(walk, k, walk.factor)


def spread_path(walk: Walk, first: Integer, last: Integer, free: Integer) -> None:
    """The answers for the steps ``first … last``."""
    spread_first(walk, free)
    drop_open(walk, free)
    keep_path(walk, first)
    for k in range(first, last):
        spread_next(walk, k)
        keep_path(walk, k + 1)


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


def guess_ahead(walk: Walk, k: Integer) -> None:
    """Let `ahead` be about where the step of the path that is tried leads which `tried_noise` has left."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    at = slot_of(walk, k)
    hold_move(walk, at)
    carried(n, chain.still, walk.carry, walk.step, walk.wanted)
    for j in range(q):
        walk.noise[j] = walk.noises_tried[at * q + j] - walk.noises[at * q + j]
    for i in range(n - chain.still):
        walk.wanted[chain.still + i] += dot(q, walk.push[i * q :], walk.noise)
    hold_move(walk, chain.kept)
    retract(walk.seen, path_of(walk, k + 1), walk.wanted, walk.ahead)


def forward(walk: Walk, first: Integer, last: Integer, free: Integer, part: Real) -> Real:
    """The cost of the path that a ``part`` of the step leads to."""
    chain = walk.chain
    cost = begin_forward(walk, first, free, part)
    for k in range(first, last + 1):
        own = walk.path_tried[slot_of(walk, k) * chain.numbers :]
        load_step(walk, k)
        cost += step_cost(walk, own) + cut_cost(walk, k, own)
        if not isfinite(cost):
            return FIRST_COST
        if k < last:
            cost += tried_noise(walk, k, part)
            guess_ahead(walk, k)
            load_noise(walk, k, walk.noises_tried)
            if reach(walk, own, NEAR) == 0:
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


def spread_next(walk: Walk, k: Integer) -> None:
    """The factor of step k + 1 from that of step k, given everything."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    at = slot_of(walk, k)
    hold_move(walk, at)
    closed(walk, k, n, walk.factor)
    closed(walk, k, walk.open_count, walk.open)
    hold_move(walk, chain.kept)
    roots = walk.roots[at * q * q :]
    for i in range(n - chain.still):
        known = walk.pushes[(at * n + i) * q :]
        own = walk.push[i * q :]
        for j in range(q):
            own[j] = 0.0
            for part in range(j + 1):
                own[j] += known[part] * roots[part * q + j]
    add_noise(walk, n, walk.factor, walk.factor)


def slot_of(walk: Walk, k: Integer) -> Integer:
    """Where what is kept of step k stands."""
    return k % walk.chain.kept


def path_of(walk: Walk, k: Integer) -> Reals:
    """The point of step k."""
    return walk.path[slot_of(walk, k) * walk.chain.numbers :]


def add_future(walk: Walk, k: Integer) -> None:
    """Let `future` have the rows of step k too."""
    n = walk.chain.n
    load_step(walk, k)
    m = step_lines(walk, path_of(walk, k))
    m += cut_lines(walk, k, path_of(walk, k), walk.jacobian[m * (n + 1) :])
    to_columns(m, n + 1, m, walk.jacobian, walk.chunk)
    append_rows(n + 1, m, m, walk.chunk, walk.future)


def load_noise(walk: Walk, k: Integer, noises: Reals) -> None:
    """The transition that leads from step k, with its noise."""
    q = walk.chain.noises
    load_move(walk, k)
    copied(q, noises[slot_of(walk, k) * q :], walk.noise)


def follow(walk: Walk, k: Integer) -> Integer:
    """The transition that leads from step k on the path; `step` becomes the gap to the step that it should reach."""
    chain = walk.chain
    hold_move(walk, slot_of(walk, k))
    load_noise(walk, k, walk.noises)
    copied(chain.numbers, path_of(walk, k + 1), walk.ahead)
    found = move_on(walk, path_of(walk, k))
    filled(chain.n, 0.0, walk.step)
    if walk.loose == 1:
        step_between(walk.seen, path_of(walk, k + 1), walk.ahead, walk.turn, walk.step)
    return found


def eliminate_noise(walk: Walk, k: Integer) -> None:
    """`future` of step k + 1 → of step k, without its rows, and the policy of the noise between them."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    still = chain.still
    p = n - still
    width = q + n + 1
    rows = n + 1
    filled(rows * width, 0.0, walk.chunk)
    for i in range(rows):
        line = walk.future[i * rows :]
        for j in range(still):
            walk.chunk[(q + j) * rows + i] = line[j]
        for part in range(p):
            factor = line[still + part]
            if factor != 0.0:
                for j in range(q):
                    walk.chunk[j * rows + i] += factor * walk.push[part * q + j]
                for j in range(n):
                    walk.chunk[(q + j) * rows + i] += factor * walk.carry[part * n + j]
        walk.chunk[(q + n) * rows + i] = line[n] + dot(n, line, walk.step)
    filled(width * width, 0.0, walk.triangle)
    for j in range(q):
        walk.triangle[j * width + j] = 1.0
        walk.triangle[j * width + width - 1] = walk.noise[j]
    append_rows(width, rows, rows, walk.chunk, walk.triangle)
    corner(q, width, walk.triangle, walk.square)
    walk.promise += column_product(q, width, walk.triangle[width - 1 :], walk.triangle[width - 1 :])
    inverted_upper(q, walk.square, walk.roots[slot_of(walk, k) * q * q :])
    gains = walk.gains[slot_of(walk, k) * q * (n + 1) :]
    for j in range(n + 1):
        for i in range(q):
            walk.along[i] = walk.triangle[i * width + q + j]
        solve_upper(q, walk.square, walk.along)
        for i in range(q):
            gains[i * (n + 1) + j] = walk.along[i]
    corner(rows, width, walk.triangle[q * width + q :], walk.future)


def set_base_vectors(walk: Walk, free: Integer) -> None:
    """The vectors that the first step is put together of, ``basis`` about its prior and ``local`` about the path."""
    n = walk.chain.n
    copied(free * n, walk.open, walk.basis)
    copied(n * n, walk.base_factor, walk.basis[free * n :])
    copied((free + n) * n, walk.basis, walk.local)
    transport(walk.seen, walk.base_mean, walk.base_step, free + n, walk.turn, walk.local)


def settle_base(walk: Walk, first: Integer) -> Integer:
    """What changes the first step best, by `future` and its prior: `base_wanted`; how many vectors are free."""
    n = walk.chain.n
    copied((n + 1) * (n + 1), walk.future, walk.jacobian)
    set_base_vectors(walk, walk.open_count)
    free = turn_open(walk, n + 1, walk.local)
    set_base_vectors(walk, free)
    size = free + n
    width = size + 1
    filled(n, 0.0, walk.step)
    if walk.loose == 1:
        step_between(walk.seen, path_of(walk, first), walk.base_mean, walk.turn, walk.step)
    for i in range(n + 1):
        line = walk.future[i * (n + 1) :]
        for j in range(size):
            walk.chunk[j * (n + 1) + i] = dot(n, line, walk.local[j * n :])
        walk.chunk[size * (n + 1) + i] = line[n] + dot(n, line, walk.step)
    filled(width * width, 0.0, walk.triangle)
    for j in range(n):
        walk.triangle[(free + j) * width + free + j] = 1.0
        walk.triangle[(free + j) * width + size] = walk.base_share[j] if walk.loose == 0 else 0.0
    append_rows(width, n + 1, n + 1, walk.chunk, walk.triangle)
    corner(size, width, walk.triangle, walk.square)
    for i in range(size):
        walk.base_wanted[i] = -walk.triangle[i * width + size]
        walk.promise += walk.base_wanted[i] * walk.base_wanted[i]
    solve_upper(size, walk.square, walk.base_wanted)
    return free


def backward(walk: Walk, first: Integer, last: Integer) -> Integer:
    """Policies and promise of a whole step, for the steps ``first … last``; 0 where a transition leads nowhere."""
    n = walk.chain.n
    walk.promise = 0.0
    walk.iterations += 1
    filled((n + 1) * (n + 1), 0.0, walk.future)
    add_future(walk, last)
    k = last
    while k > first:
        k -= 1
        if follow(walk, k) == 0:
            return 0
        eliminate_noise(walk, k)
        add_future(walk, k)
    hold_move(walk, walk.chain.kept)
    return 1
