"""A problem with states by a filter or smoother, as `mbm.estimation.solve.estimate` solves one by ``batch``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from mbm.equations.binding import EvaluationCache
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import estimate
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import Estimator, SequenceMethod
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem


def by_filter(problem: Problem) -> bool:
    """Whether the problem asks for a filter or a smoother."""
    return problem.sequence is not None and problem.sequence.estimator.method is not SequenceMethod.BATCH


def smoothed(problem: Problem, purpose: str, instead: str) -> Problem:
    """The problem with a smoother where it asks for ``batch``: both take all rows together.

    Messages say that it is for a ``purpose``, and what to do ``instead``.
    """
    sequence = problem.sequence
    if sequence is None:
        return problem
    own = sequence.estimator if by_filter(problem) else Estimator(method=SequenceMethod.SMOOTHER)
    return replace(problem, sequence=replace(sequence, estimator=replace(own, purpose=purpose, instead=instead)))


def moved(
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

    ``batch`` begins where a smoother ends if what is carried on from the first step is no start. A smoother of all
    steps that is not cut hands over to ``batch`` where inequalities and bounds matter, and where its path does not
    settle.

    Raises:
        MbmError: the problem has what filters do not take, or something has no start.

    """
    # Loaded by problems with states only, so that the others start at once.
    from mbm.estimation.sequences.beginning import starts_of_all_steps
    from mbm.estimation.sequences.limits import meets_limits
    from mbm.estimation.sequences.run import walked

    if not by_filter(problem):
        begun = starts_of_all_steps(problem, kernels, tables, starts, settings, cache)
        return estimate(problem, kernels, tables, key=key, starts=begun, settings=settings, cache=cache, last=last)
    found = walked(problem, kernels, tables, key=key, starts=starts, settings=settings, cache=cache)
    sequence = problem.sequence
    if sequence is None or not sequence.estimator.whole:
        return found
    settled = found.minimum.reason.converged
    if sequence.estimator.cuts:
        return found
    if settings.stopped() if not settled else meets_limits(problem, found):
        return found
    # What all rows say is beyond a limit, or the path got stuck: `batch` takes all rows as this smoother does.
    estimator = replace(sequence.estimator, method=SequenceMethod.BATCH)
    together = replace(problem, sequence=replace(sequence, estimator=estimator))
    ended = {e.unknown.name: found.numbers[e.range] for e in found.layout.entries}
    begun = {**ended, **starts} if settled else starts_of_all_steps(together, kernels, tables, starts, settings, cache)
    met = estimate(together, kernels, tables, key=key, starts=begun, settings=settings, cache=cache, last=last)
    if not settled and not met.minimum.reason.converged:
        return found
    method = f"smoother, {'limits' if settled else 'end'} by {met.method}"
    return replace(met, method=method, seconds=found.seconds + met.seconds)
