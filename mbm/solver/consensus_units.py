"""What the units of a data set are: where their residuals stand, their noise, their rounding, their directions."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_kernel, distinct_arrays
from mbm.solver.consensus_constraints import follow_constraints
from mbm.solver.consensus_records import LEVEL, ConsensusWork, Level, Units
from mbm.solver.decisions import CONSENSUS_ROUNDING
from mbm.solver.description import Problem
from mbm.solver.equations import gather, groups_of, residuals_at_point, weights_width, whiten_values
from mbm.solver.linear_algebra import copied, filled
from mbm.solver.manifolds import coordinates_of
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


def put_unit(
    number: Integer, first: Integer, place: Integer, size: Integer, level: Integer, work: ConsensusWork
) -> Integer:
    """A unit of so many residuals with its law; whether it is one whose residual has its own number.

    ``first`` are the residuals of the units before it, ``place`` is where its own stand.
    """
    units = work.units
    law = view(Level, work.levels[level * LEVEL :])
    units.components[number] = size
    units.place[number] = place
    units.first[number] = first
    units.medians[number] = law.median
    units.cuts[number] = law.cut
    units.reaches[number] = law.reach
    for i in range(size):
        work.ruled[place + i * LANES] = 1.0
    return size == 1 and place == number


def list_units(problem: Problem, work: ConsensusWork) -> None:
    """The units of a data set, in order."""
    units = work.units
    n = 0
    there = 0
    whitening = 0
    scalars = 0
    simple = 1
    filled(problem.chunk, 0.0, work.ruled)
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        rows = work.rows.data.blocks[b].rows
        lines = block.outputs
        own = work.rules.ruled[b]
        if own.first_level >= 0:
            for row in range(rows):
                for u in range(block.unit_count):
                    unit = block.units[u]
                    weight = (row // LANES * block.weights + unit.weights) * LANES + row % LANES
                    if work.rows.weights[whitening + weight] != 0.0:
                        place = there + (row // LANES * lines + unit.first) * LANES + row % LANES
                        if put_unit(n, scalars, place, unit.last - unit.first, own.first_level + u, work) == 0:
                            simple = 0
                        units.group[n] = own.group
                        units.block[n] = b
                        units.row[n] = row
                        units.equation[n] = u
                        scalars += units.components[n]
                        n += 1
        elif rows > 0:
            simple = 0
        there += groups_of(rows) * LANES * lines
        whitening += groups_of(rows) * LANES * weights_width(block)
    units.first[n] = scalars
    units.simple = simple
    units.count = n
    units.scalars = scalars


def set_rounding(problem: Problem, point: ConstantReals, work: ConsensusWork) -> None:
    """The squared norms (U,) that the arithmetic alone makes, from ``[J r]`` at the point, as it is in the work."""
    n = problem.n
    stride = problem.chunk
    units = work.units
    chunk = work.here.chunk
    size = work.coordinates
    coordinates_of(problem, point, size)
    for u in range(units.count):
        place = units.place[u]
        largest = 0.0
        for i in range(units.components[u]):
            terms = fabs(chunk[n * stride + place + i * LANES])
            for j in range(n):
                terms += fabs(chunk[j * stride + place + i * LANES] * size[j])
            if isfinite(terms):
                largest = max(largest, terms)
        units.rounding[u] = CONSENSUS_ROUNDING * largest * (CONSENSUS_ROUNDING * largest)


def norm_directions(problem: Problem, work: ConsensusWork) -> None:
    """Rows of the units' Jacobian in the work, columns scaled to norm 1, then each row to norm 1: (scalars, n)."""
    n = problem.n
    stride = problem.chunk
    units = work.units
    chunk = work.here.chunk
    norms = work.coordinates
    directions = work.directions
    filled(n, 0.0, norms)
    for u in range(units.count):
        first = units.first[u]
        place = units.place[u]
        for i in range(units.components[u]):
            for j in range(n):
                value = chunk[j * stride + place + i * LANES]
                if not isfinite(value):
                    value = 0.0
                directions[(first + i) * n + j] = value
                norms[j] += value * value
    for j in range(n):
        norms[j] = 1.0 / sqrt(norms[j]) if norms[j] > 0.0 else 1.0
    for k in range(units.scalars):
        square = 0.0
        row = directions[k * n :]
        for j in range(n):
            row[j] *= norms[j]
            square += row[j] * row[j]
        if square > 0.0:
            length = sqrt(square)
            for j in range(n):
                row[j] = row[j] / length
