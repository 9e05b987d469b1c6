"""Rows → kernels → whitening → losses → residuals, or the triangular factor of ``[J r]``.

Rows go through in portions that stay in the cache. Residual (row, output) of a block stands at
``(row // LANES · outputs + output) · LANES + row % LANES`` behind those of the blocks before it; lanes beyond the last
row repeat it with weight 0.

Blocks of few rows whose rows are fused in one function: their data, and whether a data set has just these rows.

In the process only, where functions are made for a problem: see `mbm.machine.merged`.
"""

from __future__ import annotations

from mbm.machine.kinds import LANES
from mbm.machine.words import (
    ConstantIntegers,
    ConstantReals,
    Integer,
    Real,
    Reals,
    call_fused,
    call_kernel,
    distinct_arrays,
)
from mbm.solver.description import NO_LOSS, Block, Problem
from mbm.solver.linear_algebra import copied, dot
from mbm.solver.losses import root_factor
from mbm.solver.workspace import Rows


def portion(problem: Problem, block: Block) -> Integer:
    """How many kernel blocks go through at a time: as many as fill a chunk."""
    return problem.chunk // (LANES * block.outputs)


def groups_of(rows: Integer) -> Integer:
    """Kernel blocks of so many rows."""
    return (rows + LANES - 1) // LANES


def weights_width(block: Block) -> Integer:
    """Numbers that whiten a row; for constraints a factor and a shift for each output."""
    found = block.weights
    if found == 0:
        found = 2 * block.outputs
    return found


@distinct_arrays
def load_block(
    block: Block,
    rows: Integer,
    parameters: ConstantReals,
    weights: ConstantReals,
    inputs: Reals,
    whitening: Reals,
) -> None:
    """Parameters and weights of one block, from row after row to lane after lane."""
    variables = block.variables
    wide = block.parameters
    heavy = block.weights
    for group in range(groups_of(rows)):
        for lane in range(LANES):
            row = group * LANES + lane
            live = 1.0
            if row >= rows:
                row = rows - 1
                live = 0.0
            for p in range(wide):
                inputs[(group * (variables + wide) + variables + p) * LANES + lane] = parameters[row * wide + p]
            for w in range(heavy):
                whitening[(group * heavy + w) * LANES + lane] = live * weights[row * heavy + w]


@distinct_arrays
def load_rows(problem: Problem, rows: Rows) -> None:
    """Everything of a data set that does not depend on the point, as the kernels and the whitening take it."""
    if LANES > 1:
        fuse(problem, rows)
    inputs = 0
    whitening = 0
    for b in range(
        first_separate(problem, rows) if LANES > 1 else 0, problem.residual_blocks + problem.constraint_blocks
    ):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        count = separate_rows(problem, rows, b) if LANES > 1 else part.rows
        load_block(
            block,
            count,
            rows.parameters[part.parameters :],
            rows.whitening[part.weights :],
            rows.inputs[inputs:],
            rows.weights[whitening:],
        )
        inputs += groups_of(count) * LANES * (block.variables + block.parameters)
        whitening += groups_of(count) * LANES * weights_width(block)


@distinct_arrays
def put_shared(rows: Integer, width: Integer, value: Real, inputs: Reals) -> None:
    """One number for all rows into the kernels' inputs, ``width`` of them for each kernel block."""
    for group in range(groups_of(rows)):
        for lane in range(LANES):
            inputs[group * width + lane] = value


@distinct_arrays
def put_numbers(
    rows: Integer, width: Integer, step: Integer, index: ConstantIntegers, point: ConstantReals, inputs: Reals
) -> None:
    """The number of each row likewise, the places of which stand ``step`` apart in ``index``."""
    for group in range(groups_of(rows)):
        for lane in range(LANES):
            row = group * LANES + lane
            if row >= rows:
                row = rows - 1
            inputs[group * width + lane] = point[index[row * step]]


@distinct_arrays
def gather(block: Block, rows: Integer, index: ConstantIntegers, point: ConstantReals, inputs: Reals) -> None:
    """Put the numbers of the point into the kernels' inputs."""
    if rows == 0:
        return
    variables = block.variables
    step = block.index
    width = (variables + block.parameters) * LANES
    for v in range(variables):
        if step == 0:
            put_shared(rows, width, point[index[v]], inputs[v * LANES :])
        else:
            put_numbers(rows, width, step, index[v:], point, inputs[v * LANES :])


