"""The smoother of fixed lag: a window moves over the steps, and what leaves it becomes the prior of what stays.

The step that leaves is linearised where the smoother has it, with all rows of the window in mind, not where a filter
first was: so what is carried on does not claim more than the rows say.
"""

from __future__ import annotations

from mbm.machine.words import Integer
from mbm.solver.charts import step_between, transport
from mbm.solver.filter_losses import kept_lines, spread_update
from mbm.solver.filter_moves import add_noise, carried, carry_lines, move_on, predict
from mbm.solver.filter_records import Walk, hold_move, load_move, load_step, plain_step_cost, step_cost, step_lines
from mbm.solver.filter_update import COUNTED, best_point, set_new_factor, set_triangle_of, turn_open
from mbm.solver.linear_algebra import add_multiple, copied, dot, filled
from mbm.solver.manifolds import retract
from mbm.solver.smoother_losses import least_of_windows, spread_base
from mbm.solver.smoothers import (
    backward,
    begin_path,
    drop_open,
    forward,
    keep_path,
    load_noise,
    path_of,
    set_base_vectors,
    settle_base,
    slot_of,
    smooth,
    spread_first,
    spread_next,
    spread_path,
)


def leave_step(walk: Walk, k: Integer) -> None:
    """The prior of step k with its rows, about the path: `factor`, `open`, and the mean as the change `along`."""
    n = walk.chain.n
    load_step(walk, k)
    m = kept_lines(walk, path_of(walk, k)) if walk.chain.pools > 0 else step_lines(walk, path_of(walk, k))
    step_between(walk.seen, path_of(walk, k), walk.base_mean, walk.turn, walk.along)
    for i in range(m):
        walk.jacobian[i * (n + 1) + n] += dot(n, walk.jacobian[i * (n + 1) :], walk.along)
    set_base_vectors(walk, walk.open_count)
    free = turn_open(walk, m, walk.local)
    set_base_vectors(walk, free)
    size = free + n
    filled(size, 0.0, walk.share)
    set_triangle_of(walk, m, free, size)
    root = walk.triangle[(size + 1) * (size + 1) - 1]
    walk.left_cost += root * root
    for j in range(size):
        add_multiple(n, walk.wanted[j], walk.local[j * n :], walk.along)
    copied(size * n, walk.local, walk.basis)
    filled(n, 0.0, walk.step)
    set_new_factor(walk, size)
    drop_open(walk, free)
    transport(walk.seen, walk.base_mean, walk.base_step, walk.open_count, walk.turn, walk.open)
    if walk.chain.pools > 0:
        copied(n * n, walk.base_errors, walk.errors)
        transport(walk.seen, walk.base_mean, walk.base_step, n, walk.turn, walk.errors)
        spread_update(walk, path_of(walk, k), free, size, 0)


