"""Constraints of a step: the distribution is cut by one half space after the other (Shimada et al. 1997, eqs 21-29).

In the coordinates in which the distribution is a standard normal one a cut acts along one direction u alone: the mean
goes by ν along u, and the variance along u becomes τ. So the factor U becomes ``U + (√τ − 1) u (uᵀU)``, which
stays a factor. An equality leaves no variance along u: it is a measurement without noise, and adds the square of its
innovation, over its variance, to the cost.

A normal distribution cut by a half space: its mean and variance across the cut (Shimada et al. 1997, eqs 24-29).

For ``x ~ N(0, 1)`` given ``x ≤ c``: mean ν = −φ(c)/Φ(c), variance τ = 1 + cν − ν². Equation (27) as printed divides 0
by 0 for cuts far on the left, and τ cancels there: both come from the continued fraction of Mills' ratio instead,
whose tail is what is left after the cancellation. Between two limits both are sums over the interval.
"""

from __future__ import annotations

from math import exp, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.charts import transport
from mbm.solver.constraint_values import evaluate_block
from mbm.solver.description import BOUNDS_AT
from mbm.solver.equations import groups_of
from mbm.solver.filter_records import Walk
from mbm.solver.linear_algebra import add_multiple, column_product, copied, dot, filled
from mbm.solver.manifolds import retract

KNOWN_BEFORE = 1e-24
"""A variance that is this share of what it is the sum of, or was before an equality, is rounding: nothing is left."""


def cut_along(walk: Walk, equality: Integer, value: Real, slope: ConstantReals, place: Integer) -> None:
    """The distribution where ``value + slopeᵀ d`` is not above zero, or is zero; d are coordinates about the mean.

    An inequality cuts nothing of what nothing is known of yet. A smoother begins with the row that it is, at ``place``.
    """
    n = walk.chain.n
    unknown = open_square(walk, slope)
    if unknown > 0.0:
        if equality == 1 and isfinite(unknown + value):
            close_along(walk, value, slope, unknown)
        return
    direction = walk.singular_step
    square = 0.0
    terms = 0.0
    for i in range(n):
        direction[i] = dot(n, walk.factor[i * n :], slope)
        square += direction[i] * direction[i]
        for j in range(n):
            term = walk.factor[i * n + j] * slope[j]
            terms += term * term
    if not square > KNOWN_BEFORE * terms or not isfinite(square + value):
        return
    deviation = sqrt(square)
    distance = -value / deviation
    shift = distance
    left = 0.0
    if equality == 0:
        if distance > walk.skip:
            return
        shift = cut_mean(distance)
        left = sqrt(cut_variance(distance))
        if walk.chain.cuts > 0:
            put_row_of_cut(value, square, inf, walk.cuts[2 * place :])
    else:
        walk.last_cost += distance * distance
        walk.last_equations += 1
    filled(n, 0.0, walk.along)
    for i in range(n):
        add_multiple(n, direction[i] / deviation, walk.factor[i * n :], walk.along)
    for j in range(n):
        column = walk.factor[j:]
        before = column_product(n, n, column, column)
        for i in range(n):
            column[i * n] += (left - 1.0) * direction[i] / deviation * walk.along[j]
        if equality == 1 and column_product(n, n, column, column) <= KNOWN_BEFORE * before:
            for i in range(n):
                column[i * n] = 0.0
        walk.step[j] = shift * walk.along[j]
    go_along(walk)


def put_row_of_cut(mean: Real, variance: Real, width: Real, row: Reals) -> None:
    """The row that makes of a normal distribution what is left of it from ``-width`` to 0: precision, and precision
    times mean.
    """
    deviation = sqrt(variance)
    distance = -mean / deviation
    put_moments(distance, width / deviation, row)
    below = row[0]
    left = row[1]
    row[0] = (1.0 - left) / (left * variance)
    row[1] = (distance - below / left) / deviation


def open_square(walk: Walk, slope: ConstantReals) -> Real:
    """The square of how much a value changes along the open vectors, by `share` along each; 0: it is known."""
    n = walk.chain.n
    square = 0.0
    terms = 0.0
    for k in range(walk.open_count):
        walk.share[k] = dot(n, walk.open[k * n :], slope)
        square += walk.share[k] * walk.share[k]
        for j in range(n):
            term = walk.open[k * n + j] * slope[j]
            terms += term * term
    return square if square > KNOWN_BEFORE * terms else 0.0


