"""All solves of a problem, one after the other, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.builder import Elaborated
from mbm.problem.tables import CellKey
from mbm.solution.binding import EvaluationCache
from mbm.solution.estimate import estimate
from mbm.solution.selection import Selection, selections
from mbm.solution.settings import settings_of
from mbm.solution.solution import Failure, Solution
from mbm.solution.types import Floats
from mbm.text.types import MbmError

StartsFinder = Callable[[Mapping[str, CellKey]], Mapping[str, Floats]]
"""The starts (SI, by name) given from outside for the solve with a key."""


@dataclass(frozen=True, slots=True, eq=False)
class Solutions:
    """The number of solves, and the solves as they are made."""

    count: int
    each: Iterator[Solution | Failure]


def solutions(found: Elaborated, kernels: KernelSet, cache: EvaluationCache, starts: StartsFinder) -> Solutions:
    """The solves that the problem's ``for-each`` asks for; one without it.

    One of several solves that cannot be set up is a ``Failure``, and the others go on.

    Raises:
        MbmError: the only solve cannot be set up.
    """
    problem = found.problem
    request = problem.request
    settings = settings_of(request)
    given = {name: np.asarray(values, dtype=np.float64) for name, values in found.starts.items()}
    count, picked = selections(problem, found.tables)

    def solve(selection: Selection) -> Solution | Failure:
        try:
            return estimate(
                problem,
                kernels,
                selection.tables,
                key=selection.key,
                starts={**starts(selection.key), **given},
                settings=settings,
                cache=cache,
            )
        except MbmError as error:
            if not selection.key:
                raise
            return Failure(key=selection.key, diagnostics=error.diagnostics)

    return Solutions(count, map(solve, picked))
