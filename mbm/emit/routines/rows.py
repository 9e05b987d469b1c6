"""Single rows of the equations: whitened residuals and derivatives, without losses."""

from __future__ import annotations

from mbm.machine.words import ConstantReals, Integer, Reals, call_kernel
from mbm.solver.description import Block, Problem, Unit
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
    variables = block.variables
    wide = block.parameters
    lines = block.outputs
    outputs = scratch[variables + wide :]
    plain = scratch[variables + wide + lines + block.nonzero_count :]
    own = rows.index[part.index + row * block.index :]
    for v in range(variables):
        scratch[v] = point[own[v]]
    given = rows.parameters[part.parameters + row * wide :]
    for p in range(wide):
        scratch[variables + p] = given[p]
    call_kernel(block.jacobian, scratch, outputs, 1)
    heavy = rows.whitening[part.weights + row * block.weights :]
    whiten_row(block, heavy, 1, outputs, residuals)
    for i in range(lines * n):
        plain[i] = 0.0
        jacobian[i] = 0.0
    places = rows.columns[part.columns + row * block.columns :]
    for k in range(block.nonzero_count):
        nonzero = block.nonzeros[k]
        column = places[nonzero.tangent]
        if column >= 0:
            plain[nonzero.output * n + column] += outputs[lines + k]
    for j in range(n):
        whiten_row(block, heavy, n, plain[j:], jacobian[j:])


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
            evaluate_row(problem, rows, point, b, row, scratch, line, line[lines:])
            for i in range(lines):
                if slopes == 0:
                    target[first + i] = line[i]
                else:
                    for j in range(n):
                        target[(first + i) * n + j] = line[lines + i * n + j]
            first += lines
