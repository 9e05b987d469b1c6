"""Updates: what the rows of a step say, together with what was predicted.

With ``x = mean ⊞ Bᵀ θ``, where the vectors B are those of the factor, θ ~ N(0, I), and open ones, whose coefficients
are free, an update is a least-squares problem in θ: minimise ``|θ|² + |r(x)|²``. Its triangle T, of the rows ``J Bᵀ``
below the identity, is well conditioned however singular the covariance is; the new factor is ``T⁻ᵀ B`` and the
last number of the triangle the root of ``vᵀ S⁻¹ v`` of the innovation v.

Gauss-Newton's steps are shortened until the cost falls enough (Armijo): an iterated extended Kalman filter
(Bell and Cathey 1993) that cannot diverge. With one iteration it is the extended Kalman filter.
"""

from __future__ import annotations

from math import fabs, isfinite, pi, sqrt

from mbm.machine.words import ConstantReals, Integer, Real
from mbm.solver.charts import longest_turn, transport
from mbm.solver.covariance import singular_values
from mbm.solver.filter_losses import NARROWER, WIDEST, spread_update
from mbm.solver.filter_moves import to_columns
from mbm.solver.filter_records import Walk, plain_step_cost, step_cost, step_lines, widen_losses
from mbm.solver.linear_algebra import add_multiple, append_rows, copied, corner, dot, filled, solve_upper, times_upper
from mbm.solver.manifolds import retract

UNSEEN = 1e-10
"""A singular value of the rows in the open directions that is this share of the largest, or of the sum of the sizes of
all its terms, or less, is rounding."""

ENOUGH_DECREASE = 1e-4
"""Share of the decrease that the slope promises."""

ROUNDING_OF_COST = 1e-14
"""Share of the cost that is the rounding of its sum: a promise below it cannot be seen to be kept, and is believed."""

MOST_HALVINGS = 30

TOLD = 1e-10
"""Share of the cost that a promise has to be for the cost after a step to tell the curvature on the way; what was told
before holds for shorter steps."""

ALMOST = 0.7
"""Share of a step, or of the one that is best, from which on the other is not tried."""

SHORTEST, LONGEST = 0.1, 16.0
"""Parts of a step that are tried at once."""

FIRST_COST = 1e300
"""Where costs are not finite."""

COUNTED = 0.5
"""Where losses leave less of the squares of a step's rows, another minimum is looked for."""


def see_along(walk: Walk, m: Integer, count: Integer, lines: ConstantReals) -> None:
    """How m rows see the vectors ``lines`` (count, n): singular values, and axes in numbers of the vectors."""
    n = walk.chain.n
    width = count + 1
    for k in range(count):
        for i in range(m):
            walk.chunk[k * m + i] = dot(n, walk.jacobian[i * (n + 1) :], lines[k * n :])
    filled(m, 0.0, walk.chunk[count * m :])
    filled(width * width, 0.0, walk.triangle)
    append_rows(width, m, m, walk.chunk, walk.triangle)
    singular_values(count, walk.triangle, walk.square, walk.axes, walk.singular)


def terms_along(walk: Walk, m: Integer, k: Integer, lines: ConstantReals) -> Real:
    """The size of what m rows say of the open axis k, were there no cancellation."""
    n = walk.chain.n
    d = walk.open_count
    squares = 0.0
    for i in range(m):
        total = 0.0
        for j in range(d):
            for part in range(n):
                total += fabs(walk.jacobian[i * (n + 1) + part] * walk.axes[k * d + j] * lines[j * n + part])
        squares += total * total
    return sqrt(squares)


def turn_open(walk: Walk, m: Integer, lines: ConstantReals) -> Integer:
    """Turn the open vectors so that those which m rows determine come first; how many these are.

    ``lines`` are the open vectors about the point where the rows are.
    """
    n = walk.chain.n
    d = walk.open_count
    if d == 0 or m == 0:
        return 0
    see_along(walk, m, d, lines)
    found = 0
    for k in range(d):
        filled(n, 0.0, walk.square[k * n :])
        for j in range(d):
            add_multiple(n, walk.axes[k * d + j], walk.open[j * n :], walk.square[k * n :])
        if walk.singular[k] > UNSEEN * max(walk.singular[0], terms_along(walk, m, k, lines)):
            found += 1
    copied(d * n, walk.square, walk.open)
    return found


def set_triangle_of(walk: Walk, m: Integer, free: Integer, size: Integer) -> None:
    """The triangle of the m lines over the ``local`` vectors, of which ``free`` have no prior, and its solution."""
    n = walk.chain.n
    width = size + 1
    for i in range(m):
        line = walk.jacobian[i * (n + 1) :]
        right = line[n]
        for j in range(size):
            value = dot(n, line, walk.local[j * n :])
            walk.chunk[j * m + i] = value
            right -= value * walk.share[j]
        walk.chunk[size * m + i] = right
    filled(width * width, 0.0, walk.triangle)
    for j in range(free, size):
        walk.triangle[j * width + j] = 1.0
    append_rows(width, m, m, walk.chunk, walk.triangle)
    corner(size, width, walk.triangle, walk.square)
    for i in range(size):
        walk.wanted[i] = -walk.triangle[i * width + size]
    solve_upper(size, walk.square, walk.wanted)


