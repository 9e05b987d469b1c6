"""Filters: prediction, update and cuts, step after step, of one hypothesis or of several.

A hypothesis is a mean, a factor and a cost. Where all rows say nothing of a direction within two standard deviations,
as of a joint that points at the camera, the state is also continued mirrored there (`filter_mirror`). The best are
followed on; the answer for a step is the best of all.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import Integer, Real
from mbm.solver.charts import step_between
from mbm.solver.filter_cuts import cut_step, worst_violation
from mbm.solver.filter_keeping import keep_step
from mbm.solver.filter_mirror import mirror
from mbm.solver.filter_moves import predict
from mbm.solver.filter_records import Walk, load_move, load_step
from mbm.solver.filter_update import update
from mbm.solver.linear_algebra import copied

DROPPED = 25.0
"""Above the cost of the best, from which a hypothesis is dropped: odds of 1 to 270,000."""

VIOLATED = 3.0
"""Standard deviations by which a hypothesis may violate a constraint."""

ALIKE = 0.5
"""Two hypotheses are one where no coordinate differs by this share of its standard deviation, or more."""


TIED = 0.1
"""Costs that differ by less, odds of 1.05 to 1, tell nothing: where a mirror is found moves them by some 1e-3. The one
that was ahead stays so, and a mirrored one comes behind the one that is not."""


def put_hypothesis(walk: Walk, place: Integer, cost: Real) -> None:
    """Let a place of the crowd hold what the walk holds."""
    chain = walk.chain
    copied(chain.numbers, walk.point, walk.crowd_points[place * chain.numbers :])
    copied(chain.n * chain.n, walk.factor, walk.crowd_factors[place * chain.n * chain.n :])
    walk.crowd_costs[place] = cost


def take_hypothesis(walk: Walk, place: Integer) -> None:
    """Let the walk hold what a place of the crowd holds."""
    chain = walk.chain
    copied(chain.numbers, walk.crowd_points[place * chain.numbers :], walk.point)
    copied(chain.n * chain.n, walk.crowd_factors[place * chain.n * chain.n :], walk.factor)


def updated(walk: Walk, k: Integer, place: Integer, cost: Real) -> Integer:
    """The walk's prediction with the rows of step k as a hypothesis at ``place``; 0 where something is not finite."""
    if update(walk) == 0:
        return 0
    violation = worst_violation(walk)
    cut_step(walk, k)
    put_hypothesis(walk, place, cost + walk.last_cost)
    walk.crowd_violations[place] = violation
    return 1


def alike(walk: Walk, place: Integer, other: Integer) -> Integer:
    """1 where two hypotheses are one; by the deviations of the first."""
    chain = walk.chain
    n = chain.n
    numbers = chain.numbers
    step_between(
        walk.seen, walk.crowd_points[place * numbers :], walk.crowd_points[other * numbers :], walk.turn, walk.step
    )
    for j in range(n):
        square = 0.0
        for i in range(n):
            part = walk.crowd_factors[(place * n + i) * n + j]
            square += part * part
        if fabs(walk.step[j]) >= ALIKE * sqrt(square) and walk.step[j] != 0.0:
            return 0
    return 1


def choose(walk: Walk, made: Integer) -> None:
    """Of the hypotheses that a step has made the best: they become those that are followed."""
    most = walk.chain.hypotheses
    least_violation = walk.crowd_violations[most]
    for i in range(made):
        walk.crowd_taken[most + i] = 0
        least_violation = min(least_violation, walk.crowd_violations[most + i])
    kept = 0
    looked = 0
    while looked < made and kept < most:
        best = -1
        for i in range(made):
            if best < 0 and walk.crowd_taken[most + i] == 0:
                best = i
            if walk.crowd_taken[most + i] == 0 and walk.crowd_costs[most + i] < walk.crowd_costs[most + best] - TIED:
                best = i
        walk.crowd_taken[most + best] = 1
        looked += 1
        good = 1
        if walk.crowd_violations[most + best] > max(VIOLATED, least_violation):
            good = 0
        if kept > 0 and walk.crowd_costs[most + best] > walk.crowd_costs[0] + DROPPED:
            good = 0
        for j in range(kept):
            if good == 1 and alike(walk, j, most + best) == 1:
                good = 0
        if good == 1:
            take_hypothesis(walk, most + best)
            put_hypothesis(walk, kept, walk.crowd_costs[most + best])
            kept += 1
    walk.crowd = kept


def filter_step(walk: Walk, k: Integer) -> Integer:
    """Step k, which follows on the one where the walk is; 0 where something is not finite."""
    if k > 0:
        load_move(walk, k - 1)
    elif walk.chain.pools > 0:
        copied(walk.chain.n * walk.chain.n, walk.factor, walk.errors)
    load_step(walk, k)
    if walk.chain.hypotheses > 1:
        return crowd_step(walk, k)
    if k > 0 and predict(walk) == 0:
        return 0
    if update(walk) == 0:
        return 0
    cut_step(walk, k)
    return 1


def crowd_step(walk: Walk, k: Integer) -> Integer:
    """The same of several hypotheses, for a step whose rows are loaded."""
    chain = walk.chain
    most = chain.hypotheses
    made = 0
    if k == 0:
        walk.crowd = 1
        put_hypothesis(walk, 0, 0.0)
    before = walk.crowd_costs[0]
    for h in range(walk.crowd):
        take_hypothesis(walk, h)
        good = 1
        if k > 0:
            good = predict(walk)
        mirrored = 0
        if good == 1 and walk.open_count == 0:
            mirrored = mirror(walk)
        if good == 1:
            made += updated(walk, k, most + made, walk.crowd_costs[h])
        if mirrored == 1:
            copied(chain.numbers, walk.mirror_point, walk.point)
            copied(chain.n * chain.n, walk.mirror_factor, walk.factor)
            made += updated(walk, k, most + made, walk.crowd_costs[h])
    if made == 0:
        return 0
    choose(walk, made)
    take_hypothesis(walk, 0)
    walk.followed[k % chain.held] = walk.crowd
    walk.last_cost = walk.crowd_costs[0] - before
    return 1


def filter_steps(walk: Walk, first: Integer, last: Integer) -> Integer:
    """Steps ``first … last``; how many were made."""
    for k in range(first, last):
        if filter_step(walk, k) == 0:
            walk.failed = k + 1
            return k - first
        keep_step(walk, k, walk.errors if walk.chain.pools > 0 else walk.factor)
    return last - first
