"""Where rows say nothing of a direction: the state that is mirrored there (Shimada et al. 1997, section 5).

Along a direction d of the state, the rows at ``x ⊞ t d`` vary by ``g(t) = J(x ⊞ t d) d``. Where g vanishes within two
standard deviations, and does not nearby, they are the same on both sides: nothing tells ``x`` from ``x ⊞ 2 t d``.
Directions are those of single coordinates, then those that the rows determine least.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import Integer, Real, Reals
from mbm.solver.filter_records import Walk, step_lines
from mbm.solver.filter_update import see_along
from mbm.solver.linear_algebra import add_multiple, column_product, copied, dot, filled
from mbm.solver.manifolds import retract

REACH = 2.0
"""Standard deviations within which a mirror is looked for …"""

PARTS = 8
"""… in so many parts."""

REFINED = 8
"""Further points at which the part with the mirror is looked into."""

BENT = 1.0
"""Rows whose slopes vary by less than this over all of it, in standard deviations, are straight: there is no mirror."""

VANISHED = 0.1
"""Share of that variation which slopes may have at the mirror."""

NEAREST = 0.05
"""Standard deviations up to which a mirror is where the state is: both sides are one."""


def set_slopes(walk: Walk, part: Real, target: Reals) -> Integer:
    """``g(part)`` (m,); m."""
    n = walk.chain.n
    for j in range(n):
        walk.step[j] = part * walk.way[j]
    retract(walk.seen, walk.point, walk.step, walk.trial)
    m = step_lines(walk, walk.trial)
    for i in range(m):
        target[i] = dot(n, walk.jacobian[i * (n + 1) :], walk.way)
    return m


def mirror_along(walk: Walk) -> Real:
    """Where along `way` rows say nothing of it; 0 where that is nowhere."""
    low = walk.way_slopes
    high = walk.way_slopes[walk.chain.lines :]
    here = walk.way_slopes[2 * walk.chain.lines :]
    m = set_slopes(walk, -REACH, low)
    set_slopes(walk, REACH, high)
    for i in range(m):
        high[i] -= low[i]
    bend = dot(m, high, high)
    if not bend > BENT * BENT:
        return 0.0
    found = 0.0
    before = dot(m, low, high)
    at = -REACH
    for part in range(PARTS):
        ahead = -REACH + 2.0 * REACH * float(part + 1) / float(PARTS)
        set_slopes(walk, ahead, here)
        after = dot(m, here, high)
        if before * after <= 0.0 and after != before:
            begin = at
            end = ahead
            value = before
            for _ in range(REFINED):
                middle = 0.5 * (begin + end)
                set_slopes(walk, middle, here)
                if dot(m, here, high) * value <= 0.0:
                    end = middle
                else:
                    begin = middle
            middle = 0.5 * (begin + end)
            set_slopes(walk, middle, here)
            small = dot(m, here, here) <= VANISHED * VANISHED * bend
            if small and (found == 0.0 or fabs(middle) < fabs(found)):
                found = middle
        before = after
        at = ahead
    return found if fabs(found) > NEAREST else 0.0


def reflect(walk: Walk, vector: Reals) -> None:
    """A vector of coordinates (n,) mirrored across `way`, in units of standard deviations; rates likewise."""
    n = walk.chain.n
    length = 0.0
    along = 0.0
    turning = 0.0
    for j in range(n):
        if walk.way[j] != 0.0:
            share = walk.way[j] / walk.along[j]
            length += share * share
            along += share * vector[j] / walk.along[j]
            if walk.rates[j] >= 0:
                turning += share * vector[walk.rates[j]] / walk.along[j]
    for j in range(n):
        if walk.way[j] != 0.0:
            share = walk.way[j]
            vector[j] -= 2.0 * along / length * share
            if walk.rates[j] >= 0:
                vector[walk.rates[j]] -= 2.0 * turning / length * share


def put_mirror(walk: Walk, part: Real) -> None:
    """The state and its factor, mirrored at ``part`` of the way; its rate too."""
    chain = walk.chain
    n = chain.n
    filled(n, 0.0, walk.wanted)
    for j in range(n):
        if walk.rates[j] >= 0 and walk.seen.number_of[walk.rates[j]] >= 0:
            walk.wanted[walk.rates[j]] = walk.point[walk.seen.number_of[walk.rates[j]]]
    copied(n, walk.wanted, walk.share)
    reflect(walk, walk.wanted)
    for j in range(n):
        walk.step[j] = 2.0 * part * walk.way[j]
        if walk.rates[j] == -2:
            walk.step[j] = walk.wanted[j] - walk.share[j]
    retract(walk.seen, walk.point, walk.step, walk.mirror_point)
    copied(n * n, walk.factor, walk.mirror_factor)
    for i in range(n):
        reflect(walk, walk.mirror_factor[i * n :])


def may_be_mirrored(walk: Walk, j: Integer) -> Integer:
    """1 for coordinates that move, are numbers, and no rates."""
    if j < walk.chain.still or walk.seen.number_of[j] < 0 or walk.rates[j] == -2:
        return 0
    return 1 if walk.along[j] > 0.0 else 0


def mirror(walk: Walk) -> Integer:
    """1 where the state at hand is also to be continued mirrored: `mirror_point` and `mirror_factor`."""
    n = walk.chain.n
    for j in range(n):
        walk.along[j] = sqrt(column_product(n, n, walk.factor[j:], walk.factor[j:]))
    m = step_lines(walk, walk.point)
    if m == 0:
        return 0
    see_along(walk, m, n, walk.factor)
    for number in range(2 * n):
        filled(n, 0.0, walk.way)
        fine = 0
        if number < n:
            fine = may_be_mirrored(walk, number)
            walk.way[number] = walk.along[number]
        elif walk.singular[2 * n - 1 - number] < BENT:
            fine = 1
            for i in range(n):
                add_multiple(n, walk.axes[(2 * n - 1 - number) * n + i], walk.factor[i * n :], walk.way)
            for j in range(n):
                if may_be_mirrored(walk, j) == 0:
                    walk.way[j] = 0.0
        if fine == 1 and dot(n, walk.way, walk.way) > 0.0:
            part = mirror_along(walk)
            if part != 0.0:
                put_mirror(walk, part)
                return 1
    return 0
