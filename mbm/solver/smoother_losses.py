"""What losses leave of a window of steps: the sandwich ``H⁻¹ G H⁻¹`` of the first one (`filter_losses`).

From behind, each step has the triangle of H of all rows from there on, as in `smoothers`, and one of G: how the slope
of their cost varies. Across a transition ``x' = F x + L w``, with the triangle R of H at x', the slope at x is that at
x' along the closed loop ``Φ = F - L K`` of the policy K, and the noise w adds ``Lᵀ Rᵀ R Φ`` to what it varies by.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import Integer
from mbm.solver.charts import transport
from mbm.solver.filter_losses import (
    NARROWER,
    POOLED,
    SHARE,
    WIDEST,
    add_shares,
    renew_errors,
    settle_factors,
    spread_lines,
    weighed_lines,
)
from mbm.solver.filter_moves import to_columns
from mbm.solver.filter_records import Walk, hold_move, load_step, widen_losses
from mbm.solver.linear_algebra import add_multiple, append_rows, copied, filled
from mbm.solver.loss_pools import COUNT
from mbm.solver.smoothers import eliminate_noise, follow, forward, path_of, settle_base, slot_of, smooth


def add_lossy(walk: Walk, k: Integer) -> None:
    """Let `future` and `scores` have the rows of step k too."""
    n = walk.chain.n
    load_step(walk, k)
    m = weighed_lines(walk, path_of(walk, k))
    spread_lines(walk, m)
    to_columns(m, n + 1, m, walk.jacobian, walk.chunk)
    append_rows(n + 1, m, m, walk.chunk, walk.future)
    to_columns(m, n, m, walk.scores[n * n :], walk.chunk)
    append_rows(n, m, m, walk.chunk, walk.scores)


def add_noise_scores(walk: Walk) -> None:
    """Behind `scores` what the noise of the transition at hand adds, by `future` of the step reached."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    filled(q * n, 0.0, walk.scores[n * n :])
    for i in range(n + 1):
        line = walk.future[i * (n + 1) :]
        for j in range(q):
            value = 0.0
            for part in range(n - chain.still):
                value += line[chain.still + part] * walk.push[part * q + j]
            add_multiple(n, value, line, walk.scores[(n + j) * n :])


def close_scores(walk: Walk, k: Integer) -> None:
    """`scores` of the step reached, with those of the noise → of step k."""
    chain = walk.chain
    n = chain.n
    q = chain.noises
    still = chain.still
    gains = walk.gains[slot_of(walk, k) * q * (n + 1) :]
    count = n + q
    for i in range(count):
        own = walk.scores[i * n :]
        filled(n, 0.0, walk.share)
        copied(still, own, walk.share)
        for part in range(n - still):
            add_multiple(n, own[still + part], walk.carry[part * n :], walk.share)
        for j in range(q):
            value = 0.0
            for part in range(n - still):
                value += own[still + part] * walk.push[part * q + j]
            add_multiple(n, -value, gains[j * (n + 1) :], walk.share)
        for j in range(n):
            walk.chunk[j * count + i] = walk.share[j]
    filled(n * n, 0.0, walk.scores)
    append_rows(n, count, count, walk.chunk, walk.scores)


def spread_backward(walk: Walk, first: Integer, last: Integer) -> Integer:
    """`future` and `scores` of the steps ``first … last``; 0 where a transition leads nowhere."""
    n = walk.chain.n
    filled((n + 1) * (n + 1), 0.0, walk.future)
    filled(n * n, 0.0, walk.scores)
    add_lossy(walk, last)
    k = last
    while k > first:
        k -= 1
        if follow(walk, k) == 0:
            return 0
        add_noise_scores(walk)
        eliminate_noise(walk, k)
        close_scores(walk, k)
        add_lossy(walk, k)
    hold_move(walk, walk.chain.kept)
    return 1


def narrowed(walk: Walk, first: Integer, last: Integer) -> Integer:
    """`smooth` with losses that are wide at first, and become those that are stated (graduated non-convexity)."""
    factor = WIDEST
    while factor > 1.0:
        widen_losses(walk, factor)
        walk.last_cost = forward(walk, first, last, 0, 0.0)
        factor = 0.0 if smooth(walk, first, last) < 0 else min(NARROWER * factor, sqrt(walk.last_cost))
    walk.rows.constants = walk.stated
    walk.last_cost = forward(walk, first, last, 0, 0.0)
    return smooth(walk, first, last)


def least_of_windows(walk: Walk, last: Integer) -> Integer:
    """`smooth` over the window up to step ``last`` of whose first step not all is known: the least cost of where it was
    predicted and of where least squares lead to. The first row of all leads alone.
    """
    chain = walk.chain
    if last == 0:
        return narrowed(walk, 0, 0)
    size = chain.kept * chain.numbers
    found = smooth(walk, walk.base, last)
    settled = walk.settled
    cost = walk.last_cost
    copied(size, walk.path, walk.path_kept)
    free = narrowed(walk, walk.base, last)
    if found < 0 or (free >= 0 and walk.last_cost < cost and walk.settled >= settled):
        return free
    copied(size, walk.path_kept, walk.path)
    filled(chain.kept * chain.noises, 0.0, walk.noises)
    walk.loose = 1
    return smooth(walk, walk.base, last)


def sum_window(walk: Walk, first: Integer, last: Integer) -> Integer:
    """`sums` of what is counted and rows of the steps ``first … last``, as much determined; 0: nothing is counted."""
    chain = walk.chain
    copied(chain.pools * POOLED, walk.pools, walk.sums)
    for k in range(first, last + 1):
        load_step(walk, k)
        weighed_lines(walk, path_of(walk, k))
    found = 0
    for place in range(chain.pools):
        before = walk.pools[place * POOLED + COUNT]
        if before > 0.0:
            walk.sums[place * POOLED + SHARE] *= walk.sums[place * POOLED + COUNT] / before
            found = 1
    return found


def count_base(walk: Walk, size: Integer) -> None:
    """Let `pools` have the rows of the first step of the window, too."""
    count = walk.chain.pools * POOLED
    copied(count, walk.pools, walk.sums)
    load_step(walk, walk.base)
    m = weighed_lines(walk, path_of(walk, walk.base))
    add_shares(walk, m, size)
    copied(count, walk.sums, walk.pools)
    walk.counted = walk.base + 1


def errors_of_base(walk: Walk, last: Integer, free: Integer) -> None:
    """`errors` of the first step of the window, given the rows up to step ``last``, by the `sums`; else of the factor.

    ``free`` open vectors are determined by the smoother's rows.
    """
    n = walk.chain.n
    copied(n * n, walk.factor, walk.errors)
    found = settle_factors(walk)
    if found == 1:
        found = spread_backward(walk, walk.base, last)
    if found == 1 and settle_base(walk, walk.base) == free:
        copied(n * n, walk.base_errors, walk.errors)
        transport(walk.seen, walk.base_mean, walk.base_step, n, walk.turn, walk.errors)
        renew_errors(walk, n + 1, walk.future, n, walk.scores, free + n)


def spread_base(walk: Walk, last: Integer, free: Integer) -> None:
    """The same, and count the rows of this step; the first one of all tells how much rows are determined."""
    counted = sum_window(walk, walk.base, last)
    errors_of_base(walk, last, free)
    count_base(walk, free + walk.chain.n)
    if counted == 0:
        sum_window(walk, walk.base + 1, last)
        errors_of_base(walk, last, free)
