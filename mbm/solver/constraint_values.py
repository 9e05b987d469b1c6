"""Values and derivatives of the constraints at a point, and the units in which their violations count."""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.kinds import LANES
from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals, call_kernel, distinct_arrays
from mbm.solver.decisions import EPSILON, ROUNDING_ERRORS
from mbm.solver.description import Block, Problem
from mbm.solver.equations import gather, groups_of, portion, separate_rows
from mbm.solver.linear_algebra import filled
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Linearisation, Rows, Work


@distinct_arrays
def add_slopes(
    problem: Problem,
    block: Block,
    columns: ConstantIntegers,
    first: Integer,
    rows: Integer,
    outputs: ConstantReals,
    values: Reals,
    slopes: Reals,
) -> None:
    """Values and derivatives of the constraints of one portion: row by row, output by output."""
    n = problem.n
    lines = block.outputs
    width = lines + block.nonzero_count
    for row in range(rows):
        group = row // LANES
        lane = row % LANES
        for i in range(lines):
            values[row * lines + i] = outputs[(group * width + i) * LANES + lane]
        for k in range(block.nonzero_count):
            nonzero = block.nonzeros[k]
            column = columns[(first + row) * block.columns + nonzero.tangent]
            if column >= 0:
                value = outputs[(group * width + lines + k) * LANES + lane]
                slopes[(row * lines + nonzero.output) * n + column] += value


def linearise(
    problem: Problem,
    point: ConstantReals,
    work: Work,
) -> None:
    """Values and slopes of all constraints at a point."""
    filled(constraint_count(problem, work.rows.data) * problem.n, 0.0, work.slopes)
    evaluate(problem, point, 1, work.rows, work.values, work.slopes)


def evaluate(problem: Problem, point: ConstantReals, sloped: Integer, rows: Rows, values: Reals, slopes: Reals) -> None:
    """Values of all constraints at a point; with ``sloped`` 1 their derivatives are added to zeros in ``slopes``."""
    inputs = 0
    done = 0
    for b in range(problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        count = separate_rows(problem, rows, b) if LANES > 1 else rows.data.blocks[b].rows
        if b >= problem.residual_blocks:
            own = slopes[done * problem.n :]
            evaluate_block(problem, b, rows, rows.inputs[inputs:], point, sloped, values[done:], own)
            done += count * block.outputs
        inputs += groups_of(count) * (block.variables + block.parameters) * LANES


def evaluate_block(
    problem: Problem,
    b: Integer,
    rows: Rows,
    inputs: Reals,
    point: ConstantReals,
    sloped: Integer,
    values: Reals,
    slopes: Reals,
) -> None:
    """Values of the constraints of one block, row by row; with ``sloped`` 1 their derivatives are added likewise."""
    n = problem.n
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    count = part.rows
    width = (block.variables + block.parameters) * LANES
    gather(block, count, rows.index[part.index :], point, inputs)
    columns = rows.columns[part.columns :]
    first = 0
    while first < count:
        own = portion(problem, block) * LANES
        if first + own > count:
            own = count - first
        given = inputs[first // LANES * width :]
        done = first * block.outputs
        if sloped == 1:
            call_kernel(block.jacobian, given, rows.outputs, groups_of(own))
            add_slopes(problem, block, columns, first, own, rows.outputs, values[done:], slopes[done * n :])
        else:
            call_kernel(block.values, given, rows.outputs, groups_of(own))
            for row in range(own):
                for i in range(block.outputs):
                    at = (row // LANES * block.outputs + i) * LANES + row % LANES
                    values[done + row * block.outputs + i] = rows.outputs[at]
        first += own


def tell_equations(problem: Problem, rows: Rows, equation: Integers) -> None:
    """Which constraints of the data set are equations."""
    done = 0
    for b in range(problem.residual_blocks, problem.residual_blocks + problem.constraint_blocks):
        block = problem.blocks[b]
        count = block.outputs * rows.data.blocks[b].rows
        for k in range(count):
            equation[done + k] = block.equality[k % block.outputs]
        done += count


def set_units(problem: Problem, place: Linearisation, first: Integer, work: Work) -> None:
    """Units and roundings of the constraints at a place; at ``first`` its norms alone are the measure."""
    n = problem.n
    norms = place.norms
    units = work.units
    for c in range(constraint_count(problem, work.rows.data)):
        square = 0.0
        terms = fabs(work.values[c])
        longest = 0.0
        for j in range(n):
            slope = fabs(work.slopes[c * n + j])
            size = fabs(place.x[j]) if problem.number_of[j] >= 0 else 1.0
            terms += slope * size
            if slope > longest:
                longest = slope
            if norms[j] > 0.0:
                square += slope / norms[j] * (slope / norms[j])
        if first == 1:
            units[c] = sqrt(square) if square > 0.0 else longest
            if not units[c] > 0.0:
                units[c] = 1.0
        work.roundings[c] = ROUNDING_ERRORS * EPSILON * terms
