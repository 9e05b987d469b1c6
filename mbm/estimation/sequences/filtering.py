"""A problem with states by a filter or smoother, as `mbm.estimation.solve.estimate` solves one by ``batch``."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.settings import Settings
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem


def by_filter(problem: Problem) -> bool:
    """Whether the problem asks for a filter or a smoother."""
    return problem.sequence is not None and problem.sequence.estimator.method is not SequenceMethod.BATCH


def filtered(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    *,
    key: Mapping[str, CellKey],
    starts: Mapping[str, Floats],
    settings: Settings,
    cache: EvaluationCache,
    last: Solution | None = None,
) -> Solution:
    """The states of one data set by the method that the problem asks for; the arguments are those of `estimate`.

    Raises:
        MbmError: the problem has what filters do not take, or something has no start.

    """
    # Loaded by problems with states only, so that the others start at once.
    from mbm.estimation.sequences.run import walked

    del last
    return walked(problem, kernels, tables, key=key, starts=starts, settings=settings, cache=cache)
