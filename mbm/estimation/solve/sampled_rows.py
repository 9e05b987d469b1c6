"""Rows outside of a sampled table are unused: which these are depends on the estimates, and the estimates on the rows.

The rows are those inside at the start; where the estimates say otherwise, the solve goes on from there with their rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.sampling import samplings
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.kernels.types import KernelSet
from mbm.problem.types import Problem

MOST_ROUNDS = 5
"""Solves after which the rows stay as they are: a row at the very end of a table may come and go."""

Solve = Callable[[Mapping[str, Floats]], Solution]
"""A solve from starts by name (SI)."""


def settled(
    problem: Problem, kernels: KernelSet, cache: EvaluationCache, starts: Mapping[str, Floats], solve: Solve
) -> Solution:
    """The solve whose estimates agree with the rows that it used."""
    solution = solve(starts)
    if not any(samplings(kernel) for kernel in kernels.kernels):
        return solution
    for _ in range(MOST_ROUNDS - 1):
        if not np.isfinite(solution.minimum.cost) or not _rows_differ(problem, kernels, cache, solution):
            break
        found = {entry.unknown.name: solution.numbers[entry.range] for entry in solution.layout.entries}
        solution = solve(found)
    return solution


def _rows_differ(problem: Problem, kernels: KernelSet, cache: EvaluationCache, solution: Solution) -> bool:
    """Whether the estimates use other rows than the solve did."""
    places = replace(solution.layout, start=solution.numbers)
    binder = Binder(problem=problem, layout=places, tables=solution.tables, cache=cache)
    groups = binder.equations(kernels)
    if len(groups) != len(solution.groups):
        return True
    pairs = zip(groups, solution.groups, strict=True)
    return any(
        a.positions is not None and b.positions is not None and not np.array_equal(a.positions, b.positions)
        for a, b in pairs
    )
