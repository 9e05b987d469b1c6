"""One walk of a filter or smoother over the steps of a problem, from the problem to its solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.faults import no_unknowns
from mbm.equations.types import Floats
from mbm.estimation.search.solution import Solution
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.answer import Walked, solution_of
from mbm.estimation.sequences.limits import beyond_bounds, refuse_limits
from mbm.estimation.sequences.lowering import lowered
from mbm.estimation.sequences.places import Places, places_of
from mbm.estimation.sequences.prior import prior_of
from mbm.estimation.sequences.spread import Told, told
from mbm.estimation.sequences.walk import Chained, Prior, Rules
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import bound_equations
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import Estimator, Sequence, SequenceMethod
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

FINE = 1e-9
"""A step, in standard deviations, that ends the iteration over all steps: answers are those of ``batch``."""

COARSE = 1e-6
"""The same for updates and windows, which are many: what is left of them goes on into the next."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Begun:
    """A problem made ready for its walk."""

    problem: Problem
    sequence: Sequence
    tables: Mapping[str, Table]
    equations: Assembled
    binder: Binder
    places: Places
    chained: Chained
    prior: Prior
    rules: Rules


def begun(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    settings: Settings,
    cache: EvaluationCache,
) -> Begun:
    """What a walk over all steps takes.

    Raises:
        MbmError: the problem has what filters do not take, or something has no start.

    """
    sequence = problem.sequence
    if sequence is None:
        raise TypeError(problem.name)
    _refuse(sequence, settings)
    equations, binder = bound_equations(problem, kernels, tables, starts, cache)
    refuse_limits(problem, equations)
    method = sequence.estimator.method.value
    places = places_of(equations, len(tables[sequence.steps]), method)
    if not len(places.free):
        raise MbmError(no_unknowns(problem.span))
    low = lowered(problem, sequence, equations, places, tables, cache)
    prior = prior_of(problem, sequence, equations, places, low.priors, tables, low.chained.seen)
    if np.isnan(prior.point).any():
        if not low.chained.linear:
            missing = int(places.numbers[0][np.flatnonzero(np.isnan(prior.point))[0]])
            name = next(e.unknown.name for e in equations.layout.entries if e.range.start <= missing < e.range.stop)
            what = f"begins where the equations are linearised, and `{name}` has no start"
            raise MbmError(faults.not_for_filters(problem.unknown(name).span, method, what, "give it an `:init`"))
        prior = prior.filled()
    if sequence.estimator.method is SequenceMethod.SMOOTHER and low.chained.seen.equalities:
        what = "takes no equations among the constraints: they couple what it takes one after the other"
        raise MbmError(faults.not_for_filters(sequence.estimator.span, method, what, "use `:method batch`"))
    return Begun(
        problem=problem,
        sequence=sequence,
        tables=tables,
        equations=equations,
        binder=binder,
        places=places,
        chained=low.chained,
        prior=prior,
        rules=_rules(sequence.estimator, settings, low.chained.lossy),
    )


def walked(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    *,
    key: Mapping[str, CellKey],
    starts: Mapping[str, Floats],
    settings: Settings,
    cache: EvaluationCache,
) -> Solution:
    """As `mbm.estimation.sequences.filtering.filtered`."""
    began = perf_counter()
    ready = begun(problem, kernels, tables, starts, settings, cache)
    track = ready.chained.walk(ready.prior, ready.rules, settings.stopped)
    solved = Told(equations=ready.equations, binder=ready.binder, places=ready.places)
    found = solution_of(
        Walked(
            problem=problem,
            kernels=kernels,
            tables=tables,
            key=key,
            solved=solved,
            told=told(solved, ready.sequence, kernels, starts),
            chained=ready.chained,
            prior=ready.prior,
            rules=ready.rules,
            track=track,
        ),
        seconds=lambda: perf_counter() - began,
    )
    if ready.sequence.estimator.whole:
        return found
    return replace(found, diagnostics=(*found.diagnostics, *beyond_bounds(problem, found)))


def _refuse(sequence: Sequence, settings: Settings) -> None:
    """What no filter does."""
    estimator = sequence.estimator
    if settings.robust is not None:
        what = "does not look for agreeing rows: `:robust` needs all steps at once"
        mend = "use a `:loss` with `iterated-ekf` or a smoother, or `:method batch`"
        raise MbmError(faults.not_for_filters(estimator.span, estimator.method.value, what, mend))
    if estimator.hypotheses > 1 and estimator.method is SequenceMethod.SMOOTHER:
        what, mend = "follows one hypothesis", "leave `:hypotheses` out, or use a filter"
        raise MbmError(faults.not_for_filters(estimator.span, estimator.method.value, what, mend))


def _rules(estimator: Estimator, settings: Settings, lossy: bool) -> Rules:
    once = estimator.method in (SequenceMethod.EKF, SequenceMethod.TRUNCATED) and not estimator.iterated
    if once and lossy:
        what = "linearises once, and a loss needs iteration"
        mend = "use `iterated-ekf` or a smoother"
        raise MbmError(faults.not_for_filters(estimator.span, estimator.method.value, what, mend))
    smooth = estimator.method is SequenceMethod.SMOOTHER
    return Rules(
        iterations=1 if once else settings.max_iterations,
        cut=estimator.cuts or estimator.method is SequenceMethod.TRUNCATED,
        skip=estimator.skip,
        tolerance=FINE if smooth and estimator.lag is None else COARSE,
        smooth=smooth,
        hypotheses=estimator.hypotheses,
        lag=estimator.lag,
    )
