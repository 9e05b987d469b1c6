"""Consensus before a solve: the units that agree (`mbm.solver.consensus`), and what follows for the equations.

`:robust` leaves out what does not agree, and what agrees informs as `inform_units` says; losses keep all units, but
begin where consensus is, and noise that goes with a loss is as large as the units that agree say. Bounds and
inequalities that hold the fit to what agrees tell coordinates, as equations do. ``kappa`` (2, K) has
two numbers for each unit of each block of residuals: the share of its variance that limits leave, and its information.
"""

from __future__ import annotations

from math import isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.batch import lossy, solve_alone
from mbm.solver.chi_square import consistency, inform_units
from mbm.solver.consensus import find_consensus
from mbm.solver.consensus_records import HELD_ROUNDS, ConsensusWork, Units
from mbm.solver.covariance import set_covariance
from mbm.solver.decisions import STATED
from mbm.solver.description import COST, NO_LOSS, Problem, Unit
from mbm.solver.equations import load_rows, weights_width
from mbm.solver.linear_algebra import copied
from mbm.solver.noise_factors import LEAST_REDUNDANCY
from mbm.solver.stationary import forget_stationary
from mbm.solver.sweeps import sweep
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Rows, Work


def weigh_unit(problem: Problem, rows: Rows, b: Integer, row: Integer, unit: Unit, factor: Real) -> None:
    """The weights of a unit times a factor; 0: it takes no part any more."""
    size = unit.last - unit.first
    if unit.matrix != 0:
        size = size * size
    first = rows.data.blocks[b].weights + row * problem.blocks[b].weights + unit.weights
    for i in range(size):
        rows.whitening[first + i] *= factor


def weigh_units(problem: Problem, rows: Rows, b: Integer, u: Integer, factor: Real) -> None:
    """The same for unit ``u`` of all rows of a block."""
    for row in range(rows.data.blocks[b].rows):
        weigh_unit(problem, rows, b, row, problem.blocks[b].units[u], factor)


def count_kinds(problem: Problem) -> Integer:
    """Units of one row of each block of residuals, K."""
    found = 0
    for b in range(problem.residual_blocks):
        found += problem.blocks[b].unit_count
    return found


def leave_out(problem: Problem, rows: Rows, work: ConsensusWork, kappa: Reals) -> None:
    """Take out the units that do not agree, and set ``kappa`` of the others; a loss sees the tails itself: it has 1."""
    units = work.units
    inform_units(units, work.rules.groups, work.here.squares)
    kinds = count_kinds(problem)
    n = 0
    first = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        count = block.unit_count
        if work.rules.ruled[b].first_level >= 0:
            for row in range(rows.data.blocks[b].rows):
                for u in range(count):
                    unit = block.units[u]
                    if units.inlier[n] == 0:
                        weigh_unit(problem, rows, b, row, unit, 0.0)
                        rows.data.count -= units.components[n]
                    elif unit.loss == NO_LOSS:
                        kappa[first + u] = consistency(units.limits[n] / units.noise[n], units.components[n])
                        kappa[kinds + first + u] = units.information[n]
                    n += 1
        first += count


def factor_of_loss(group: Integer, units: Units) -> Real:
    """How large the noise of a group is by the units that agree; 1 where they do not tell, or fit exactly."""
    checked = 0.0
    variance = 1.0
    rounding = 0.0
    for u in range(units.count):
        if units.group[u] == group and units.inlier[u] == 1:
            checked += units.redundancy[u]
            variance = units.noise[u]
            rounding = max(units.rounding[u], rounding)
    return sqrt(variance) if checked > LEAST_REDUNDANCY and variance > rounding else 1.0