def place_share(walk: Walk, size: Integer) -> None:
    """Let `trial` be the point of the coefficients `share`, and `step` what leads there."""
    n = walk.chain.n
    filled(n, 0.0, walk.step)
    for j in range(size):
        add_multiple(n, walk.share[j], walk.basis[j * n :], walk.step)
    retract(walk.seen, walk.mean, walk.step, walk.trial)


def cost_of_share(walk: Walk, free: Integer, size: Integer) -> Real:
    """``|θ|² + |r|²`` there; `FIRST_COST` where what is known of a rotation would count turns that change nothing."""
    place_share(walk, size)
    if longest_turn(walk.seen, walk.step) > (pi if free == 0 else 2.0 * pi):
        return FIRST_COST
    found = step_cost(walk, walk.trial) + dot(size - free, walk.share[free:], walk.share[free:])
    return found if isfinite(found) else FIRST_COST


def best_part(walk: Walk, cost: Real, found: Real, promise: Real) -> Real:
    """The part of a step that leads to the vertex of the parabola on the way; 1 where that is not worth a trial.

    The step promises to lower the ``cost`` by ``promise``, and it is ``found`` at its end. Gauss-Newton's steps go too
    far where residuals bend the cost upwards, and not far enough where losses leave less curvature than weight. A long
    step leaves to the next one, a whole one, what bends as promised: else the two would correct one another for ever.
    """
    stretched = walk.stretched
    walk.stretched = 0
    part = walk.vertex
    if found >= FIRST_COST:
        return 1.0
    if promise > TOLD * cost:
        curvature = 2.0 + (found - cost) / promise
        part = LONGEST if curvature * LONGEST < 1.0 else max(1.0 / curvature, SHORTEST)
        if stretched == 0:
            walk.vertex = part
    if stretched == 1:
        part = min(part, 1.0)
    return 1.0 if part > ALMOST and part * ALMOST < 1.0 else part


def cost_of_part(walk: Walk, free: Integer, size: Integer, part: Real) -> Real:
    """The cost after a ``part`` of the step ``along`` that leads to `wanted`; `share` is there then."""
    for j in range(size):
        walk.share[j] = walk.wanted[j] - (1.0 - part) * walk.along[j]
    return cost_of_share(walk, free, size)


def shortened_share(walk: Walk, free: Integer, size: Integer, cost: Real) -> Real:
    """The cost after a step from `share` towards `wanted` that lowers it; `FIRST_COST` where none does.

    `along` is the whole step.
    """
    times_upper(size, walk.square, walk.along, walk.singular_step)
    promise = dot(size, walk.singular_step, walk.singular_step)
    whole = cost_of_part(walk, free, size, 1.0)
    part = best_part(walk, cost, whole, promise)
    found = whole
    if part != 1.0:
        found = cost_of_part(walk, free, size, part)
        if found >= whole and promise > TOLD * cost:
            part = 1.0
            found = cost_of_part(walk, free, size, part)
    walk.stretched = 1 if part > 1.0 else 0
    for _ in range(MOST_HALVINGS):
        if found <= (1.0 + ROUNDING_OF_COST) * cost - 2.0 * ENOUGH_DECREASE * part * promise:
            return found
        part *= 0.5
        found = cost_of_part(walk, free, size, part)
    for j in range(size):
        walk.share[j] = walk.wanted[j] - walk.along[j]
    place_share(walk, size)
    return FIRST_COST


def descend(walk: Walk, m: Integer, free: Integer, size: Integer, start: Real) -> Real:
    """The cost where Gauss-Newton's method ends, from `share` on: its cost is ``start``, its m lines are known."""
    lines = m
    cost = start
    walk.stretched = 0
    walk.vertex = 1.0
    for _ in range(walk.chain.iterations):
        set_triangle_of(walk, lines, free, size)
        walk.iterations += 1
        for j in range(size):
            walk.along[j] = walk.wanted[j] - walk.share[j]
        times_upper(size, walk.square, walk.along, walk.singular_step)
        length = sqrt(dot(size, walk.singular_step, walk.singular_step))
        found = shortened_share(walk, free, size, cost)
        if found < FIRST_COST:
            cost = found
        if not length > walk.tolerance:
            return cost
        if not found < FIRST_COST:
            break
        lines = lines_at_share(walk, size)
    walk.settled = 0
    return cost


def lines_at_share(walk: Walk, size: Integer) -> Integer:
    """The lines, and the vectors, about the point of `share`, where `trial` is."""
    n = walk.chain.n
    copied(size * n, walk.basis, walk.local)
    transport(walk.seen, walk.mean, walk.step, size, walk.turn, walk.local)
    return step_lines(walk, walk.trial)


