"""Single rows of the equations: whitened residuals and derivatives, without losses."""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals, call_kernel
from mbm.solver.description import Block, DataBlock, Problem, Unit
from mbm.solver.equations import gather, portion
from mbm.solver.linear_algebra import add_multiple, copied, filled
from mbm.solver.workspace import Rows


def whiten_row(block: Block, weights: ConstantReals, raw: ConstantReals, target: Reals) -> None:
    """One value for each output times the weights of a row; 0 for units that take no part."""
    for u in range(block.unit_count):
        unit = block.units[u]
        first = unit.first
        size = unit.last - first
        own = weights[unit.weights :]
        for i in range(size):
            total = 0.0
            if own[0] != 0.0 and unit.matrix == 0:
                total = own[i] * raw[first + i]
            elif own[0] != 0.0:
                for j in range(size):
                    if own[i * size + j] != 0.0:
                        total += own[i * size + j] * raw[first + j]
            target[first + i] = total


def takes_part(problem: Problem, rows: Rows, b: Integer, row: Integer, unit: Unit) -> Integer:
    """Whether a unit counts: its first weight is not 0."""
    step = problem.blocks[b].weights
    found = 0
    if rows.whitening[rows.data.blocks[b].weights + row * step + unit.weights] != 0.0:
        found = 1
    return found


def row_scratch(problem: Problem) -> Integer:
    """Reals of scratch that `evaluate_row` wants."""
    found = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        lines = block.outputs
        size = block.variables + block.parameters + lines + block.nonzero_count
        size += lines * problem.n
        if size > found:
            found = size
    return found


def set_inputs(block: Block, part: DataBlock, rows: Rows, point: ConstantReals, row: Integer, inputs: Reals) -> None:
    """What the kernel of a block is given for a row: numbers of the point, then parameters."""
    variables = block.variables
    wide = block.parameters
    own = rows.index[part.index + row * block.index :]
    for v in range(variables):
        inputs[v] = point[own[v]]
    given = rows.parameters[part.parameters + row * wide :]
    copied(wide, given, inputs[variables:])


def residuals_of_row(
    problem: Problem, rows: Rows, point: ConstantReals, b: Integer, row: Integer, scratch: Reals, residuals: Reals
) -> None:
    """Row ``row`` of block ``b``: whitened residuals (outputs,)."""
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    set_inputs(block, part, rows, point, row, scratch)
    outputs = scratch[block.variables + block.parameters :]
    call_kernel(block.values, scratch, outputs, 1)
    whiten_row(block, rows.whitening[part.weights + row * block.weights :], outputs, residuals)


def whiten_slopes(
    problem: Problem,
    rows: Rows,
    b: Integer,
    row: Integer,
    outputs: ConstantReals,
    scratch: Reals,
    residuals: Reals,
    jacobian: Reals,
) -> None:
    """What the kernel of block ``b`` has put into ``outputs`` for a row, whitened: residuals (outputs,) and Jacobian
    (outputs, n). ``scratch`` is as large as the latter.
    """
    n = problem.n
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    lines = block.outputs
    heavy = rows.whitening[part.weights + row * block.weights :]
    places = rows.columns[part.columns + row * block.columns :]
    whiten_row(block, heavy, outputs, residuals)
    filled(lines * n, 0.0, jacobian)
    matrices = 0
    for k in range(block.nonzero_count):
        nonzero = block.nonzeros[k]
        column = places[nonzero.tangent]
        if column >= 0:
            factor = heavy[nonzero.weight] if nonzero.weight >= 0 else 1.0
            if factor != 0.0:
                jacobian[nonzero.output * n + column] += factor * outputs[lines + k]
            if nonzero.weight < 0:
                matrices = 1
    if matrices == 1:
        copied(lines * n, jacobian, scratch)
        for u in range(block.unit_count):
            unit = block.units[u]
            if unit.matrix != 0:
                whiten_lines(unit, n, heavy[unit.weights :], scratch[unit.first * n :], jacobian[unit.first * n :])


def whiten_lines(unit: Unit, n: Integer, weights: ConstantReals, plain: ConstantReals, whitened: Reals) -> None:
    """The derivatives (size, n) of a unit times the matrix of its weights; 0 where it takes no part."""
    size = unit.last - unit.first
    filled(size * n, 0.0, whitened)
    if weights[0] != 0.0:
        for i in range(size):
            for j in range(size):
                if weights[i * size + j] != 0.0:
                    add_multiple(n, weights[i * size + j], plain[j * n :], whitened[i * n :])


def evaluate_row(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    b: Integer,
    row: Integer,
    scratch: Reals,
    residuals: Reals,
    jacobian: Reals,
) -> None:
    """Row ``row`` of block ``b``: whitened residuals (outputs,) and Jacobian (outputs, n)."""
    block = problem.blocks[b]
    outputs = scratch[block.variables + block.parameters :]
    plain = outputs[block.outputs + block.nonzero_count :]
    set_inputs(block, rows.data.blocks[b], rows, point, row, scratch)
    call_kernel(block.jacobian, scratch, outputs, 1)
    whiten_slopes(problem, rows, b, row, outputs, plain, residuals, jacobian)


def evaluate_next_row(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    b: Integer,
    row: Integer,
    scratch: Reals,
    residuals: Reals,
    jacobian: Reals,
) -> None:
    """As `evaluate_row`, of the rows of a block one after the other, from the first: the kernel takes portions of them.

    The rows are those that the solver has loaded.
    """
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    most = portion(problem, block)
    place = row % most
    if place == 0:
        begin = row * (block.variables + block.parameters)
        for k in range(b):
            begin += rows.data.blocks[k].rows * (problem.blocks[k].variables + problem.blocks[k].parameters)
        inputs = rows.inputs[begin:]
        count = most if row + most <= part.rows else part.rows - row
        gather(block, count, rows.index[part.index + row * block.index :], point, inputs)
        call_kernel(block.jacobian, inputs, rows.outputs, count)
    outputs = rows.outputs[place * (block.outputs + block.nonzero_count) :]
    whiten_slopes(problem, rows, b, row, outputs, scratch, residuals, jacobian)


def all_rows(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    slopes: Integer,
    scratch: Reals,
    line: Reals,
    target: Reals,
) -> None:
    """Residuals (m,), or with ``slopes`` 1 their Jacobian (m, n); ``line`` holds one row of either."""
    n = problem.n
    first = 0
    for b in range(problem.residual_blocks):
        lines = problem.blocks[b].outputs
        for row in range(rows.data.blocks[b].rows):
            if slopes == 0:
                residuals_of_row(problem, rows, point, b, row, scratch, target[first:])
            else:
                evaluate_row(problem, rows, point, b, row, scratch, line, target[first * n :])
            first += lines
