"""Inequalities in a smoother: for each stands a row that does to all else what the inequality does.

Given everything else, a scalar of a step is about normal; an inequality cuts it, and what is left has another mean and
variance. The row that makes the one normal distribution the other is ``√τ (value − μ)`` with a precision τ ≥ 0. As
all these rows depend on one another they are found anew until none changes: expectation
propagation (Minka 2001; of truncated normal distributions Cunningham, Hennig and Lacoste-Julien 2011). Each inequality
counts once, however often its row is found anew, and no order of theirs matters. All those of one quantity at a step
are one cut, between the limits that they leave it; where these contradict one another, between the two all the same.
Those of one quantity that does not move are one cut over all steps.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.constraint_values import evaluate_block
from mbm.solver.description import BOUNDS_AT
from mbm.solver.equations import groups_of
from mbm.solver.filter_cuts import put_row_of_cut
from mbm.solver.filter_records import Walk, load_step, step_cost
from mbm.solver.linear_algebra import copied, dot, filled

RENEWED = 0.7
"""The share of the way to its new row that each goes at a time: all go at once, and where many say nearly the same
(of a state that hardly moves) they would go too far together."""

STILL_CUT = 1e-6
"""What new rows still change, of standard deviations or variances, when they are found."""

OWN = 1e-9
"""What all others know of a value, as a share of what its own row says, up to which it is rounding. What they know
more surely than one over this to be beyond a limit, by the square of its deviations, contradicts it: it stays."""

LEAST_WIDTH = 1e-6
"""The least width of what limits leave, in deviations of what all others know: between equal ones it would be 0."""

SAME_SLOPE = 1e-12
"""A share by which slopes differ through rounding."""


def put_cuts(walk: Walk, k: Integer, point: ConstantReals) -> None:
    """Values and slopes of the inequalities of step k, whose rows are loaded: bounds, then in source order.

    Those of what does not move hold once, at the first step with rows.
    """
    chain = walk.chain
    n = chain.n
    problem = walk.seen
    bounds = walk.rows.constants[BOUNDS_AT:]
    filled(chain.cuts, 0.0, walk.cut_values)
    filled(chain.cuts * n, 0.0, walk.cut_slopes)
    for j in range(n):
        place = problem.number_of[j]
        if place >= 0 and (k == chain.begin or j >= chain.still):
            if isfinite(bounds[j]):
                walk.cut_values[2 * j] = bounds[j] - point[place]
                walk.cut_slopes[2 * j * n + j] = -1.0
            if isfinite(bounds[n + j]):
                walk.cut_values[2 * j + 1] = point[place] - bounds[n + j]
                walk.cut_slopes[(2 * j + 1) * n + j] = 1.0
    inputs = 0
    done = 2 * n
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        count = walk.rows.data.blocks[b].rows
        if b >= problem.residual_blocks:
            values = walk.cut_values[done:]
            slopes = walk.cut_slopes[done * n :]
            evaluate_block(problem, b, walk.rows, walk.rows.inputs[inputs:], point, 1, values, slopes)
            done += count * problem.blocks[b].outputs
        inputs += groups_of(count) * (problem.blocks[b].variables + problem.blocks[b].parameters) * LANES


def cut_lines(walk: Walk, k: Integer, point: ConstantReals, lines: Reals) -> Integer:
    """The rows of the inequalities of step k, whose rows are loaded, as lines (…, n + 1) of ``[J r]``; how many."""
    chain = walk.chain
    n = chain.n
    if chain.cuts == 0:
        return 0
    put_cuts(walk, k, point)
    done = 0
    for c in range(chain.cuts):
        row = walk.cuts[2 * (k * chain.cuts + c) :]
        if row[0] > 0.0:
            root = sqrt(row[0])
            line = lines[done * (n + 1) :]
            for j in range(n):
                line[j] = root * walk.cut_slopes[c * n + j]
            line[n] = root * walk.cut_values[c] - row[1] / root
            done += 1
    return done


def cut_cost(walk: Walk, k: Integer, point: ConstantReals) -> Real:
    """What the rows of the inequalities of step k, whose rows are loaded, add to the cost at a point."""
    if walk.chain.cuts == 0:
        return 0.0
    put_cuts(walk, k, point)
    total = 0.0
    for c in range(walk.chain.cuts):
        row = walk.cuts[2 * (k * walk.chain.cuts + c) :]
        if row[0] > 0.0:
            residual = sqrt(row[0]) * walk.cut_values[c] - row[1] / sqrt(row[0])
            total += residual * residual
    return total


def share_of(n: Integer, slope: ConstantReals, other: ConstantReals) -> Real:
    """By what to multiply a slope that is not zero to get another one; 0: nothing does that."""
    share = 0.0
    for j in range(n):
        if slope[j] != 0.0 and share == 0.0:
            share = other[j] / slope[j]
    for j in range(n):
        if not fabs(other[j] - share * slope[j]) <= SAME_SLOPE * fabs(other[j]):
            return 0.0
    return share


def still_place(walk: Walk, c: Integer) -> Integer:
    """Where an inequality of the step that is loaded is kept among those of what does not move, or goes; below 0:
    nowhere, as it moves or there are too many.
    """
    chain = walk.chain
    n = chain.n
    slope = walk.cut_slopes[c * n :]
    moving = walk.cut_slopes[c * n + chain.still :]
    if dot(n - chain.still, moving, moving) > 0.0 or not dot(n, slope, slope) > 0.0:
        return -1
    for r in range(chain.cuts):
        if walk.still_owners[r] < 0 or share_of(n, walk.still_slopes[r * n :], slope) != 0.0:
            return r
    return -1


def put_still_cuts(walk: Walk) -> None:
    """The limits that all steps leave to what does not move."""
    chain = walk.chain
    n = chain.n
    for r in range(chain.cuts):
        walk.still_owners[r] = -1
    for k in range(chain.steps if chain.still > 0 else 0):
        load_step(walk, k)
        put_cuts(walk, k, walk.points[k * chain.numbers :])
        for c in range(chain.cuts):
            r = still_place(walk, c)
            if r >= 0:
                slope = walk.still_slopes[r * n :]
                kept = walk.still_limits[3 * r :]
                if walk.still_owners[r] < 0:
                    walk.still_owners[r] = k * chain.cuts + c
                    copied(n, walk.cut_slopes[c * n :], slope)
                    kept[0] = walk.cut_values[c]
                    kept[1] = -inf
                    kept[2] = 0.0
                else:
                    share = share_of(n, slope, walk.cut_slopes[c * n :])
                    own = walk.cuts[2 * walk.still_owners[r] :]
                    take_limit(share, kept[0] - walk.cut_values[c] / share, k * chain.cuts + c, walk, kept[1:], own)


def take_limit(share: Real, limit: Real, place: Integer, walk: Walk, limits: Reals, row: Reals) -> None:
    """What another inequality, of which a value is the share, makes of its limits, low and high, and of its row."""
    if share > 0.0:
        limits[1] = min(limits[1], limit)
    else:
        limits[0] = max(limits[0], limit)
    other = walk.cuts[2 * place :]
    row[0] += share * share * other[0]
    row[1] += share * (other[1] + share * other[0] * limit)
    other[0] = 0.0
    other[1] = 0.0


def limits_of_cut(walk: Walk, k: Integer, c: Integer, limits: Reals) -> Integer:
    """Between which limits, low and high, all inequalities of step k hold the value of one, or those of all steps what
    does not move; 0: one before it does so.

    The rows of those behind it, of which it is the share that `share_of` says, become part of its own.
    """
    n = walk.chain.n
    cuts = walk.chain.cuts
    slope = walk.cut_slopes[c * n :]
    if not dot(n, slope, slope) > 0.0:
        return 0
    kept = still_place(walk, c)
    if kept >= 0:
        if walk.still_owners[kept] != k * cuts + c:
            return 0
        limits[0] = walk.still_limits[3 * kept + 1]
        limits[1] = walk.still_limits[3 * kept + 2]
    else:
        for before in range(c):
            if share_of(n, slope, walk.cut_slopes[before * n :]) != 0.0:
                return 0
        limits[0] = -inf
        limits[1] = 0.0
        for behind in range(c + 1, cuts):
            share = share_of(n, slope, walk.cut_slopes[behind * n :])
            if share != 0.0:
                limit = walk.cut_values[c] - walk.cut_values[behind] / share
                take_limit(share, limit, k * cuts + behind, walk, limits, walk.cuts[2 * (k * cuts + c) :])
    if limits[0] > limits[1]:
        contrary = limits[0]
        limits[0] = limits[1]
        limits[1] = contrary
    return 1


def renew_cut(walk: Walk, k: Integer, c: Integer) -> Real:
    """A new row for an inequality of step k, by the answer; how far it moves the mean, in standard deviations, or by
    what share of its inverse the variance, whichever is more.
    """
    n = walk.chain.n
    slope = walk.cut_slopes[c * n :]
    limits = walk.share
    if limits_of_cut(walk, k, c, limits) == 0:
        return 0.0
    row = walk.cuts[2 * (k * walk.chain.cuts + c) :]
    square = 0.0
    for i in range(n):
        along = dot(n, walk.factors[(k * n + i) * n :], slope)
        square += along * along
    for j in range(n):
        if slope[j] != 0.0 and walk.touched[k * n + j] == 1:
            square = 0.0
    if not square > 0.0:
        row[0] = 0.0
        row[1] = 0.0
        return 0.0
    others = 1.0 / square - row[0]
    mean = (walk.cut_values[c] / square - row[1]) / others
    beyond = max(mean - limits[1], limits[0] - mean)
    if not others > OWN * row[0] or (beyond > 0.0 and OWN * others * beyond * beyond > 1.0):
        return 0.0
    wanted = walk.wanted
    width = max(limits[1] - limits[0], LEAST_WIDTH / sqrt(others))
    high = limits[1] if width == limits[1] - limits[0] else 0.5 * (limits[0] + limits[1] + width)
    put_row_of_cut(mean - high, 1.0 / others, width, wanted)
    wanted[1] += wanted[0] * high
    narrower = square * fabs(wanted[0] - row[0])
    aim = (others * mean + wanted[1]) / (others + wanted[0])
    part = 1.0 if OWN * wanted[0] > others else RENEWED
    row[0] += part * (wanted[0] - row[0])
    row[1] += part * (wanted[1] - row[1])
    return max(narrower, fabs(aim - walk.cut_values[c]) / sqrt(square))


def renew_cuts(walk: Walk) -> Integer:
    """New rows for all inequalities, by the answers for all steps; 1: they are found. The cost is without theirs."""
    chain = walk.chain
    most = 0.0
    put_still_cuts(walk)
    cost = dot(chain.n, walk.base_share, walk.base_share)
    cost += dot((chain.steps - 1) * chain.noises, walk.noises, walk.noises)
    for k in range(chain.steps):
        point = walk.points[k * chain.numbers :]
        load_step(walk, k)
        cost += step_cost(walk, point)
        put_cuts(walk, k, point)
        for c in range(chain.cuts):
            most = max(most, renew_cut(walk, k, c))
    walk.last_cost = cost
    return 1 if most <= STILL_CUT else 0
