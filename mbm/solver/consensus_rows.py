"""Rows at a point as consensus takes them: all of ``[J r]`` side by side, squared norms of units, weights by unit."""

from __future__ import annotations

from math import inf, isfinite

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_kernel, distinct_arrays
from mbm.solver.consensus_constraints import follow_constraints
from mbm.solver.consensus_records import ConsensusWork, Units
from mbm.solver.description import Problem
from mbm.solver.equations import gather, groups_of, residuals_at_point, weights_width, whiten_values
from mbm.solver.linear_algebra import copied, filled
from mbm.solver.slopes import scatter, whiten_matrices
from mbm.solver.workspace import Rows


def linearised(problem: Problem, rows: Rows, point: ConstantReals, work: ConsensusWork, chunk: Reals) -> Integer:
    """Whitened residuals and derivatives without losses: ``chunk`` holds n columns of J and one of r, CHUNK apart.

    How many numbers of a column are taken is given, a multiple of 4. Equations among the constraints are put in.
    """
    n = problem.n
    stride = problem.chunk
    inputs = 0
    whitening = 0
    there = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        groups = groups_of(part.rows)
        lines = block.outputs * LANES
        if groups > 0:
            gather(block, part.rows, rows.index[part.index :], point, rows.inputs[inputs:])
            call_kernel(block.jacobian, rows.inputs[inputs:], rows.outputs, groups)
            weights = rows.weights[whitening:]
            for column in range(n):
                filled(groups * lines, 0.0, chunk[column * stride + there :])
            scatter(problem, block, part, 0, groups, rows, weights, chunk[there:])
            every = block.outputs + block.nonzero_count
            whiten_values(block, groups, every, rows.outputs, weights, chunk[n * stride + there :])
            whiten_matrices(problem, block, groups, weights, chunk[there:])
        there += groups * lines
        inputs += groups * LANES * (block.variables + block.parameters)
        whitening += groups * LANES * weights_width(block)
    while there % 4 != 0:
        for column in range(n + 1):
            chunk[column * stride + there] = 0.0
        there += 1
    follow_constraints(problem, there, point, work, chunk)
    return there


@distinct_arrays
def square_each(count: Integer, values: ConstantReals, squares: Reals) -> None:
    """The square of each; infinite where that is not finite."""
    for i in range(count):
        square = values[i] * values[i]
        squares[i] = square if isfinite(square) else inf


def unit_squares(units: Units, residuals: ConstantReals, squares: Reals) -> None:
    """Squared norms (U,) of the units; infinite where one is not finite."""
    if units.simple == 1:
        square_each(units.count, residuals, squares)
        return
    for u in range(units.count):
        own = residuals[units.place[u] :]
        total = own[0] * own[0]
        for i in range(1, units.components[u]):
            total += own[i * LANES] * own[i * LANES]
        squares[u] = total if isfinite(total) else inf


def squares_at(problem: Problem, point: ConstantReals, work: ConsensusWork, squares: Reals) -> None:
    """The same at a point."""
    rows = work.rows
    residuals_at_point(problem, rows, point, 0, 0, rows.residuals)
    unit_squares(work.units, rows.residuals, squares)


def unruled_square(count: Integer, residuals: ConstantReals, work: ConsensusWork) -> Real:
    """The sum of the squares that no rule touches; infinite if one is not finite."""
    total = 0.0
    if work.units.simple == 1:
        return total
    for i in range(count):
        if work.ruled[i] == 0.0:
            total += residuals[i] * residuals[i]
    return total if isfinite(total) else inf


def spread_weights(units: Units, count: Integer, by_row: Reals) -> None:
    """The weights of the units residual by residual, 1 where no rule acts."""
    if units.simple == 1:
        copied(units.count, units.weights, by_row)
        filled(count - units.count, 1.0, by_row[units.count :])
        return
    filled(count, 1.0, by_row)
    for u in range(units.count):
        for i in range(units.components[u]):
            by_row[units.place[u] + i * LANES] = units.weights[u]


@distinct_arrays
def weigh_columns(
    columns: Integer, stride: Integer, count: Integer, weights: ConstantReals, chunk: Reals, target: Reals
) -> None:
    """``target`` = weight · column; both are zero where the weight is."""
    for column in range(columns):
        for i in range(count):
            weight = weights[i]
            value = chunk[column * stride + i] if weight != 0.0 else 0.0
            chunk[column * stride + i] = value
            target[column * stride + i] = weight * value