@distinct_arrays
def whiten_values(
    block: Block,
    groups: Integer,
    width: Integer,
    outputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """Outputs (``width`` numbers a row in ``outputs``) → whitened residuals without losses, 0 where the weight is 0."""
    rows = block.outputs
    heavy = block.weights
    for u in range(block.unit_count):
        unit = block.units[u]
        first = unit.first
        size = unit.last - first
        for i in range(size):
            if unit.matrix == 0:
                for group in range(groups):
                    for lane in range(LANES):
                        weight = whitening[(group * heavy + unit.weights + i) * LANES + lane]
                        value = weight * outputs[(group * width + first + i) * LANES + lane]
                        target[(group * rows + first + i) * LANES + lane] = value if weight != 0.0 else 0.0
            else:
                for group in range(groups):
                    for lane in range(LANES):
                        total = 0.0
                        for j in range(size):
                            at = group * heavy + unit.weights + i * size + j
                            weight = whitening[at * LANES + lane]
                            if weight != 0.0:
                                total += weight * outputs[(group * width + first + j) * LANES + lane]
                        target[(group * rows + first + i) * LANES + lane] = total


@distinct_arrays
def penalise_values(
    block: Block,
    groups: Integer,
    width: Integer,
    outputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """Constraint values → penalties ``factor · c + shift``, of inequalities only where positive."""
    rows = block.outputs
    for group in range(groups):
        for i in range(rows):
            for lane in range(LANES):
                factor = whitening[(group * 2 * rows + 2 * i) * LANES + lane]
                value = factor * outputs[(group * width + i) * LANES + lane]
                value += whitening[(group * 2 * rows + 2 * i + 1) * LANES + lane]
                if factor == 0.0 or (block.equality[i] == 0 and value <= 0.0):
                    value = 0.0
                target[(group * rows + i) * LANES + lane] = value


@distinct_arrays
def square_of(size: Integer, residuals: ConstantReals) -> Real:
    """The squared norm of a unit in one lane."""
    total = 0.0
    for i in range(size):
        total += residuals[i * LANES] * residuals[i * LANES]
    return total


def root_values(constants: ConstantReals, block: Block, groups: Integer, residuals: Reals) -> None:
    """Losses in square-root form, in place."""
    rows = block.outputs
    for u in range(block.unit_count):
        unit = block.units[u]
        if unit.loss != NO_LOSS:
            size = unit.last - unit.first
            scale = constants[unit.loss_at]
            shape = constants[unit.loss_at + 1]
            for group in range(groups):
                for lane in range(LANES):
                    own = residuals[(group * rows + unit.first) * LANES + lane :]
                    factor = root_factor(unit.loss, square_of(size, own), scale, shape)
                    for i in range(size):
                        own[i * LANES] *= factor


def residuals_at_point(
    problem: Problem,
    rows: Rows,
    point: ConstantReals,
    lossy: Integer,
    penalised: Integer,
    target: Reals,
) -> Integer:
    """All residuals at a point; how many numbers of ``target`` they take, a multiple of 4.

    ``lossy`` 0 leaves the losses out, ``penalised`` 0 the constraints.
    """
    inputs = 0
    whitening = 0
    outputs = rows.outputs
    done = fused_rows(problem, rows, 0, point, 0, target) if LANES > 1 else 0
    for b in range(
        first_separate(problem, rows) if LANES > 1 else 0,
        problem.residual_blocks + penalised * problem.constraint_blocks,
    ):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        count = separate_rows(problem, rows, b) if LANES > 1 else part.rows
        width = (block.variables + block.parameters) * LANES
        heavy = weights_width(block) * LANES
        gather(block, count, rows.index[part.index :], point, rows.inputs[inputs:])
        most = portion(problem, block)
        first = 0
        while first < groups_of(count):
            groups = most
            if first + groups > groups_of(count):
                groups = groups_of(count) - first
            call_kernel(block.values, rows.inputs[inputs + first * width :], outputs, groups)
            whitening_here = rows.weights[whitening + first * heavy :]
            if b < problem.residual_blocks:
                whiten_values(block, groups, block.outputs, outputs, whitening_here, target[done:])
                if lossy == 1:
                    root_values(rows.constants, block, groups, target[done:])
            else:
                penalise_values(block, groups, block.outputs, outputs, whitening_here, target[done:])
            done += groups * LANES * block.outputs
            first += groups
        inputs += groups_of(count) * width
        whitening += groups_of(count) * heavy
    while done % 4 != 0:
        target[done] = 0.0
        done += 1
    return done


def cost_at_point(
    problem: Problem, rows: Rows, point: ConstantReals, lossy: Integer, penalised: Integer, target: Reals
) -> Real:
    """``rᵀ r`` of all residuals at a point, which ``target`` holds then; the rest as `residuals_at_point` has it."""
    count = residuals_at_point(problem, rows, point, lossy, penalised, target)
    return dot(count, target, target)


def first_separate(problem: Problem, rows: Rows) -> Integer:
    """The first block that is not fused; those of constraints never are."""
    found = 0
    if rows.fused == 1:
        while found < problem.residual_blocks and problem.fused[0].rows[found] > 0:
            found += 1
    return found


def separate_rows(problem: Problem, rows: Rows, b: Integer) -> Integer:
    """The rows of a block that go through its own kernel: all, or none where they are fused."""
    if b < problem.residual_blocks and rows.fused == 1 and problem.fused[0].rows[b] > 0:
        return 0
    return rows.data.blocks[b].rows


def fuse(problem: Problem, rows: Rows) -> None:
    """The data of the fused rows, if the data set has just these and all of them count."""
    rows.fused = 0
    if problem.fused_reals == 0:
        return
    there = rows.fused_data
    done = 0
    for b in range(problem.residual_blocks):
        count = problem.fused[0].rows[b]
        if count > 0:
            block = problem.blocks[b]
            part = rows.data.blocks[b]
            if part.rows != count:
                return
            size = count * block.parameters
            copied(size, rows.parameters[part.parameters :], there[done:])
            done += size
            heavy = rows.whitening[part.weights :]
            for k in range(count * block.weights):
                if heavy[k] == 0.0:
                    return
                there[done] = heavy[k]
                done += 1
    rows.fused = 1


def fused_rows(
    problem: Problem, rows: Rows, slopes: Integer, point: ConstantReals, stride: Integer, target: Reals
) -> Integer:
    """The residuals of the fused rows, with ``slopes`` 1 behind their derivatives; how many there are, 0: none now."""
    if rows.fused == 0:
        return 0
    table = problem.fused[0]
    address = table.jacobian if slopes == 1 else table.values
    call_fused(address, point, rows.fused_data, target, stride)
    return table.residuals
