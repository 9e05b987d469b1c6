"""One data set → one solution: assemble, find starts, minimise, decide the rank, propagate the uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from mbm.equations import faults
from mbm.equations.assembling import blank
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.metric import first_bad
from mbm.equations.spreads import Limited
from mbm.equations.surface import affine_by_products
from mbm.equations.types import Fit, Floats, Indices, Minimum, Observability, Reason
from mbm.estimation.consensus.known_ranges import known_ranges
from mbm.estimation.consensus.preparation import outliers, prepared, robust_cost, unit_weights
from mbm.estimation.consensus.types import Prepared
from mbm.estimation.coverage.limits import limited
from mbm.estimation.coverage.profiles import Profiles, profiles
from mbm.estimation.minimise.minimise import solver_name
from mbm.estimation.minimise.native.minimum import without_value
from mbm.estimation.search.challenge import Challenge
from mbm.estimation.search.multistart import starting_points
from mbm.estimation.search.search import Alternative, Tally, search
from mbm.estimation.search.solution import DerivedSolution, Solution
from mbm.estimation.search.starting import GIVEN, SILHOUETTES
from mbm.estimation.search.twins import derived_agreement
from mbm.estimation.settings import Settings
from mbm.estimation.solve.at_start import start_faults
from mbm.estimation.solve.weighing import Reached, checked_rows, reached
from mbm.estimation.trust.behind import behind_at, turned_anyhow
from mbm.estimation.trust.contradiction import contradictions
from mbm.estimation.trust.curvature import Curvature, curvature
from mbm.estimation.trust.fits import only
from mbm.estimation.trust.plausibility import doubts, fit_of, of_residuals
from mbm.estimation.trust.unexamined import unexamined
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.freedom import with_motions
from mbm.estimation.uncertainty.gauge import with_gauge
from mbm.estimation.uncertainty.informed import informed, rises_on
from mbm.estimation.uncertainty.invariance import curved_directions, with_invariances
from mbm.estimation.uncertainty.observability import limited as beside_limits, observed_at
from mbm.estimation.uncertainty.statistics import Statistics, cost_of, plain_residuals, statistics
from mbm.kernels.types import KernelSet
from mbm.problem.pairing import unpaired
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem, UnknownKind
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass, once


def confirmed(equations: Assembled, minimum: Minimum) -> Minimum:
    """The minimum, if the corrections there are found without those of points before; else it has no finite value.

    Searches go on from the corrections of the point before. Where only that finds them, what is asked at the minimum
    later (the covariance, residuals without losses) would depend on what was asked between.
    """
    if equations.implicit is None or minimum.bad_row is not None:
        return minimum
    equations.implicit.forget(minimum.point)
    residuals = equations.residuals(minimum.point)
    if np.isfinite(residuals).all():
        return minimum
    if minimum.blocks is None:
        lost = without_value(equations, minimum.point)
    else:
        # Loaded by sparse problems only, so that the others start at once.
        from mbm.sparse.system import without_slopes

        lost = replace(without_slopes(minimum), residuals=residuals, cost=np.nan, bad_row=first_bad(residuals))
    return replace(
        lost,
        reason=Reason.NO_FINITE_STEP,
        iterations=minimum.iterations,
        evaluations=minimum.evaluations + 1,
    )


def assemble(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    cache: EvaluationCache,
) -> tuple[Assembled, Binder]:
    """The equations of one data set; coordinates without a start have NaN in ``numbers``.

    Raises:
        MbmError: weights that are none, bounds the wrong way round.

    """
    equations, binder = bound_equations(problem, kernels, tables, starts, cache)
    if problem.sequence is None or equations.linear:
        return equations, binder
    # Loaded by problems with states only, so that the others start at once.
    from mbm.estimation.starts.carried import carried_starts

    carried = carried_starts(problem, kernels, tables, starts, cache)
    return bound_equations(problem, kernels, tables, {**carried, **starts}, cache)


def bound_equations(
    problem: Problem,
    kernels: KernelSet,
    tables: Mapping[str, Table],
    starts: Mapping[str, Floats],
    cache: EvaluationCache,
) -> tuple[Assembled, Binder]:
    """The same with the starts of states at all steps as they are stated.

    Raises:
        MbmError: likewise, or there are no steps.

    """
    sequence = problem.sequence
    if sequence is not None and not len(tables[sequence.steps]):
        raise MbmError(faults.no_equations(sum(u.size for u in problem.unknowns), sequence.span))
    places = cache.layouts.of(problem, tables, starts)
    binder = Binder(problem=problem, layout=places, tables=tables, cache=cache)
    return blank(binder, kernels), binder


def estimate(
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
    """Solve one data set; ``last`` is the solution of the window before, whose estimates may be the better start.

    Raises MbmError: it cannot be set up, or no start is known and none can be found.
    """
    began = perf_counter()
    equations, binder = assemble(problem, kernels, tables, starts, cache)
    if equations.dimension and not equations.count and (why := unpaired(problem.pairs, tables)):
        raise MbmError(faults.no_equations(equations.dimension, problem.span, why))
    robust = prepared(problem, equations, settings, lambda: starting_points(equations, settings, last), checked_rows)
    equations = robust.equations.with_factors(robust.factors)
    ranges = partial(known_ranges(cache).of, equations, settings, stated=not problem.estimates_noise)
    challenge = Challenge(equations, settings, problem, cache, ranges)
    found = challenge.anticipated(robust.starts) or challenge.compared(robust.starts)
    if found is None:
        agrees = derived_agreement(problem, binder, kernels)
        found = challenge.answered(search(equations, robust.starts, settings, problem, agrees))
        if SILHOUETTES in found.origin:
            # Loaded by starts from silhouettes only, so that the others start at once.
            from mbm.estimation.search.contours import with_faces_turned, with_symmetric_ones, with_turns

            found = with_turns(equations, found, settings, problem, agrees)
            found = with_faces_turned(equations, found, settings, problem, agrees)
            found = with_symmetric_ones(equations, found, settings, problem)
    if _places_poses(equations) and found.origin != GIVEN:
        # Loaded by families of poses only, so that the others start at once.
        from mbm.estimation.search.rival_places import with_rival_places

        found = with_rival_places(equations, found, settings, problem, tables)
    if found.alternatives:
        # Loaded where there are several minima only.
        from mbm.estimation.search.facing import before_cameras

        found = before_cameras(problem, tables, equations, found)
    end = reached(problem, robust, settings, found, None if settings.moved is None else settings.moved(key))
    run = Run(
        problem=problem, kernels=kernels, tables=tables, key=key, settings=settings, equations=equations, binder=binder
    )
    return answered(run, robust, end, tally=found.tally, origin=found.origin, seconds=lambda: perf_counter() - began)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One data set to be solved, and its equations with all rows and the noise as it is first known."""

    problem: Problem
    kernels: KernelSet
    tables: Mapping[str, Table]
    key: Mapping[str, CellKey]
    settings: Settings
    equations: Assembled
    binder: Binder


