"""The rows of one step, or of one transition, as lines of ``[J r]``."""

from __future__ import annotations

from mbm.machine.kinds import LANES
from mbm.machine.records import view
from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.description import DATA_BLOCK, DATA_HEAD, NO_LOSS, Block, DataSet, Problem
from mbm.solver.equations import cost_at_point, gather, groups_of, load_rows, portion, residuals_at_point, weights_width
from mbm.solver.filter_records import Walk
from mbm.solver.linear_algebra import copied, dot
from mbm.solver.sweeps import slope_portion
from mbm.solver.workspace import Rows


def load_step(walk: Walk, k: Integer) -> None:
    """The rows of step k."""
    stride = DATA_HEAD + DATA_BLOCK * (walk.seen.residual_blocks + walk.seen.constraint_blocks)
    walk.rows.data = view(DataSet, walk.seen_data[k % walk.chain.held * stride :])
    load_rows(walk.seen, walk.rows)


def load_move(walk: Walk, k: Integer) -> None:
    """Those of the transition from step k."""
    stride = DATA_HEAD + DATA_BLOCK * (walk.moving.residual_blocks + walk.moving.constraint_blocks)
    place = k % walk.chain.held
    walk.moves.data = view(DataSet, walk.moves_data[place * stride :])
    walk.spread = walk.spreads[place * (walk.chain.n - walk.chain.still) * walk.chain.noises :]
    load_rows(walk.moving, walk.moves)


@distinct_arrays
def take_lines(
    problem: Problem, block: Block, groups: Integer, rows: Integer, chunk: ConstantReals, target: Reals
) -> None:
    """``rows`` rows of a portion of a chunk, line by line."""
    width = problem.n + 1
    stride = problem.chunk
    lines = block.outputs
    for group in range(groups):
        for lane in range(LANES):
            row = group * LANES + lane
            if row < rows:
                for i in range(lines):
                    place = (group * lines + i) * LANES + lane
                    for column in range(width):
                        target[(row * lines + i) * width + column] = chunk[column * stride + place]


def whitened_lines(problem: Problem, rows: Rows, point: ConstantReals, target: Reals) -> Integer:
    """The whitened rows at a point, with losses, as lines (…, n + 1) of ``[J r]``; how many there are."""
    inputs = 0
    whitening = 0
    done = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        part = rows.data.blocks[b]
        count = part.rows
        width = (block.variables + block.parameters) * LANES
        heavy = weights_width(block) * LANES
        gather(block, count, rows.index[part.index :], point, rows.inputs[inputs:])
        first = 0
        while first < groups_of(count):
            groups = portion(problem, block)
            if first + groups > groups_of(count):
                groups = groups_of(count) - first
            given = rows.inputs[inputs + first * width :]
            weights = rows.weights[whitening + first * heavy :]
            slope_portion(problem, b, first, groups, rows, given, weights, rows.chunk)
            own = count - first * LANES
            if own > groups * LANES:
                own = groups * LANES
            take_lines(problem, block, groups, own, rows.chunk, target[done * (problem.n + 1) :])
            done += own * block.outputs
            first += groups
        inputs += groups_of(count) * width
        whitening += groups_of(count) * heavy
    return done


def step_lines(walk: Walk, point: ConstantReals) -> Integer:
    """Those of the step whose rows are loaded."""
    return whitened_lines(walk.seen, walk.rows, point, walk.jacobian)


def step_cost(walk: Walk, point: ConstantReals) -> Real:
    """What these rows add to the cost at a point, losses included."""
    walk.evaluations += 1
    return cost_at_point(walk.seen, walk.rows, point, 1, 0, walk.rows.residuals)


def plain_step_cost(walk: Walk, point: ConstantReals) -> Real:
    """The same without losses."""
    count = residuals_at_point(walk.seen, walk.rows, point, 0, 0, walk.rows.residuals)
    return dot(count, walk.rows.residuals, walk.rows.residuals)


def widen_losses(walk: Walk, factor: Real) -> None:
    """Let the losses of the rows begin to count less at so many times the residuals as stated."""
    problem = walk.seen
    copied(walk.chain.constants, walk.stated, walk.widened)
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        for u in range(block.unit_count):
            unit = block.units[u]
            if unit.loss != NO_LOSS:
                walk.widened[unit.loss_at] = factor * walk.stated[unit.loss_at]
    walk.rows.constants = walk.widened
