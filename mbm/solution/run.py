"""All solves of a problem, one after the other, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.builder import Elaborated
from mbm.problem.tables import CellKey
from mbm.solution.assembly import EvaluationCache
from mbm.solution.estimate import estimate
from mbm.solution.selection import selections
from mbm.solution.settings import Settings
from mbm.solution.solution import Solution
from mbm.solution.types import Floats

StartsFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The starts (SI, by name) given from outside for the solve with a key."""


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """The number of solves, and the solves as they are made."""

    count: int
    each: Iterator[Solution]


def solutions(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, starts: StartsFinder) -> Solutions:
    """The solves that the problem's ``for-each`` asks for; one without it."""
    problem = found.problem
    request = problem.request
    settings = Settings(method=request.method, max_iterations=request.max_iterations, tolerance=request.tolerance)
    given = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    count, picked = selections(problem, found.tables)
    each = (
        estimate(
            problem,
            kernels,
            selection.tables,
            key=selection.key,
            starts={**starts(selection.key), **given},
            settings=settings,
            cache=cache,
        )
        for selection in picked
    )
    return Solutions(count, each)