def _informed(equations: Assembled, minimum: Minimum, tally: Tally | None) -> tuple[Minimum, Tally | None]:
    """The minimum with what is known there; none that was searched for is one where the likelihood rises on."""
    minimum = informed(equations, confirmed(equations, minimum))
    if tally is None or not minimum.reason.converged or not rises_on(equations, minimum):
        return minimum, tally
    return replace(minimum, reason=Reason.ENDLESS), replace(tally, converged=0, best_found=0)


def answered(
    run: Run, robust: Prepared, end: Reached, *, tally: Tally | None, origin: str, seconds: Callable[[], float]
) -> Solution:
    """What is known at a minimum: the rank decision, the covariance, derived quantities, and what is to be doubted."""
    problem, equations, weighted, lock = run.problem, run.equations, end.equations, run.binder.cache.lock
    minimum, tally = _informed(weighted, end.minimum, tally)
    observed = decided(equations, weighted, minimum, run.settings, robust.informing)
    outcome = statistics(problem, weighted, minimum, observed, end.noise, end.factors, robust.tested(minimum.residuals))
    outcome = replace(outcome, influence=replace(outcome.influence, informing=robust.informing))
    unused = np.flatnonzero(~equations.used & ~equations.layout.fixed)  # coordinates that no equation depends on
    numbers = _known(equations, minimum.point, unused)
    propagation = Propagation(
        problem=problem,
        kernels=run.kernels,
        binder=run.binder,
        equations=weighted,
        numbers=equations.layout.reported(numbers),
        outcome=outcome,
    )
    derived, derived_covariance = propagation.all_derived()
    every = weighted.everything()
    whole = plain_residuals(every, minimum) if every is weighted else every.plain_residuals(minimum.point)
    freedom = outcome.freedoms.of_coordinates(len(outcome.covariance.sigma))
    limits = limited(weighted, minimum, outcome.covariance)
    bent = once(lambda: curvature(propagation, minimum, derived, lambda: beside()[0]))
    beside = once(lambda: _others(run, end, minimum, outcome, alone=tally is None, origin=origin))
    said = (*robust.diagnostics, *(against := contradictions(problem, run.tables, weighted, minimum, observed)))
    return Solution(
        key=run.key,
        tables=run.tables,
        layout=equations.layout,
        groups=equations.groups,
        constraints=equations.constraints,
        numbers=numbers,
        free=equations.free,
        minimum=replace(minimum, reason=Reason.CONTRADICTION) if against else robust.judged(minimum),
        residuals=whole,
        weights=unit_weights(weighted, whole),
        outliers=outliers(weighted, whole),
        robust_cost=robust_cost(weighted, minimum),
        log_likelihood=outcome.log_likelihood,
        alternatives=lambda: beside()[0],
        tally=tally,
        origin=origin,
        observability=outcome.observed,
        covariance=outcome.covariance,
        derived_covariance=derived_covariance,
        derived=derived,
        fit=outcome.fit,
        noise=end.noise,
        factors=end.factors,
        sigma_known=outcome.sigma_known,
        limited=limits,
        freedom=freedom,
        profiles=once(lambda: _profiles(run, bent(), minimum, propagation, limits, derived)),
        unused=unused,
        corrections=() if weighted.implicit is None else weighted.implicit.corrected(minimum.point),
        method=solver_name(equations, run.settings),
        iterations=end.iterations,
        evaluations=end.evaluations,
        seconds=seconds(),
        elsewhere=propagation.elsewhere,
        diagnostics=(*start_faults(problem, run.tables, minimum, equations), *outcome.diagnostics, *said),
        unexamined=lambda: unexamined(propagation, minimum, derived, bent()),
        doubts=lambda: (*beside()[1], *_seen(propagation, minimum), *doubts(propagation, minimum, derived, bent())),
        doubts_of=partial(_doubts_of, propagation, minimum),
        influence=outcome.influence,
        lock=lock,
    )


