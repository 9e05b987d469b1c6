"""One walk of a filter or smoother over the steps of a problem, from the problem to its solution.

What is known before the first step: the means and covariances that the states have there, and what has none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence as Many
from dataclasses import replace
from time import perf_counter

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.faults import no_unknowns
from mbm.equations.layout import places_in
from mbm.equations.types import Floats, Observability
from mbm.equations.whitening import stated_noise
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native.system import never
from mbm.estimation.search.solution import Solution
from mbm.estimation.sequences import faults
from mbm.estimation.sequences.answer import Walked, solution_of
from mbm.estimation.sequences.limits import beyond_bounds, refuse_limits
from mbm.estimation.sequences.local import Local
from mbm.estimation.sequences.lowering import lowered
from mbm.estimation.sequences.noise import covariance_of
from mbm.estimation.sequences.places import Places, names_of_step, places_of
from mbm.estimation.sequences.spread import Told, told
from mbm.estimation.sequences.types import Carried, Prior, Rules, Track
from mbm.estimation.sequences.walk import Chained, Memory
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import bound_equations, decided
from mbm.kernels.types import KernelSet
from mbm.problem.sequence.types import Estimator, Sequence, SequenceMethod
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

FINE = 1e-9
"""A step, in standard deviations, that ends the iteration over all steps: answers are those of ``batch``."""

COARSE = 1e-6
"""The same for updates, which are many: what is left of them goes on into the next."""

WINDOWED, WINDOWED_UNDER_LOSSES = 1e-4, 1e-5
"""The same for the windows of a fixed lag: each step is solved again in the next ones, with what was left of it. Poses
ended 5e-7 standard deviations from where 1e-6 takes them; under losses steps shrink slowly."""


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
    carried: Carried | None = None,
) -> Begun:
    """What a walk over all steps takes; it may begin with what is ``carried`` on from rows before.

    Raises:
        MbmError: the problem has what filters do not take, or something has no start.

    """
    sequence = problem.sequence
    if sequence is None:
        raise TypeError(problem.name)
    _refuse(sequence, settings)
    equations, binder = bound_equations(problem, kernels, tables, starts, cache)
    refuse_limits(problem, equations)
    places = places_of(equations, len(tables[sequence.steps]), sequence.estimator)
    if not len(places.free):
        raise MbmError(no_unknowns(problem.span))
    new, names = None, names_of_step(equations.layout, places)
    if carried is not None:
        new = np.zeros(len(equations.numbers), dtype=bool)
        new[places.numbers[0]] = [name not in carried.numbers for name in names[0]]
    low = lowered(problem, sequence, equations, places, tables, cache, new=new)
    if carried is None:
        prior = prior_of(problem, sequence, equations, places, low.priors, tables, low.chained.seen)
    else:
        prior = carried.named(*names, low.chained.seen.equations.layout.start)
    if np.isnan(prior.point).any():
        if not low.chained.linear:
            missing = int(places.numbers[0][np.flatnonzero(np.isnan(prior.point))[0]])
            name = next(e.unknown.name for e in equations.layout.entries if e.range.start <= missing < e.range.stop)
            what = f"begins where the equations are linearised, and `{name}` has no start"
            raise MbmError(
                faults.not_for_filters(problem.unknown(name).span, sequence.estimator, what, "give it an `:init`")
            )
        prior = prior.filled()
    estimator = sequence.estimator
    if estimator.method is SequenceMethod.SMOOTHER and low.chained.seen.equalities:
        what = "takes no equations among the constraints: they couple what it takes one after the other"
        raise MbmError(faults.not_for_filters(estimator.span, estimator, what, estimator.instead))
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


def walk_of(
    ready: Begun,
    kernels: KernelSet,
    *,
    key: Mapping[str, CellKey],
    starts: Mapping[str, Floats],
    memory: Memory,
    stopped: Callable[[], bool] = never,
) -> Walked:
    """The walk over all steps, in a memory that is new, with what it is told with."""
    solved = Told(equations=ready.equations, binder=ready.binder, places=ready.places)
    return Walked(
        problem=ready.problem,
        kernels=kernels,
        tables=ready.tables,
        key=key,
        solved=solved,
        told=told(solved, ready.sequence, kernels, starts),
        chained=ready.chained,
        prior=ready.prior,
        rules=ready.rules,
        track=memory.walked(stopped),
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
    return ended(ready, memory_of(ready), kernels, key=key, starts=starts, settings=settings, began=began)


def memory_of(ready: Begun) -> Memory:
    """What a walk takes place in."""
    return Memory(ready.chained, ready.prior, ready.rules)


def ended(
    ready: Begun,
    memory: Memory,
    kernels: KernelSet,
    *,
    key: Mapping[str, CellKey],
    starts: Mapping[str, Floats],
    settings: Settings,
    began: float,
) -> Solution:
    """The solution that the walk ends with, which ``began`` then."""
    walk = walk_of(ready, kernels, key=key, starts=starts, memory=memory, stopped=settings.stopped)
    walk = replace(walk, together=_together(ready, walk.track, settings))
    found = solution_of(walk, seconds=lambda: perf_counter() - began)
    said = beyond_bounds(found, cut=ready.rules.cut)
    return replace(found, diagnostics=(*found.diagnostics, *said))


def _together(ready: Begun, track: Track, settings: Settings) -> Observability | None:
    """What all rows together determine, where linearised one after the other they may seem to tell more.

    None: everything has a prior, or equations are linear, so that they seem to tell what they do.
    """
    equations = ready.equations
    if ready.chained.linear or not len(ready.prior.open) or track.made < len(track.points):
        return None
    numbers = equations.numbers.copy()
    numbers[ready.places.numbers] = track.points
    minimum = minimise(equations, numbers, settings)
    return decided(equations, equations, minimum, settings) if minimum.reason.converged else None


def _refuse(sequence: Sequence, settings: Settings) -> None:
    """What no filter does."""
    estimator = sequence.estimator
    if settings.robust is not None:
        what = "does not look for agreeing rows: `:robust` needs all steps at once"
        mend = f"use a `:loss` with `iterated-ekf` or a smoother, or {estimator.instead}"
        raise MbmError(faults.not_for_filters(estimator.span, estimator, what, mend))
    if estimator.hypotheses > 1 and estimator.method is SequenceMethod.SMOOTHER:
        what, mend = "follows one hypothesis", "leave `:hypotheses` out, or use a filter"
        raise MbmError(faults.not_for_filters(estimator.span, estimator, what, mend))


def _rules(estimator: Estimator, settings: Settings, lossy: bool) -> Rules:
    once = estimator.method in (SequenceMethod.EKF, SequenceMethod.TRUNCATED) and not estimator.iterated
    if once and lossy:
        what = "linearises once, and a loss needs iteration"
        mend = "use `iterated-ekf` or a smoother"
        raise MbmError(faults.not_for_filters(estimator.span, estimator, what, mend))
    smooth = estimator.method is SequenceMethod.SMOOTHER
    windowed = WINDOWED_UNDER_LOSSES if lossy else WINDOWED
    return Rules(
        iterations=1 if once else settings.max_iterations,
        cut=estimator.cuts or estimator.method is SequenceMethod.TRUNCATED,
        skip=estimator.skip,
        tolerance=windowed if estimator.lag is not None else FINE if smooth and not estimator.cuts else COARSE,
        smooth=smooth,
        hypotheses=estimator.hypotheses,
        lag=estimator.lag,
    )


MEAN_STEPS = 20
"""Newton's steps from the start of a state to the mean of its prior: where both are stated alike, none is needed."""


