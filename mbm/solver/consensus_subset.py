"""The fit to the units of one subset, with what no rule touches, by Marquardt's method on the few rows it takes.

The damping is Nielsen's (1999), bounds are kept by holding what meets them.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.consensus_constraints import moved
from mbm.solver.consensus_records import ConsensusWork
from mbm.solver.consensus_units import linearised
from mbm.solver.decisions import (
    FIRST_DAMPING,
    FIT_STEPS,
    HOPELESS_DAMPING,
    LEAST_GAIN_RATIO,
    POSITIVE_KEPT,
    REGULARISATION,
    REVISIONS,
)
from mbm.solver.description import BOUNDS_AT, Problem
from mbm.solver.equations import load_rows
from mbm.solver.linear_algebra import cholesky, copied, dot, filled
from mbm.solver.manifolds import coordinates_of
from mbm.solver.step_control import damping_factor

SMALL = 1e-14
"""Square of the tolerance: the fit is over where a step promises no more of the cost."""


def copied_integers(n: Integer, a: ConstantIntegers, target: Integers) -> None:
    """``target = a``."""
    for i in range(n):
        target[i] = a[i]


def add_row(problem: Problem, b: Integer, row: Integer, only: Integer, work: ConsensusWork) -> None:
    """One more row of block b behind those of the subset; all its units count (``only`` -1), or one of them."""
    rows = work.rows
    block = problem.blocks[b]
    part = rows.data.blocks[b]
    mine = work.subset_rows.data.blocks[b]
    done = mine.rows
    wide = block.parameters
    heavy = block.weights
    own = work.subset_parameters[mine.parameters + done * wide :]
    copied(wide, rows.parameters[part.parameters + row * wide :], own)
    theirs = rows.whitening[part.weights + row * heavy :]
    here = work.subset_whitening[mine.weights + done * heavy :]
    if only < 0:
        copied(heavy, theirs, here)
    else:
        filled(heavy, 0.0, here)
        unit = block.units[only]
        size = unit.last - unit.first
        if unit.matrix != 0:
            size = size * size
        copied(size, theirs[unit.weights :], here[unit.weights :])
    step = block.index
    if step > 0 or done == 0:
        first = part.index + row * step
        copied_integers(block.variables, rows.index[first:], work.subset_index[mine.index + done * step :])
    step = block.columns
    if step > 0 or done == 0:
        first = part.columns + row * step
        copied_integers(block.tangents, rows.columns[first:], work.subset_columns[mine.columns + done * step :])
    mine.rows = done + 1


def gather_subset(problem: Problem, count: Integer, work: ConsensusWork) -> None:
    """The rows of the chosen units (count,), and all that no rule acts on, as a data set of its own."""
    subset = work.subset_rows.data
    units = work.units
    subset.count = 0
    wide = 0
    heavy = 0
    variables = 0
    tangents = 0
    for b in range(problem.residual_blocks):
        block = problem.blocks[b]
        mine = subset.blocks[b]
        mine.parameters = wide
        mine.weights = heavy
        mine.index = variables
        mine.columns = tangents
        mine.rows = 0
        if work.rules.ruled[b].first_level >= 0:
            for k in range(count):
                unit = work.chosen[k]
                if units.block[unit] == b:
                    add_row(problem, b, units.row[unit], units.equation[unit], work)
        else:
            for row in range(work.rows.data.blocks[b].rows):
                add_row(problem, b, row, -1, work)
        rows = mine.rows
        wide += rows * block.parameters
        heavy += rows * block.weights
        variables += block.variables + rows * block.index
        tangents += block.tangents + rows * block.columns
    for b in range(problem.residual_blocks, problem.residual_blocks + problem.constraint_blocks):
        mine = subset.blocks[b]
        mine.parameters = 0
        mine.weights = 0
        mine.index = 0
        mine.columns = 0
        mine.rows = 0
    load_rows(problem, work.subset_rows)


def normal_equations(problem: Problem, count: Integer, chunk: ConstantReals, work: ConsensusWork) -> Integer:
    """``JᵀJ`` and ``Jᵀr`` of a chunk, columns scaled by the largest norms they have had; 0 where not all is finite."""
    n = problem.n
    stride = problem.chunk
    normal = work.normal
    gradient = work.gradient
    scale = work.scale
    for i in range(n):
        gradient[i] = dot(count, chunk[i * stride :], chunk[n * stride :])
        if not isfinite(gradient[i]):
            return 0
        for j in range(i + 1):
            normal[i * n + j] = dot(count, chunk[i * stride :], chunk[j * stride :])
            normal[j * n + i] = normal[i * n + j]
            if not isfinite(normal[i * n + j]):
                return 0
        scale[i] = max(sqrt(normal[i * n + i]), scale[i])
    for i in range(n):
        by = scale[i] if scale[i] > 0.0 else 1.0
        gradient[i] = gradient[i] / by
        for j in range(n):
            normal[i * n + j] = normal[i * n + j] / by
            normal[j * n + i] = normal[j * n + i] / by
    return 1


def solve_free(
    n: Integer,
    damping: Real,
    normal: ConstantReals,
    gradient: ConstantReals,
    hold: ConstantReals,
    factor: Reals,
    step: Reals,
) -> None:
    """``(normal + damping) step = -gradient`` for what is not held; held coordinates keep their step."""
    for i in range(n):
        for j in range(i + 1):
            factor[i * n + j] = normal[i * n + j]
            if hold[i] + hold[j] > 0.0:
                factor[i * n + j] = 0.0
        factor[i * n + i] = 1.0 if hold[i] > 0.0 else normal[i * n + i] + damping + REGULARISATION
    good = cholesky(n, factor)
    for i in range(n):
        if hold[i] == 0.0:
            total = -gradient[i]
            for j in range(n):
                if hold[j] > 0.0:
                    total -= normal[i * n + j] * step[j]
            for j in range(i):
                if hold[j] == 0.0:
                    total -= factor[i * n + j] * step[j]
            step[i] = total / factor[i * n + i] if good == 1 else 0.0
    for back in range(n):
        i = n - 1 - back
        if hold[i] == 0.0:
            total = step[i]
            for j in range(i + 1, n):
                if hold[j] == 0.0:
                    total -= factor[j * n + i] * step[j]
            step[i] = total / factor[i * n + i] if good == 1 else 0.0


def bounded_step(problem: Problem, damping: Real, point: ConstantReals, work: ConsensusWork) -> Real:
    """The damped step inside of the bounds; the largest slope along a coordinate that is free to move is given."""
    n = problem.n
    constants = work.subset_rows.constants
    gradient = work.gradient
    scale = work.scale
    hold = work.hold
    here = work.coordinates
    step = work.step
    normal = work.normal
    factor = work.basis
    coordinates_of(problem, point, here)
    slope = 0.0
    for i in range(n):
        hold[i] = 0.0
        step[i] = 0.0
        if problem.number_of[i] >= 0:
            if here[i] <= constants[BOUNDS_AT + i] and gradient[i] >= 0.0:
                hold[i] = 1.0
            if here[i] >= constants[BOUNDS_AT + n + i] and gradient[i] <= 0.0:
                hold[i] = 1.0
        if hold[i] == 0.0:
            slope = max(slope, fabs(gradient[i]))
    for _ in range(REVISIONS + 1):
        solve_free(n, damping, normal, gradient, hold, factor, step)
        beyond = 0
        for i in range(n):
            if hold[i] == 0.0 and problem.number_of[i] >= 0:
                by = scale[i] if scale[i] > 0.0 else 1.0
                down = (constants[BOUNDS_AT + i] - here[i]) * by
                up = (constants[BOUNDS_AT + n + i] - here[i]) * by
                if problem.positive[i] == 1:
                    down = max(down, (POSITIVE_KEPT - 1.0) * here[i] * by)
                if step[i] < down:
                    step[i] = down
                    hold[i] = 1.0
                    beyond = 1
                if step[i] > up:
                    step[i] = up
                    hold[i] = 1.0
                    beyond = 1
        if beyond == 0:
            break
    return slope


def fitted_to_subset(problem: Problem, start: ConstantReals, work: ConsensusWork, target: Reals) -> None:
    """The point (N,) that the start leads to with the rows of the subset; never worse than the start."""
    n = problem.n
    right = n * problem.chunk
    subset_rows = work.subset_rows
    step = work.step
    scale = work.scale
    here = work.first
    there = work.second
    copied(problem.numbers, start, here.point)
    filled(n, 0.0, scale)
    count = linearised(problem, subset_rows, start, work, here.chunk)
    residuals = here.chunk[right:]
    cost = dot(count, residuals, residuals)
    damping = FIRST_DAMPING
    growth = 2.0
    for _ in range(FIT_STEPS):
        if not isfinite(cost) or not damping <= HOPELESS_DAMPING:
            break
        if normal_equations(problem, count, here.chunk, work) == 0:
            break
        slope = bounded_step(problem, damping, here.point, work)
        promise = 0.0
        for i in range(n):
            projected = dot(n, work.normal[i * n :], step)
            promise -= step[i] * (projected + 2.0 * work.gradient[i])
        if slope * slope <= SMALL * cost or cost <= SMALL * float(count):
            break
        last = damping <= FIRST_DAMPING and promise >= 0.0 and promise <= SMALL * cost
        for i in range(n):
            if scale[i] > 0.0:
                step[i] = step[i] / scale[i]
        moved(problem, here.point, step, work, there.point)
        linearised(problem, subset_rows, there.point, work, there.chunk)
        residuals = there.chunk[right:]
        lower = dot(count, residuals, residuals)
        share = (cost - lower) / promise if promise > 0.0 else -1.0
        if share > LEAST_GAIN_RATIO and isfinite(lower):
            tried = there
            there = here
            here = tried
            cost = lower
            damping *= damping_factor(share)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
        if last:
            break
    copied(problem.numbers, here.point, target)