def scale_losses(problem: Problem, rows: Rows, work: ConsensusWork, factors: Reals) -> None:
    """Weights of blocks with a loss and unknown noise, by the noise that the units that agree show."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        own = work.rules.ruled[b]
        lossy = block.units[0].loss != NO_LOSS
        if own.first_level >= 0 and own.group != STATED and lossy:
            factor = factor_of_loss(own.group, work.units)
            factors[block.noise] = factor
            for u in range(block.unit_count):
                weigh_units(problem, rows, b, u, 1.0 / factor)


def weigh_agreeing(problem: Problem, rows: Rows, work: ConsensusWork) -> None:
    """Weights by the noise of the units that agree, 0 for the others; the consensus has those that were before."""
    units = work.units
    for u in range(units.count):
        b = units.block[u]
        factor = 1.0 / sqrt(units.noise[u]) if units.inlier[u] == 1 else 0.0
        weigh_unit(problem, rows, b, units.row[u], problem.blocks[b].units[units.equation[u]], factor)
        rows.data.count -= (1 - units.inlier[u]) * units.components[u]


def weigh_as_before(problem: Problem, rows: Rows, work: ConsensusWork) -> None:
    """The weights that the consensus was begun with, row after row."""
    units = work.units
    there = 0
    for b in range(problem.residual_blocks):
        part = rows.data.blocks[b]
        count = part.rows * problem.blocks[b].weights
        copied(count, work.rows.weights[there:], rows.whitening[part.weights :])
        there += part.rows * weights_width(problem.blocks[b])
    for u in range(units.count):
        rows.data.count += (1 - units.inlier[u]) * units.components[u]


def take_limits(problem: Problem, solve: Work, work: ConsensusWork) -> Integer:
    """The bounds and constraints that hold the fit of a solve for consensus to keep to; 1: it did already."""
    same = 1
    for j in range(problem.n):
        holds = 1 if solve.answer.sides[j] != 0 else 0
        if work.bounded[j] != holds:
            same = 0
        work.bounded[j] = holds
    for c in range(constraint_count(problem, solve.rows.data)):
        holds = 1 if solve.equation[c] == 1 or solve.answer.multipliers[c] != 0.0 else 0
        if work.equation[c] != holds:
            same = 0
        work.equation[c] = holds
    return same


def agree_within_limits(chunk: Integer, wide: Problem, solve: Work, work: ConsensusWork) -> None:
    """Consensus again, with the bounds and inequalities that hold the fit to what agrees, until they are the same.

    ``chunk`` is that of the solve, whose problem is ``wide`` otherwise.
    """
    limited = wide.boxed
    for c in range(constraint_count(wide, solve.rows.data)):
        limited += 1 - work.equation[c]
    outer = wide.chunk
    for b in range(wide.residual_blocks):
        for u in range(wide.blocks[b].unit_count):
            wide.blocks[b].units[u].loss = NO_LOSS
    number = 0
    while limited > 0 and number < HELD_ROUNDS and work.verdict.agreed == 1:
        weigh_agreeing(wide, solve.rows, work)
        wide.chunk = chunk
        solve_alone(wide, solve.rows.data, work.here.point, solve)
        wide.chunk = outer
        weigh_as_before(wide, solve.rows, work)
        number += 1
        if not isfinite(solve.answer.results[COST]) or take_limits(wide, solve, work) == 1:
            limited = 0
        else:
            work.held = 1
            work.rules.startless = 0
            work.starts = solve.answer.numbers
            find_consensus(wide, work)
    if limited > 0 and number == HELD_ROUNDS:
        work.verdict.ambiguous = 1


def begin_by_consensus(
    kept: Integer,
    scalars: Integer,
    problem: Problem,
    wide: Problem,
    solve: Work,
    work: ConsensusWork,
    start: Reals,
) -> Integer:
    """The units that agree before a solve; how many units there are, 0: no consensus was looked for.

    ``kept`` 1: what does not agree is to be left out (`:robust`). ``scalars``: residuals of the units that are ruled.
    ``wide`` is the problem with room for all rows in one chunk.
    """
    work.verdict.agreed = 0
    n = wide.n
    if n == 0 or scalars == 0 or (kept == 1 and work.rules.startless == 0 and scalars <= n):
        return 0
    rows = solve.rows
    own = work.rows
    own.constants = rows.constants
    own.data = rows.data
    own.parameters = rows.parameters
    own.whitening = rows.whitening
    own.index = rows.index
    own.columns = rows.columns
    work.starts = start
    work.shared = 0
    work.held = 0
    find_consensus(wide, work)
    if kept == 1 or lossy(problem) == 1:
        agree_within_limits(problem.chunk, wide, solve, work)
    return work.units.count


def take_agreement(
    kept: Integer, problem: Problem, rows: Rows, work: ConsensusWork, start: Reals, kappa: Reals, factors: Reals
) -> None:
    """Equations, ``rows`` of a solve, and start as consensus leaves them."""
    if work.verdict.agreed == 1:
        copied(problem.numbers, work.here.point, start)
        scale_losses(problem, rows, work, factors)
        if kept == 1:
            leave_out(problem, rows, work, kappa)


def inform(problem: Problem, kappa: ConstantReals, work: Work) -> Integer:
    """The covariance (n, n) at the end of a solve, with the information that is left of the units; 1: there is one.

    The weights are multiplied by its root, so that nothing but the covariance should be asked for afterwards.
    """
    answer = work.answer
    rows = work.rows
    first = count_kinds(problem)
    for b in range(problem.residual_blocks):
        count = problem.blocks[b].unit_count
        for u in range(count):
            if kappa[first + u] != 1.0:
                weigh_units(problem, rows, b, u, sqrt(kappa[first + u]))
        first += count
    return covariance_anew(problem, work, answer.covariance) < 1e300


def covariance_anew(problem: Problem, work: Work, covariance: Reals) -> Real:
    """The covariance (n, n) at the end of a solve with the weights as they are now; its condition."""
    answer = work.answer
    rows = work.rows
    load_rows(problem, rows)
    sweep(problem, answer.numbers, 0, 0, rows, rows.constants, answer.triangle)
    forget_stationary(problem, answer.sides, work)
    count = 0
    if work.penalised == 1:
        count = constraint_count(problem, rows.data)
    return set_covariance(problem, answer.triangle, answer.sides, count, work.held, work, covariance)
