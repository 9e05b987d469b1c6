"""Rows outside of a sampled table are unused: those that the start puts there, for the whole solve.

Where the estimates put other rows outside, the answer is that of the rows that were used, and says which these are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations import faults
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.sampling import samplings
from mbm.equations.types import Indices
from mbm.estimation.search.solution import Solution
from mbm.kernels.types import KernelSet
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic


def with_moved_rows(problem: Problem, kernels: KernelSet, cache: EvaluationCache, solution: Solution) -> Solution:
    """The solution, with a warning for each observation of which other rows lie inside than at the start."""
    if not any(samplings(kernel) for kernel in kernels.kernels) or not np.isfinite(solution.minimum.cost):
        return solution
    used = _positions(solution.groups)
    places = replace(solution.layout, start=solution.numbers)
    now = _positions(Binder(problem=problem, layout=places, tables=solution.tables, cache=cache).equations(kernels))
    said: list[Diagnostic] = []
    for owner, block in enumerate(problem.blocks):
        if block.table is None:
            continue
        before, after = (each.get(owner, np.empty(0, dtype=np.int64)) for each in (used, now))
        rows = solution.tables[block.table].rows
        left, entered = (rows[np.setdiff1d(a, b)] for a, b in ((before, after), (after, before)))
        if len(left) or len(entered):
            said.append(faults.sampled_rows_moved(block.span, block.name, left.tolist(), entered.tolist()))
    return replace(solution, doubts=lambda: (*solution.doubts(), *said)) if said else solution


def _positions(groups: tuple[Group, ...]) -> dict[int, Indices]:
    """The rows in use of each block that samples a table."""
    found: dict[int, list[Indices]] = {}
    for group in groups:
        if group.sampled and group.positions is not None:
            found.setdefault(group.kernel.owner, []).append(group.positions)
    return {owner: np.concatenate(parts) for owner, parts in found.items()}