def close_along(walk: Walk, value: Real, slope: ConstantReals, square: Real) -> None:
    """An equality of what was open until now, with its `open_square`: nothing is compared, the cost stays as it is.

    The open vectors are turned so that one alone changes the value. The mean goes along it, and the vectors of the
    factor go so far along it that they change nothing any more (a measurement without noise of what has no prior).
    """
    n = walk.chain.n
    count = walk.open_count
    seen = walk.share
    turned = -sqrt(square) if seen[0] > 0.0 else sqrt(square)
    seen[0] -= turned
    norm = dot(count, seen, seen)
    for j in range(n):
        away = 0.0
        for k in range(count):
            away += seen[k] * walk.open[k * n + j]
        for k in range(count):
            walk.open[k * n + j] -= 2.0 * away / norm * seen[k]
    for i in range(n):
        own = walk.factor[i * n :]
        add_multiple(n, -dot(n, own, slope) / turned, walk.open, own)
    filled(n, 0.0, walk.step)
    add_multiple(n, -value / turned, walk.open, walk.step)
    walk.open_count -= 1
    for i in range(walk.open_count * n):
        walk.open[i] = walk.open[i + n]
    walk.last_equations += 1
    go_along(walk)


def go_along(walk: Walk) -> None:
    """The mean after `step`, and the vectors about it."""
    n = walk.chain.n
    copied(walk.chain.numbers, walk.point, walk.mean)
    retract(walk.seen, walk.mean, walk.step, walk.point)
    transport(walk.seen, walk.mean, walk.step, n, walk.turn, walk.factor)
    transport(walk.seen, walk.mean, walk.step, walk.open_count, walk.turn, walk.open)


def cut_bounds(walk: Walk, k: Integer) -> None:
    """Cuts by the bounds of all states at step k; at the first with rows of plain unknowns before."""
    chain = walk.chain
    n = chain.n
    at = k * chain.cuts
    bounds = walk.rows.constants[BOUNDS_AT:]
    for j in range(n):
        place = walk.seen.number_of[j]
        if place >= 0 and (k == chain.begin or j >= chain.plain):
            filled(n, 0.0, walk.limit_slopes)
            if isfinite(bounds[j]):
                walk.limit_slopes[j] = -1.0
                cut_along(walk, 0, bounds[j] - walk.point[place], walk.limit_slopes, at + 2 * j)
            if isfinite(bounds[n + j]):
                walk.limit_slopes[j] = 1.0
                cut_along(walk, 0, walk.point[place] - bounds[n + j], walk.limit_slopes, at + 2 * j + 1)


def put_limits(walk: Walk, b: Integer, inputs: Reals) -> None:
    """Values and slopes of a block of constraints of the step, at `point`."""
    block = walk.seen.blocks[b]
    filled(block.outputs * walk.rows.data.blocks[b].rows * walk.chain.n, 0.0, walk.limit_slopes)
    evaluate_block(walk.seen, b, walk.rows, inputs, walk.point, 1, walk.limit_values, walk.limit_slopes)


def violation_along(walk: Walk, value: Real, slope: ConstantReals) -> Real:
    """By how many standard deviations an inequality is violated; 0 where these have no end."""
    n = walk.chain.n
    if open_square(walk, slope) > 0.0:
        return 0.0
    square = 0.0
    for i in range(n):
        along = dot(n, walk.factor[i * n :], slope)
        square += along * along
    return value / sqrt(square) if square > 0.0 and value > 0.0 else 0.0


def worst_violation(walk: Walk) -> Real:
    """The largest violation of an inequality or a bound of the step whose rows are loaded, in standard deviations."""
    chain = walk.chain
    n = chain.n
    problem = walk.seen
    bounds = walk.rows.constants[BOUNDS_AT:]
    found = 0.0
    for j in range(n):
        place = problem.number_of[j]
        if place >= 0:
            filled(n, 0.0, walk.limit_slopes)
            walk.limit_slopes[j] = 1.0
            beyond = max(bounds[j] - walk.point[place], walk.point[place] - bounds[n + j])
            found = max(found, violation_along(walk, beyond, walk.limit_slopes))
    inputs = 0
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        count = walk.rows.data.blocks[b].rows
        if b >= problem.residual_blocks:
            put_limits(walk, b, walk.rows.inputs[inputs:])
            for c in range(count * block.outputs):
                if block.equality[c % block.outputs] == 0:
                    found = max(found, violation_along(walk, walk.limit_values[c], walk.limit_slopes[c * n :]))
        inputs += groups_of(count) * (block.variables + block.parameters) * LANES
    return found


