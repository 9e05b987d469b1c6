"""A problem with states by a filter or smoother, as `mbm.estimation.solve.estimate` solves one by ``batch``."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.settings import Settings
from mbm.kernels.types import KernelSet
from mbm.language import faults as language_faults
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError


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
        MbmError: the method is not there.

    """
    if problem.sequence is None:
        raise TypeError(problem.name)
    estimator = problem.sequence.estimator
    what = f"`:method {estimator.method.value}`"
    raise MbmError(language_faults.not_available_yet(estimator.span, what, "filters"))
