"""A smoother's step, from the last row to the first: what is still to come, as a function of each step.

The least-squares problem of all steps, in what the first step and the noises are, is taken apart from behind: the rows
of a step and of all those behind it are a triangle of n + 1 numbers; with the transition that leads there it is one of
the noise and of the step before, and the noise is eliminated by reflections. What is left of it is a policy: how the
best noise follows from the step. No covariance is inverted, so that all of them may be singular, and the time grows
with the number of steps.
"""

from __future__ import annotations

from mbm.machine.words import Integer, Reals
from mbm.solver.charts import step_between, transport
from mbm.solver.filter_moves import move_on, to_columns
from mbm.solver.filter_records import Walk
from mbm.solver.filter_rows import load_move, load_step, step_lines
from mbm.solver.filter_update import turn_open
from mbm.solver.linear_algebra import append_rows, copied, dot, filled, inverted_upper, solve_upper


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
    for i in range(q):
        copied(q, walk.triangle[i * width :], walk.square[i * q :])
        walk.promise += walk.triangle[i * width + width - 1] * walk.triangle[i * width + width - 1]
    inverted_upper(q, walk.square, walk.roots[slot_of(walk, k) * q * q :])
    gains = walk.gains[slot_of(walk, k) * q * (n + 1) :]
    for j in range(n + 1):
        for i in range(q):
            walk.along[i] = walk.triangle[i * width + q + j]
        solve_upper(q, walk.square, walk.along)
        for i in range(q):
            gains[i * (n + 1) + j] = walk.along[i]
    for i in range(rows):
        copied(rows, walk.triangle[(q + i) * width + q :], walk.future[i * rows :])


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
    for i in range(size):
        copied(size, walk.triangle[i * width :], walk.square[i * size :])
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
    return 1
