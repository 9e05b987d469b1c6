"""Many solves from their starts to their ends, in native code."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.solution.many.stack import Stack
from mbm.solution.many.types import REASONS, Descent, Ends
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Indices

if TYPE_CHECKING:
    from mbm.solution.native.system import NativeEnds, NativeSystem


def descent_of(stack: Stack, points: Floats, settings: Settings) -> Descent | None:
    """What solves the data sets of a stack from ``points`` (T, N); None where native code does not handle them."""
    native = native_sets(stack, settings)
    if native is None:
        return None

    def descent(which: range) -> Ends:
        return plain_ends(native.solve(points[which.start : which.stop], np.arange(which.start, which.stop)))

    return descent


def native_sets(stack: Stack, settings: Settings) -> NativeSystem | None:
    """The equations as a native system with a data set for each solve; None where native code does not handle them."""
    # Loaded where native code may run only, so that everything works without it.
    from mbm.solution.native.system import system_of

    most = [int(rows.max(initial=0)) for rows in stack.rows]
    made = system_of(stack.equations, settings, most_rows=most)
    return None if made is None else replace(made, rows=replace(made.rows, data=_sets(stack, made)))


def plain_ends(found: NativeEnds) -> Ends:
    """Native ends by the names that the general path has; those that it should look at have no reason."""
    from mbm.solution.native.minimum import ENDINGS
    from mbm.target.solver import description as of

    number = np.full(max(ENDINGS) + 1, -1, dtype=np.int64)
    number[list(ENDINGS)] = [REASONS.index(reason) for reason in ENDINGS.values()]
    reasons = found.states[:, of.REASON]
    return Ends(
        points=found.numbers,
        cost=found.results[:, of.COST],
        offset=found.results[:, of.OFFSET],
        reason=np.where(found.clean, number[np.minimum(reasons, max(ENDINGS))], -1),
        iterations=found.states[:, of.STEPS],
        evaluations=found.states[:, of.EVALUATIONS],
        held=(found.sides != 0).any(axis=1),
    )


def _sets(stack: Stack, native: NativeSystem) -> Indices:
    """For each solve, how many residuals it has and where its rows stand, as `mbm.target.solver.description` says."""
    from mbm.target.solver import description as of

    every = native.rows.data[0]
    data = np.tile(every, (stack.solves, 1))
    data[:, of.DATA_COUNT] = stack.residuals
    blocks_at = int(native.system[of.BLOCKS_AT])
    steps = (
        (of.DATA_PARAMETERS, of.BLOCK_PARAMETERS),
        (of.DATA_WEIGHTS, of.BLOCK_WEIGHTS),
        (of.DATA_INDEX, of.BLOCK_INDEX),
        (of.DATA_COLUMNS, of.BLOCK_COLUMNS),
    )
    for number in range(len(stack.rows)):
        block = native.system[blocks_at + number * of.BLOCK :]
        place = of.DATA_HEAD + number * of.DATA_BLOCK
        for where, step in steps:
            data[:, place + where] += stack.first[number] * int(block[step])
        data[:, place + of.DATA_ROWS] = stack.rows[number]
    return data
