"""Many solves from their starts to their ends, in native code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import REASONS, Ends, Kept, Solver, Which, places_of
from mbm.estimation.settings import Settings

if TYPE_CHECKING:
    from mbm.estimation.minimise.native.packing import Rows
    from mbm.estimation.minimise.native.system import NativeEnds, NativeSystem
    from mbm.solver.range_maps import RangeMaps


def solver_of(stack: Stack, settings: Settings, ranges: RangeMaps | None = None) -> Solver | None:
    """What solves the data sets of a stack, compared with ``ranges``; None where native code does not handle them."""
    found = native_sets(stack, settings)
    if found is None:
        return None
    native = replace(found, ranges=ranges)
    limits = int(stack.limits.max(initial=0))

    def solve(which: Which, points: Floats) -> Ends:
        found = native.solve(points, np.asarray(which), stopped=settings.stopped)
        return replace(plain_ends(found), multipliers=found.multipliers[:, :limits] if limits else None)

    return solve


def native_sets(stack: Stack, settings: Settings) -> NativeSystem | None:
    """The equations as a native system with a data set for each solve; None where native code does not handle them.

    Where the rows are so many that kernels are compiled for speed, functions that sum normal equations pay as well.
    """
    from mbm.estimation.minimise.native.system import system_of
    from mbm.kernels.native.kernels import MANY

    most = [int(rows.max(initial=0)) for rows in stack.rows]
    often = any(group.rows >= MANY for group in stack.equations.groups)
    made = system_of(stack.equations, settings, most_rows=most, often=often)
    return (
        None
        if made is None
        else replace(made, rows=replace(made.rows, data=data_sets(stack.first, stack.rows, made.system, made.rows)))
    )


def reweighted(stack: Stack, native: NativeSystem, which: Which, scales: Sequence[Floats | None]) -> NativeSystem:
    """A data set for each of some solves (K,), whitened by other weights.

    ``scales`` multiply those of the rows of each group, (R, weights of a row) or (R, 1); None: they stay.
    """
    from mbm.estimation.minimise.native.packing import blocks_of
    from mbm.solver import description as of

    blocks = blocks_of(native.system)
    data = native.rows.data[places_of(which)].copy()
    weights = [native.rows.weights]
    taken = len(native.rows.weights)
    begin = 0
    for number, (group, scale) in enumerate(zip(stack.equations.groups, scales, strict=True)):
        width = int(blocks[number, of.Block.weights])
        whole = native.rows.weights[begin : begin + group.rows * width].reshape(group.rows, width)
        begin += whole.size
        if scale is None:
            continue
        part = whole[stack.lines(number, which)[1]] * scale
        rows = stack.rows[number, places_of(which)]
        data[:, of.DATA_HEAD + number * of.DATA_BLOCK + of.DataBlock.weights] = taken + width * (np.cumsum(rows) - rows)
        weights.append(part.ravel())
        taken += part.size
    return replace(native, rows=replace(native.rows, weights=np.append(np.concatenate(weights), 0.0), data=data))


def weighted(
    stack: Stack, native: NativeSystem, which: Which, kept: Kept | None, factors: Floats | None = None
) -> NativeSystem:
    """A data set for each of some solves, without what is not kept; rows are divided by ``factors`` (K, blocks)."""
    from mbm.solver import description as of

    scales: list[Floats | None] = []
    for number, group in enumerate(stack.equations.groups):
        scale = None
        outputs = None if kept is None else kept.outputs[number]
        if outputs is not None:
            whole = [(outputs[:, w.first, None], prod(w.weights.shape[1:])) for w in group.whiteners]
            scale = np.hstack([np.repeat(each, size, axis=1) for each, size in whole]).astype(np.float64)
        if factors is not None and bool((factors[:, group.kernel.owner] != 1.0).any()):
            inverse = 1.0 / factors[:, group.kernel.owner][stack.lines(number, which)[0]][:, None]
            scale = inverse if scale is None else scale * inverse
        scales.append(scale)
    found = reweighted(stack, native, which, scales)
    if kept is not None:
        found.rows.data[:, of.DataSet.count] = kept.count
    return found


def plain_ends(found: NativeEnds) -> Ends:
    """Native ends by the names that the general path has; those that it should look at have no reason."""
    from mbm.estimation.minimise.native.minimum import ENDINGS
    from mbm.solver import description as of

    number = np.full(max(ENDINGS) + 1, -1, dtype=np.int64)
    number[list(ENDINGS)] = [REASONS.index(reason) for reason in ENDINGS.values()]
    reasons = found.states[:, of.REASON]
    return Ends(
        points=found.numbers,
        cost=found.results[:, of.COST],
        reason=np.where(found.clean, number[np.minimum(reasons, max(ENDINGS))], -1),
        iterations=found.states[:, of.STEPS],
        evaluations=found.states[:, of.EVALUATIONS],
        held=(found.sides != 0).any(axis=1),
        compared=found.states[:, of.COMPARED] != 0,
    )


def data_sets(first: Indices, counts: Indices, system: Indices, rows: Rows) -> Indices:
    """For each data set how many residuals it has and where its rows stand, as `mbm.solver.description` says.

    ``first`` and ``counts`` (groups, T) are the first row of each in a group, and how many there are.
    """
    from mbm.estimation.minimise.native.packing import blocks_of
    from mbm.solver import description as of

    every, sets = rows.data[0], counts.shape[1]
    data = np.tile(every, (sets, 1))
    blocks = blocks_of(system)
    residual = int(system[of.Problem.residual_blocks])
    data[:, of.DataSet.count] = blocks[:residual, of.Block.outputs] @ counts[:residual]
    steps = (
        (of.DataBlock.parameters, of.Block.parameters),
        (of.DataBlock.weights, of.Block.weights),
        (of.DataBlock.index, of.Block.index),
        (of.DataBlock.columns, of.Block.columns),
    )
    for number in range(len(counts)):
        place = of.DATA_HEAD + number * of.DATA_BLOCK
        for where, step in steps:
            data[:, place + where] += first[number] * int(blocks[number, step])
        data[:, place + of.DataBlock.rows] = counts[number]
    return data
