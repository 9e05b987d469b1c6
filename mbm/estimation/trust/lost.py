"""Rows of one step after another that are left out, though they agree: the states may be elsewhere there, and lost.

Something that turns more sharply than its dynamics lets expect leaves the way that a loss or consensus holds to, and
all that is seen of it is taken for wrong. Rows that are wrong by themselves seldom follow one another for long, and lie
now here, now there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Mask
from mbm.estimation.consensus import faults
from mbm.problem.naming import key_text
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Problem
from mbm.text.types import Diagnostic

RUNS_BY_CHANCE = 1e-3
"""Expected number of such runs up to which one is no chance, where steps are left out independently of one another."""

LEAST_CHANGE = 0.5
"""What residuals change from step to step, beside their size: 1.4 if they are independent, 1 if on one side."""


@np.errstate(all="ignore")
def lost_track(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, residuals: Floats, left: Mask | None
) -> tuple[Diagnostic, ...]:
    """A warning about each clause whose rows (all,) are ``left`` out for so long; ``residuals`` (all,) are whitened."""
    if problem.sequence is None or left is None or not left.any():
        return ()
    columns, found = dict(problem.sequence.sources), []
    for owner, block in enumerate(problem.blocks):
        if block.role is BlockRole.OBSERVATION and block.table in columns:
            steps, out, seen = _by_step(tables[block.table], columns[block.table], equations, owner, residuals, left)
            first, last = _longest(out)
            size = np.linalg.norm(seen[first:last], axis=1)
            change = np.linalg.norm(np.diff(seen[first:last], axis=0), axis=1)
            rare = len(out) * float(out.mean()) ** (last - first) < RUNS_BY_CHANCE if last - first > 1 else False
            if rare and np.median(change) < LEAST_CHANGE * np.median(size):
                found.append(_said(block, problem.sequence.column, steps[first:last]))
    return tuple(found)


def _by_step(
    table: Table, column: str, equations: Assembled, owner: int, residuals: Floats, left: Mask
) -> tuple[Floats, Mask, Floats]:
    """The steps (k,) of a clause, whether all its rows there are left out, and the residuals (k, d) of the first."""
    groups = [g for g in equations.groups if g.kernel.owner == owner and g.rows and g.positions is not None]
    if not groups:
        return np.empty(0), np.empty(0, dtype=bool), np.empty((0, 1))
    size = min(group.kernel.outputs for group in groups)
    times = np.concatenate([table.numbers(column)[group.positions] for group in groups])
    firsts = np.concatenate([group.first + np.arange(group.rows) * group.kernel.outputs for group in groups])
    order = np.lexsort((firsts, times))
    steps, begins = np.unique(times[order], return_index=True)
    lines = firsts[order]
    return steps, np.logical_and.reduceat(left[lines], begins), residuals[lines[begins][:, None] + np.arange(size)]


def _longest(out: Mask) -> tuple[int, int]:
    """Where the longest run of steps that are left out begins and ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], out, [False]]).astype(np.int8)))
    if not len(edges):
        return 0, 0
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(begins[longest]), int(ends[longest])


def _said(block: Block, column: str, steps: Floats) -> Diagnostic:
    first, last = (key_text(float(steps[end])) for end in (0, -1))
    return faults.lost_rows(block.span, block.name, len(steps), f"{column} = {first} to {last}")
