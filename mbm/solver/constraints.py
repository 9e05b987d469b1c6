"""Constraints by multiplied penalties: the augmented Lagrange function as squares (Hestenes 1969, Powell 1969).

To the residuals come ``weight · (c/unit + shift)``, for inequalities only where positive, with ``shift`` the
multiplier in units of the penalty. Rounds of Marquardt's method, with growing weights and updated multipliers, until
the constraints hold to rounding.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import Integer, Real
from mbm.solver.constraint_values import linearise, set_units
from mbm.solver.decisions import EXACT, FIRST_WEIGHT, HEAVIER, LOOSE, MET, PUSHED, SHRINKS
from mbm.solver.description import FLAT, INFEASIBLE, NOT_FINITE_AT_START, TOLERANCE, Problem
from mbm.solver.equations import groups_of, separate_rows, weights_width
from mbm.solver.kkt import polish
from mbm.solver.linear_algebra import filled
from mbm.solver.trust_region import begin, constraint_count
from mbm.solver.workspace import Work

ROUNDS = 30
"""Rounds of the multiplied penalties."""

ENOUGH = 1e2
"""The weight grows up to this, …"""

MOST = 1e6
"""… and up to this where a round does not bring the violations to the share SHRINKS."""

TIGHTER = 0.03
"""Each round is solved to this share of the standard deviations of the one before."""

OVER = 0
HOPELESS = 1
HEAVIER_STILL = 2
AS_HEAVY = 3
"""What follows on a round: nothing, as the constraints hold; nothing, as they will not; another one, heavier or not."""


def multiplier_after(multiplier: Real, value: Real, unit: Real, weight: Real, equation: Integer) -> Real:
    """The multiplier that a penalty of this weight amounts to, where the constraint has the value (Hestenes 1969)."""
    updated = multiplier + value / unit * weight * weight / unit
    if equation == 0 and updated < 0.0:
        updated = 0.0
    return updated


def missed_by(multiplier: Real, value: Real, unit: Real, rounding: Real, equation: Integer) -> Real:
    """By how many units a constraint with an updated multiplier is missed, beyond its rounding; 0 where it is not.

    An inequality with a multiplier must hold as an equation does; one without must not be overstepped.
    """
    if equation == 0 and multiplier == 0.0 and value < 0.0:
        return 0.0
    missed = (fabs(value) - rounding) / unit
    return missed if missed > 0.0 else 0.0


def verdict(worst: Real, before: Real, weight: Real, settled: Integer, rounds: Integer) -> Integer:
    """What follows on a round that misses constraints by ``worst`` units, where the best one ``before`` did by so many.

    ``settled`` 1: it was solved as closely as is asked, and moved.
    """
    stalled = not worst <= SHRINKS * before
    if settled == 1 and (worst <= EXACT or (stalled and worst <= MET and weight >= ENOUGH)):
        return OVER
    if (stalled and worst > MET and weight >= MOST) or rounds >= ROUNDS:
        return HOPELESS
    return HEAVIER_STILL if weight < ENOUGH or (stalled and weight < MOST) else AS_HEAVY


def set_penalties(problem: Problem, work: Work) -> None:
    """Factors and shifts of the penalties, where the kernels' weights stand."""
    weight = work.weight
    whitening = 0
    done = 0
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        rows = separate_rows(problem, work.rows, b) if LANES > 1 else work.rows.data.blocks[b].rows
        if b >= problem.residual_blocks:
            lines = block.outputs
            own = work.rows.weights[whitening:]
            for row in range(groups_of(rows) * LANES):
                for i in range(lines):
                    at = ((row // LANES) * 2 * lines + 2 * i) * LANES + row % LANES
                    own[at] = 0.0
                    own[at + LANES] = 0.0
                    if row < rows:
                        c = done + row * lines + i
                        own[at] = weight / work.units[c]
                        own[at + LANES] = work.multipliers[c] * work.units[c] / weight
            done += rows * lines
        whitening += groups_of(rows) * weights_width(block) * LANES


def update_multipliers(problem: Problem, work: Work) -> Real:
    """The multipliers that the penalties amount to, and the largest violation in units beyond rounding."""
    worst = 0.0
    for c in range(constraint_count(problem, work.rows.data)):
        equation = work.equation[c]
        value = work.values[c]
        unit = work.units[c]
        multiplier = multiplier_after(work.multipliers[c], value, unit, work.weight, equation)
        work.multipliers[c] = multiplier
        worst = max(worst, missed_by(multiplier, value, unit, work.roundings[c], equation))
    return worst


def begin_rounds(
    problem: Problem,
    work: Work,
) -> None:
    """The first round, from the point where the iteration is."""
    place = work.here
    work.round = 0
    filled(constraint_count(problem, work.rows.data), 0.0, work.multipliers)
    work.penalised = 0
    begin(problem, work)
    # Coordinates that the constraints alone determine leave the residuals deficient: that is no reason to end.
    if work.stop == NOT_FINITE_AT_START:
        return
    linearise(problem, place.point, work)
    set_units(problem, place, 1, work)
    work.penalised = 1
    work.weight = FIRST_WEIGHT
    work.worst = 1e300
    work.tolerance = LOOSE if work.rows.constants[TOLERANCE] < LOOSE else work.rows.constants[TOLERANCE]
    set_penalties(problem, work)
    begin(problem, work)


def next_round(
    problem: Problem,
    work: Work,
) -> Integer:
    """What follows on a round that has ended: 1 where another one has begun, 0 where it is the end."""
    if work.stop > FLAT:
        return 0
    here = work.here
    linearise(problem, here.point, work)
    work.evaluations += 1
    set_units(problem, here, 0, work)
    worst = update_multipliers(problem, work)
    work.round += 1
    if polish(problem, work) == 1:
        return 0
    linearise(problem, here.point, work)
    set_units(problem, here, 0, work)
    settled = 1 if work.tolerance <= work.rows.constants[TOLERANCE] and work.stop != FLAT else 0
    follows = verdict(worst, work.worst, work.weight, settled, work.round)
    if follows == OVER:
        work.worst = worst
        return 0
    if follows == HOPELESS:
        work.worst = worst
        work.stop = FLAT if worst <= MET else INFEASIBLE
        return 0
    if follows == HEAVIER_STILL:
        work.weight *= HEAVIER
    if worst < work.worst:
        work.worst = worst
    work.tolerance *= TIGHTER
    if work.tolerance < work.rows.constants[TOLERANCE]:
        work.tolerance = work.rows.constants[TOLERANCE]
    set_penalties(problem, work)
    begin(problem, work)
    return 1


def set_held(problem: Problem, cost: Real, work: Work) -> None:
    """Mark the constraints that hold the estimates, by their units; the others have no multiplier."""
    for c in range(constraint_count(problem, work.rows.data)):
        work.held[c] = work.units[c]
        pushed = work.multipliers[c] * work.units[c] > PUSHED * (1.0 + sqrt(cost))
        if work.equation[c] == 0 and not pushed:
            work.held[c] = 0.0
            work.multipliers[c] = 0.0
