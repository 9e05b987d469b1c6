"""Single rows of the equations: whitened residuals and derivatives, without losses."""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals, call_kernel
from mbm.solver.description import Block, DataBlock, Problem, Unit
from mbm.solver.linear_algebra import copied, filled
from mbm.solver.workspace import Rows


def whiten_row(
    block: Block, weights: ConstantReals, stride: Integer, raw: ConstantReals,
    target: Reals,
) -> None:  # fmt: skip
    """One value for each output, ``stride`` apart, times the weights of a row; 0 for units that take no part."""
    for u in range(block.unit_count):
        unit = block.units[u]
        first = unit.first
        size = unit.last - first
        own = weights[unit.weights :]
        for i in range(size):
            total = 0.0
            if own[0] != 0.0 and unit.matrix == 0:
                total = own[i] * raw[(first + i) * stride]
            elif own[0] != 0.0:
                for j in range(size):
                    if own[i * size + j] != 0.0:
                        total += own[i * size + j] * raw[(first + j) * stride]
            target[(first + i) * stride] = total


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
    whiten_row(block, rows.whitening[part.weights + row * block.weights :], 1, outputs, residuals)


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
    n = problem.n
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    lines = block.outputs
    outputs = scratch[block.variables + block.parameters :]
    plain = outputs[lines + block.nonzero_count :]
    set_inputs(block, part, rows, point, row, scratch)
    call_kernel(block.jacobian, scratch, outputs, 1)
    heavy = rows.whitening[part.weights + row * block.weights :]
    whiten_row(block, heavy, 1, outputs, residuals)
    filled(lines * n, 0.0, plain)
    filled(lines * n, 0.0, jacobian)
    places = rows.columns[part.columns + row * block.columns :]
    for k in range(block.nonzero_count):
        nonzero = block.nonzeros[k]
        column = places[nonzero.tangent]
        if column >= 0:
            plain[nonzero.output * n + column] += outputs[lines + k]
    for k in range(block.tangents):
        if places[k] >= 0:
            whiten_row(block, heavy, n, plain[places[k] :], jacobian[places[k] :])


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
