"""Consensus before a solve: the units that agree (`mbm.solver.consensus`), and what follows for the equations.

`:robust` leaves out what does not agree, and what agrees informs as `inform_units` says; losses keep all units, but
begin where consensus is, and noise that goes with a loss is as large as the units that agree say. ``kappa`` (2, K) has
two numbers for each unit of each block of residuals: the share of its variance that limits leave, and its information.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.chi_square import consistency, inform_units
from mbm.solver.consensus import find_consensus
from mbm.solver.consensus_records import ConsensusWork, Units
from mbm.solver.covariance import set_covariance
from mbm.solver.decisions import STATED
from mbm.solver.description import NO_LOSS, Problem, Unit
from mbm.solver.equations import load_rows
from mbm.solver.linear_algebra import copied
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


def factor_of_loss(group: Integer, dimension: Integer, units: Units) -> Real:
    """How large the noise of a group is by the units that agree; 1 where they do not tell, or fit exactly."""
    total = 0
    count = 0
    variance = 1.0
    rounding = 0.0
    for u in range(units.count):
        total += units.inlier[u] * units.components[u]
        if units.group[u] == group:
            count += units.inlier[u] * units.components[u]
            variance = units.noise[u]
            if units.inlier[u] == 1:
                rounding = max(units.rounding[u], rounding)
    if count == 0 or total <= dimension or variance <= rounding:
        return 1.0
    return sqrt(variance)


def scale_losses(problem: Problem, rows: Rows, work: ConsensusWork, factors: Reals) -> None:
    """Weights of blocks with a loss and unknown noise, by the noise that the units that agree show."""
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        own = work.rules.ruled[b]
        lossy = block.units[0].loss != NO_LOSS
        if own.first_level >= 0 and own.group != STATED and lossy:
            factor = factor_of_loss(own.group, work.left, work.units)
            factors[block.noise] = factor
            for u in range(block.unit_count):
                weigh_units(problem, rows, b, u, 1.0 / factor)


def begin_by_consensus(
    kept: Integer,
    scalars: Integer,
    wide: Problem,
    rows: Rows,
    work: ConsensusWork,
    start: Reals,
    kappa: Reals,
    factors: Reals,
) -> Integer:
    """Equations and start as consensus leaves them; how many units there are, 0: no consensus was looked for.

    ``kept`` 1: what does not agree is left out (`:robust`). ``scalars``: residuals of the units that are ruled.
    ``wide`` is the problem with room for all rows in one chunk, ``rows`` those of a solve.
    """
    work.verdict.agreed = 0
    n = wide.n
    if n == 0 or scalars == 0 or (kept == 1 and work.rules.startless == 0 and scalars <= n):
        return 0
    own = work.rows
    own.constants = rows.constants
    own.data = rows.data
    own.parameters = rows.parameters
    own.whitening = rows.whitening
    own.index = rows.index
    own.columns = rows.columns
    work.starts = start
    work.shared = 0
    find_consensus(wide, work)
    if work.verdict.agreed == 1:
        copied(wide.numbers, work.here.point, start)
        scale_losses(wide, rows, work, factors)
        if kept == 1:
            leave_out(wide, rows, work, kappa)
    return work.units.count


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