def _seen(propagation: Propagation, minimum: Minimum) -> tuple[Diagnostic, ...]:
    """Whether an answer turns its back on what is seen, or may be turned in any way."""
    equations, sigma = propagation.equations, propagation.outcome.covariance.sigma
    turned = only(turned_anyhow(equations.layout, equations.free, sigma[None])) if minimum.reason.converged else ()
    return (*behind_at(propagation.problem, equations, propagation.binder.tables, minimum.point), *turned)


def _doubts_of(propagation: Propagation, minimum: Minimum, residuals: Floats, fit: Fit) -> tuple[Diagnostic, ...]:
    """What is to be said of other residuals (m,) at a minimum, with another fit."""
    outcome = replace(propagation.outcome, fit=fit)
    told, moved = replace(propagation, outcome=outcome), replace(minimum, residuals=residuals)
    return of_residuals(told, moved, fit_of(told, moved))


def _profiles(
    run: Run,
    bent: Curvature | None,
    minimum: Minimum,
    propagation: Propagation,
    limits: Limited | None,
    derived: tuple[DerivedSolution, ...],
) -> Profiles | None:
    """What follows intervals that are not linear."""
    likely, outcome = None, propagation.outcome
    within = bool(derived) and (limits is not None or not bool(run.equations.equality.all()))
    if run.equations.likely or beside_limits(outcome.observed) or within:
        # Loaded by likelihoods and where there are limits, so that the others start at once.
        from mbm.estimation.coverage.likelihood import likelihood

        likely = likelihood(propagation, minimum, limits, derived, run.settings)
    sigma, freedom = outcome.covariance.sigma, outcome.freedoms.of_coordinates(len(outcome.covariance.sigma))
    lock, scaled = run.binder.cache.lock, outcome.freedoms.scaled
    return profiles(bent, sigma, freedom, derived, lock, scaled=scaled, likelihood=likely)