def iterate_update(walk: Walk, m: Integer, free: Integer, size: Integer) -> Real:
    """Least squares in the coefficients, from the lines at the mean on; what the rows add to the cost."""
    chain = walk.chain
    n = chain.n
    filled(size, 0.0, walk.share)
    copied(size * n, walk.basis, walk.local)
    if chain.iterations == 1:
        set_triangle_of(walk, m, free, size)
        copied(size, walk.wanted, walk.share)
        place_share(walk, size)
        root = walk.triangle[(size + 1) * (size + 1) - 1]
        return root * root
    if chain.rivals == 1 and free > 0:
        return narrowed_share(walk, free, size)
    cost = descend(walk, m, free, size, cost_of_share(walk, free, size))
    if chain.rivals == 1 and step_cost(walk, walk.trial) < COUNTED * plain_step_cost(walk, walk.trial):
        return least_of_minima(walk, free, size, cost)
    return cost


def narrowed_share(walk: Walk, free: Integer, size: Integer) -> Real:
    """The cost where `share` leads with losses that are wide at first, and become those that are stated (graduated
    non-convexity).
    """
    settled = walk.settled
    factor = WIDEST
    while factor > 1.0:
        widen_losses(walk, factor)
        place_share(walk, size)
        plain = descend(walk, lines_at_share(walk, size), free, size, cost_of_share(walk, free, size))
        factor = min(NARROWER * factor, sqrt(plain))
    walk.rows.constants = walk.stated
    walk.settled = settled
    found = cost_of_share(walk, free, size)
    return descend(walk, lines_at_share(walk, size), free, size, found)


def least_of_minima(walk: Walk, free: Integer, size: Integer, cost: Real) -> Real:
    """The least cost of the minimum where `share` is and of the one that least squares lead to; `share` is there then.

    Rows that a loss leaves out where they were predicted may all the same be worth a change of what was predicted.
    """
    settled = walk.settled
    copied(size, walk.share, walk.rival)
    found = narrowed_share(walk, free, size)
    if found < cost and walk.settled >= settled:
        return found
    walk.settled = settled
    copied(size, walk.rival, walk.share)
    found = cost_of_share(walk, free, size)
    return descend(walk, lines_at_share(walk, size), free, size, found)


def best_point(walk: Walk) -> Integer:
    """Let `trial` be where the rows that are loaded and what is known at `point` balance; how many vectors lead there.

    0: there are no rows; -1: something is not finite. `free` are the open vectors among these.
    """
    chain = walk.chain
    n = chain.n
    if chain.rivals == 1 and walk.open_count > 0:
        widen_losses(walk, WIDEST)  # rows tell of what nothing is known, however far they are from where it begins
    m = step_lines(walk, walk.point)
    walk.rows.constants = walk.stated
    walk.last_cost = 0.0
    if m == 0:
        return 0
    free = turn_open(walk, m, walk.open)
    size = free + n
    copied(free * n, walk.open, walk.basis)
    copied(n * n, walk.factor, walk.basis[free * n :])
    copied(chain.numbers, walk.point, walk.mean)
    walk.last_cost = iterate_update(walk, m, free, size)
    finite = walk.last_cost
    for j in range(chain.numbers):
        finite += walk.trial[j] * 0.0
    walk.free = free
    return size if isfinite(finite) and walk.last_cost < FIRST_COST else -1


def update(walk: Walk) -> Integer:
    """The step whose rows are loaded, at `point`, with what they say; 0 where something is not finite."""
    chain = walk.chain
    n = chain.n
    size = best_point(walk)
    if size <= 0:
        return 1 + size
    free = walk.free
    copied(chain.numbers, walk.trial, walk.point)
    copied(size * n, walk.basis, walk.local)
    set_new_factor(walk, size)
    walk.open_count -= free
    copied(walk.open_count * n, walk.open[free * n :], walk.square)
    copied(walk.open_count * n, walk.square, walk.open)
    transport(walk.seen, walk.mean, walk.step, walk.open_count, walk.turn, walk.open)
    if chain.pools > 0:
        transport(walk.seen, walk.mean, walk.step, size, walk.turn, walk.local)
        transport(walk.seen, walk.mean, walk.step, n, walk.turn, walk.errors)
        spread_update(walk, walk.point, free, size, 1)
    return 1


def set_new_factor(walk: Walk, size: Integer) -> None:
    """The factor ``T⁻ᵀ B`` about the new point, as n vectors again."""
    n = walk.chain.n
    for i in range(size):
        own = walk.basis[i * n :]
        for k in range(i):
            add_multiple(n, -walk.square[k * size + i], walk.basis[k * n :], own)
        for j in range(n):
            own[j] /= walk.square[i * size + i]
    transport(walk.seen, walk.mean, walk.step, size, walk.turn, walk.basis)
    if size == n:
        copied(n * n, walk.basis, walk.factor)
        return
    to_columns(size, n, size, walk.basis, walk.chunk)
    filled(n * n, 0.0, walk.factor)
    append_rows(n, size, size, walk.chunk, walk.factor)