def prior_of(
    problem: Problem,
    sequence: Sequence,
    equations: Assembled,
    places: Places,
    groups: Many[Group],
    tables: Mapping[str, Table],
    seen: Local,
) -> Prior:
    """The prior of the first step, from the ``groups`` of its rows."""
    layout = seen.equations.layout
    n = len(places.free)
    column = places_in(places.coordinates[0][places.free], len(equations.layout.number))
    open_ = np.ones(n, dtype=bool)
    covariance = np.zeros((n, n))
    point = equations.numbers.copy()
    point[places.numbers[0]] = layout.start
    for group in groups:
        block = problem.blocks[group.kernel.owner]
        own = None if block.table is None else tables[block.table]
        stated = block.cases[group.kernel.case].equations
        known = [covariance_of(e, stated_noise(e, own, group.positions, tables))[0] for e in stated]
        size = sum(len(each) for each in known)
        noise = np.zeros((size, size))
        done = 0
        for each in known:
            noise[done : done + len(each), done : done + len(each)] = each
            done += len(each)
        touched = np.unique(column[group.columns[0]])
        touched = touched[touched >= 0]
        for _ in range(MEAN_STEPS):
            slopes = group.dense_jacobian(point, column, n)[0][:, touched]
            inverse = np.linalg.pinv(slopes)
            step = -inverse @ group.values(point)[0]
            if not np.abs(step).max(initial=0.0) > 0.0:
                break
            every = np.zeros(len(equations.layout.number))
            every[places.coordinates[0][places.free[touched]]] = step
            point = equations.layout.retract(point, every)
        covariance[np.ix_(touched, touched)] = inverse @ noise @ inverse.T
        open_[touched] = False
    for entry in equations.layout.entries:
        state = next((each for each in sequence.states if each.name == entry.unknown.name), None)
        if state is not None and state.certain:
            mine = column[entry.first : entry.first + entry.unknown.freedom][np.array(state.certain)]
            open_[mine[mine >= 0]] = False
    return Prior.of(point[places.numbers[0]], covariance, open_)