def _others(
    run: Run, end: Reached, minimum: Minimum, outcome: Statistics, *, alone: bool, origin: str
) -> tuple[tuple[Alternative, ...], tuple[Diagnostic, ...]]:
    """The other minima, looked for beside the one where a start was ``alone``, and what is to be said of them."""
    equations = end.equations
    if not end.others and ((equations.linear and not equations.constraints) or not alone):
        return (), ()
    # Loaded by problems that bend only, so that the others start at once.
    from mbm.estimation.search.beside import centre, endless, minima_beside, rivals, unfelt
    from mbm.estimation.search.facing import facing

    likelihood = outcome.log_likelihood if equations.uncounted is not None else None
    scaled = bool(end.noise) and end.factors is None
    about = centre(minimum, outcome.covariance.factor, outcome.fit, likelihood, scaled=scaled)
    others = end.others
    if alone:
        agrees = derived_agreement(run.problem, run.binder, run.kernels)
        others = (*others, *minima_beside(equations, about, run.settings, run.problem, agrees))
    if alone and origin == GIVEN and _places_poses(equations):
        # Likewise.
        from mbm.estimation.search.rival_places import places_beside

        others = places_beside(equations, about, others, run.settings, run.problem)
    others = facing(run.problem, run.tables, equations, minimum, others)
    ends = [each for each in others if unfelt(equations, about, each.minimum).any()]
    others = tuple(each for each in others if each not in ends)
    said = rivals(run.problem, equations, about, others)
    return _as_counted(run, end, others), (*said, *endless(run.problem, equations, about, ends))


def _as_counted(run: Run, end: Reached, others: Iterable[Alternative]) -> tuple[Alternative, ...]:
    """The others with their cost as the solve has its own: one unknown factor counts as 1."""
    return tuple(
        replace(each, cost=cost_of(run.problem, end.equations, each.minimum, end.noise, end.factors)) for each in others
    )


def _places_poses(equations: Assembled) -> bool:
    return any(each.unknown.kind is UnknownKind.POSE and each.members > 1 for each in equations.layout.entries)


def decided(
    equations: Assembled, weighted: Assembled, minimum: Minimum, settings: Settings, informing: Floats | None = None
) -> Observability:
    """The rank decision with the motions that are free, and the common ones among them named.

    ``weighted`` are the ``equations`` that the minimum is of, ``informing`` (m,) what their rows count with (None: 1).
    """
    observed = observed_at(minimum, weighted.coordinates(minimum.point), informing, affine=affine_by_products(weighted))
    observed, about = with_invariances(weighted, minimum, observed, settings)
    bent = curved_directions(weighted, minimum, observed)
    observed = with_gauge(observed, equations.layout, equations.free, about, settings.gauge, bent)
    return with_motions(weighted, minimum, observed)


def _known(equations: Assembled, numbers: Floats, unused: Indices) -> Floats:
    """``numbers`` (N,) with NaN for what has neither a start nor an equation: the place it was put in says nothing.

    ``unused`` are the coordinates that no equation mentions.
    """
    layout = equations.layout
    idle = np.isnan(layout.start)
    if not len(unused) or not bool(idle.any()):
        return numbers
    moved = np.zeros(len(layout.number), dtype=bool)
    moved[unused] = True
    empty = np.zeros(len(numbers), dtype=bool)
    empty[layout.number[moved & (layout.number >= 0)]] = True
    for curved in layout.curved:
        empty[curved.numbers[moved[curved.coordinates].all(axis=1)]] = True
    return np.where(idle & empty, np.nan, numbers)
