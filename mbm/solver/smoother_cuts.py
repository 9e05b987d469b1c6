"""Inequalities in a smoother: for each stands a row that does to all else what the inequality does.

Given everything else, a scalar of a step is about normal; an inequality cuts it, and what is left has another mean and
variance. The row that makes the one normal distribution the other is ``√τ (value − μ)`` with a precision τ ≥ 0. As
all these rows depend on one another they are found anew until none changes: expectation
propagation (Minka 2001; of truncated normal distributions Cunningham, Hennig and Lacoste-Julien 2011). Each inequality
counts once, however often its row is found anew, and no order of theirs matters.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.constraint_values import evaluate_block
from mbm.solver.description import BOUNDS_AT
from mbm.solver.equations import groups_of
from mbm.solver.filter_cuts import cut_mean, put_row_of_cut
from mbm.solver.filter_records import Walk, load_step
from mbm.solver.linear_algebra import dot, filled

RENEWED = 0.7
"""The share of the way to its new row that each goes at a time: all go at once, and where many say nearly the same
(of a state that hardly moves) they would go too far together."""

STILL_CUT = 1e-6
"""What new rows still change, of standard deviations or variances, when they are found."""

OWN = 1e-9
"""What all others know of a value, as a share of what its own row says, up to which it is rounding."""


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


def cost_of_cuts(walk: Walk, k: Integer) -> Real:
    """What the rows of the inequalities of step k add to the cost where `put_cuts` was."""
    total = 0.0
    for c in range(walk.chain.cuts):
        row = walk.cuts[2 * (k * walk.chain.cuts + c) :]
        if row[0] > 0.0:
            residual = sqrt(row[0]) * walk.cut_values[c] - row[1] / sqrt(row[0])
            total += residual * residual
    return total


def cut_cost(walk: Walk, k: Integer, point: ConstantReals) -> Real:
    """The same at a point; the rows of the step are loaded."""
    if walk.chain.cuts == 0:
        return 0.0
    put_cuts(walk, k, point)
    return cost_of_cuts(walk, k)


def renew_cut(walk: Walk, k: Integer, c: Integer) -> Real:
    """A new row for an inequality of step k, by the answer; how far it moves the mean, in standard deviations, or by
    what share of its inverse the variance, whichever is more.
    """
    n = walk.chain.n
    slope = walk.cut_slopes[c * n :]
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
    if not others > OWN * row[0]:
        return 0.0
    mean = (walk.cut_values[c] / square - row[1]) / others
    put_row_of_cut(mean, 1.0 / others, walk.wanted)
    narrower = square * fabs(walk.wanted[0] - row[0])
    row[0] += RENEWED * (walk.wanted[0] - row[0])
    row[1] += RENEWED * (walk.wanted[1] - row[1])
    aim = mean + cut_mean(-mean * sqrt(others)) / sqrt(others)
    return max(narrower, fabs(aim - walk.cut_values[c]) / sqrt(square))


def renew_cuts(walk: Walk) -> Integer:
    """New rows for all inequalities, by the answers for all steps; 1: they are found. The cost loses what they add."""
    chain = walk.chain
    most = 0.0
    for k in range(chain.steps):
        load_step(walk, k)
        put_cuts(walk, k, walk.points[k * chain.numbers :])
        walk.last_cost -= cost_of_cuts(walk, k)
        for c in range(chain.cuts):
            most = max(most, renew_cut(walk, k, c))
    return 1 if most <= STILL_CUT else 0