def cut_step(walk: Walk, k: Integer) -> None:
    """All cuts of step k, whose rows are loaded, in their order; each is linearised where those before have led."""
    chain = walk.chain
    problem = walk.seen
    walk.last_equations = 0
    if chain.cut == 1:
        cut_bounds(walk, k)
    inputs = 0
    place = k * chain.cuts + 2 * chain.n
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        count = walk.rows.data.blocks[b].rows
        if b >= problem.residual_blocks:
            for c in range(count * block.outputs):
                equality = block.equality[c % block.outputs]
                if chain.cut == 1 or equality == 1:
                    put_limits(walk, b, walk.rows.inputs[inputs:])
                    cut_along(walk, equality, walk.limit_values[c], walk.limit_slopes[c * chain.n :], place + c)
            place += count * block.outputs
        inputs += groups_of(count) * (block.variables + block.parameters) * LANES


FRACTION_FROM = 1.0
"""How far left of the mean a cut is from which the continued fraction serves."""

DEEP = 450.0
"""The fraction is as deep as this divided by the square of the distance, and `LEAST_DEEP`: its error falls as
``exp(−2 t √N)``, here below 1e-18."""

LEAST_DEEP = 12.0

NO_CUT = 37.0
"""Deviations beyond which nothing is cut off: φ is 1e-298, and 1/φ still a number (it is none from 37.7 on)."""

ROOT_TWO_PI = 2.5066282746310002
LOST = 80.0
"""Twice the logarithm of what is left out of a density: beyond ``exp(−40)`` of its largest between the limits."""

PANELS = 64
"""Of the quadrature between two limits: with five points each its error is below 1e-12, of what falls by e in a 40th
of the way as of a bell that ends 9 deviations on both sides."""

HALF_PANEL = 0.5 / PANELS
"""As a share of the way."""

SMALL_TERM = 1e-18
"""A term of the series is left out from this share of their sum on."""


def fraction_tail(distance: Real, level: Real) -> Real:
    """``t + (l + 1)/(t + (l + 2)/(t + …))``: the continued fraction of the hazard of a normal distribution."""
    most = level
    while most < level + LEAST_DEEP + DEEP / (distance * distance):
        most += 1.0
    found = distance
    while most > level:
        found = distance + most / found
        most -= 1.0
    return found


def share_below(cut: Real) -> Real:
    """``Φ(c) / φ(c)`` for c > −2 or so, by the series of positive terms ``c + c³/3 + c⁵/15 + …``."""
    term = cut
    total = cut
    odd = 1.0
    while term * term > SMALL_TERM * SMALL_TERM * total * total:
        odd += 2.0
        term *= cut * cut / odd
        total += term
    return 0.5 * ROOT_TWO_PI * exp(0.5 * cut * cut) + total


def cut_mean(cut: Real) -> Real:
    """ν: the mean of N(0, 1) given that it is at most ``cut``."""
    if cut > NO_CUT:
        return 0.0
    if cut < -FRACTION_FROM:
        return -fraction_tail(-cut, 0.0)
    return -1.0 / share_below(cut)


def cut_variance(cut: Real) -> Real:
    """τ: its variance."""
    if cut > NO_CUT:
        return 1.0
    if cut < -FRACTION_FROM:
        third = fraction_tail(-cut, 3.0)
        second = -cut + 3.0 / third
        first = -cut + 2.0 / second
        return (-cut + 4.0 / second - 3.0 / third) / (second * first * first)
    mean = cut_mean(cut)
    return 1.0 + cut * mean - mean * mean


def put_moments(cut: Real, width: Real, moments: Reals) -> None:
    """Of N(0, 1) between ``cut − width`` and ``cut``: how far its mean is below ``cut``, and its variance.

    Both come from sums of what is positive (Gauss and Legendre's rule of five points) over the way from the limit that
    is nearer to where the density is greatest: however thin the interval is, and however far off, little cancels.
    """
    other = 1 if 2.0 * cut - width > 0.0 else 0
    own = width - cut if other == 1 else cut
    near = min(own, 0.0)
    if width > own + sqrt(near * near + LOST):
        moments[0] = own - cut_mean(own)
        moments[1] = cut_variance(own)
    else:
        half = HALF_PANEL * width
        total = 0.0
        first = 0.0
        second = 0.0
        middle = half
        for _ in range(PANELS):
            for k in range(5):
                inner = 1.0 if k > 2 else -1.0
                node = sqrt(5.0 - 2.0 * inner * sqrt(10.0 / 7.0)) / 3.0
                weight = 322.0 + 13.0 * inner * sqrt(70.0)
                if k == 0:
                    node = 0.0
                    weight = 512.0
                way = middle + (half * node if k % 2 == 0 else -half * node)
                density = weight * exp(way * (own - 0.5 * way))
                total += density
                first += density * way
                second += density * way * way
            middle += 2.0 * half
        moments[0] = first / total
        moments[1] = second / total - moments[0] * moments[0]
    if other == 1:
        moments[0] = width - moments[0]