def advance(walk: Walk) -> None:
    """Let the window begin one step later."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    k = walk.base
    leave_step(walk, k)
    load_noise(walk, k, walk.noises)
    copied(n, walk.along, walk.base_step)
    hold_move(walk, slot_of(walk, k))
    carried(n, chain.still, walk.carry, walk.base_step, walk.wanted)
    for i in range(n - chain.still):
        walk.wanted[chain.still + i] -= dot(q, walk.push[i * q :], walk.noise)
    carry_lines(walk, n, walk.factor)
    carry_lines(walk, walk.open_count, walk.open)
    add_noise(walk, n, walk.factor, walk.factor)
    if chain.pools > 0:
        carry_lines(walk, n, walk.errors)
        add_noise(walk, n, walk.errors, walk.errors)
    hold_move(walk, chain.kept)
    own = path_of(walk, k + 1)
    retract(walk.seen, own, walk.wanted, walk.base_mean)
    transport(walk.seen, own, walk.wanted, n, walk.turn, walk.factor)
    transport(walk.seen, own, walk.wanted, walk.open_count, walk.turn, walk.open)
    copied(n * n, walk.factor, walk.base_factor)
    if chain.pools > 0:
        transport(walk.seen, own, walk.wanted, n, walk.turn, walk.errors)
        copied(n * n, walk.errors, walk.base_errors)
    step_between(walk.seen, walk.base_mean, own, walk.turn, walk.base_step)
    filled(n, 0.0, walk.base_share)
    walk.loose = 1
    walk.base = k + 1


def carry_on(walk: Walk, count: Integer) -> None:
    """The prior of the step so many behind the first, by the rows before it, along the path, in place of that of the
    first, where the walk is.
    """
    begin_path(walk)
    walk.base = 0
    step_between(walk.seen, walk.base_mean, path_of(walk, 0), walk.turn, walk.base_step)
    for _ in range(count):
        advance(walk)
    copied(walk.chain.numbers, walk.base_mean, walk.point)
    copied(walk.chain.n * walk.chain.n, walk.base_factor, walk.factor)


def extend_path(walk: Walk, k: Integer) -> Integer:
    """Let the path reach step k, without noise on the way; 0 where the transition leads nowhere."""
    chain = walk.chain
    if k == 0:
        begin_path(walk)
        walk.base = 0
        if chain.pools > 0:
            copied(chain.n * chain.n, walk.base_factor, walk.base_errors)
        copied(chain.numbers, walk.point, walk.path)
        return 1
    filled(chain.noises, 0.0, walk.noises[slot_of(walk, k - 1) * chain.noises :])
    load_noise(walk, k - 1, walk.noises)
    copied(chain.numbers, path_of(walk, k - 1), walk.ahead)
    hold_move(walk, slot_of(walk, k - 1))
    if move_on(walk, path_of(walk, k - 1)) == 0:
        return 0
    hold_move(walk, chain.kept)
    copied(chain.numbers, walk.ahead, path_of(walk, k))
    return 1


def begin_window(walk: Walk, k: Integer) -> None:
    """Let the window hold no more than a lag up to step k."""
    if k - walk.base > walk.chain.lag:
        advance(walk)
    elif walk.loose == 0:
        walk.last_cost = forward(walk, walk.base, k, 0, 0.0)


def spread_to_newest(walk: Walk, k: Integer) -> None:
    """The factor of the last step before k, given all rows so far."""
    spread_first(walk, 0)
    for i in range(walk.base, k - 1):
        spread_next(walk, i)


def find_newest(walk: Walk, k: Integer) -> Integer:
    """1: `newest` is what a filter makes of step k, whose rows a loss leaves out where the path would come to.

    The walk has the factor of the step before.
    """
    copied(walk.chain.numbers, path_of(walk, k - 1), walk.point)
    load_move(walk, k - 1)
    load_step(walk, k)
    if predict(walk) == 0 or step_cost(walk, walk.point) >= COUNTED * plain_step_cost(walk, walk.point):
        return 0
    size = best_point(walk)
    copied(walk.chain.numbers, walk.trial if size > 0 else walk.point, walk.newest)
    return 0 if size < 0 else 1


def lag_step(walk: Walk, k: Integer) -> Integer:
    """Step k comes in, and the one a lag before goes out; 0 where something is not finite."""
    chain = walk.chain
    begun = 0
    if chain.rivals == 1 and k > 0 and walk.open_count == 0:
        spread_to_newest(walk, k)
        begun = find_newest(walk, k)
    if extend_path(walk, k) == 0:
        return 0
    begin_window(walk, k)
    if begun == 1:
        copied(chain.numbers, walk.newest, path_of(walk, k))
        walk.loose = 1
    unknown = chain.rivals == 1 and walk.open_count > 0
    free = least_of_windows(walk, k) if unknown else smooth(walk, walk.base, k)
    if free < 0:
        return 0
    walk.free = free
    walk.unsettled += 1 - walk.settled
    if k == chain.steps - 1:
        lag_end(walk, k)
    elif k - walk.base == chain.lag:
        tell_base(walk, k, free)
    return 1


def lag_end(walk: Walk, k: Integer) -> None:
    """The answers for the steps that are left in the window, of which k is the last."""
    if walk.chain.pools == 0:
        spread_path(walk, walk.base, k, walk.free)
        return
    if walk.counted <= walk.base:
        tell_base(walk, k, walk.free)
    while walk.base < k:
        advance(walk)
        backward(walk, walk.base, k)
        tell_base(walk, k, settle_base(walk, walk.base))


def tell_base(walk: Walk, k: Integer, free: Integer) -> None:
    """The answer for the first step of the window, of which k is the last."""
    n = walk.chain.n
    spread_first(walk, free)
    if walk.chain.pools > 0:
        spread_base(walk, k, free)
        copied(n * n, walk.errors, walk.factor)
    walk.open_count -= free
    keep_path(walk, walk.base)
    walk.open_count += free


def lag_steps(walk: Walk, first: Integer, last: Integer) -> Integer:
    """Steps ``first … last`` come in; how many did."""
    for k in range(first, last):
        if lag_step(walk, k) == 0:
            walk.failed = k + 1
            return k - first
    return last - first
