"""One data set → one solution: assemble, find starts, minimise, decide the rank, propagate the uncertainty."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.solution import faults
from mbm.solution.agreement import derived_agreement
from mbm.solution.assembly import Assembled, blank, block_rows
from mbm.solution.binding import Binder, EvaluationCache, mentioned
from mbm.solution.challenge import challenged
from mbm.solution.derived import Propagation
from mbm.solution.gauge import with_gauge
from mbm.solution.minimise import minimise, solver_name
from mbm.solution.motion import with_motions
from mbm.solution.multistart import starting_points
from mbm.solution.observability import observed_at
from mbm.solution.plausibility import doubts
from mbm.solution.rivals import rivals
from mbm.solution.robust.preparation import Prepared, outliers, prepared, robust_cost, unit_weights
from mbm.solution.search import Found, reweighted, search
from mbm.solution.settings import Settings
from mbm.solution.solution import Solution
from mbm.solution.stationary import without_stationary
from mbm.solution.statistics import statistics
from mbm.solution.types import (
    Floats,
    Minimum,
    Noise,
    Observability,
    Reason,
)
from mbm.solution.variance import common_factor, redundancy_numbers, variance_components
from mbm.text.types import Diagnostic

REWEIGHTED_ITERATIONS = 500
"""Iterations that the rounds of the variance components may take together; those left over get one each."""


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

    Raises:
        MbmError: it cannot be set up, or no start is known and none can be found.

    """
    began = time.perf_counter()
    equations, binder = assemble(problem, kernels, tables, starts, cache)
    robust = prepared(problem, equations, settings, starting_points(equations, settings, last))
    equations = robust.equations.with_factors(robust.factors)
    found = search(equations, robust.starts, settings, problem, derived_agreement(problem, binder, kernels))
    found = challenged(equations, settings, found, problem, cache, many=bool(key))
    run = _Run(problem, robust, settings, found)
    minimum, noise, factors = run.weighted()
    weighted = equations.with_factors(factors)
    alternatives = found.alternatives
    if factors is not robust.factors and alternatives:
        alternatives = reweighted(weighted, alternatives, settings, problem)
    observed = observed_at(minimum, weighted.coordinates(minimum.point), robust.informing(minimum.jacobian))
    observed = with_gauge(observed, equations.layout, equations.free, minimum.point, settings.gauge)
    observed = with_motions(weighted, minimum, observed)
    outcome = statistics(problem, equations, minimum, observed, noise, factors)
    propagation = Propagation(
        problem=problem, kernels=kernels, binder=binder, equations=weighted, numbers=minimum.point, outcome=outcome
    )
    derived, derived_covariance = propagation.all_derived()
    places = equations.layout
    used = mentioned((*equations.groups, *equations.constraints), len(places.number))
    whole = weighted.everything().plain_residuals(minimum.point)
    diagnostics = (
        *robust.diagnostics,
        *_at_start(problem, tables, minimum, equations),
        *outcome.diagnostics,
        *rivals(problem, minimum, alternatives, outcome.fit, noise),
        *doubts(propagation, minimum, derived),
    )
    return Solution(
        key=key,
        tables=tables,
        layout=places,
        groups=equations.groups,
        constraints=equations.constraints,
        numbers=minimum.point,
        free=equations.free,
        minimum=minimum if robust.agreed else replace(minimum, reason=Reason.NO_AGREEMENT),
        residuals=whole,
        weights=unit_weights(weighted, whole),
        outliers=outliers(weighted, whole),
        robust_cost=robust_cost(weighted, minimum),
        alternatives=alternatives,
        tally=found.tally,
        origin=found.origin,
        observability=observed,
        covariance=outcome.covariance,
        derived_covariance=derived_covariance,
        derived=derived,
        fit=outcome.fit,
        noise=noise,
        factors=factors,
        sigma_known=outcome.sigma_known,
        unused=np.flatnonzero(~used & ~places.fixed),
        corrections=() if weighted.implicit is None else weighted.implicit.corrected(minimum.point),
        method=solver_name(equations, settings),
        iterations=run.iterations,
        evaluations=run.evaluations,
        seconds=time.perf_counter() - began,
        diagnostics=diagnostics,
    )


class _Run:
    """Minimisations of one data set, again for each round of the variance components; counts the work.

    ``found`` is the minimum with the noise as stated.
    """

    def __init__(self, problem: Problem, robust: Prepared, settings: Settings, found: Found) -> None:
        self.equations = robust.equations
        self._robust = robust
        self.settings = settings
        self._place = problem.span
        self.iterations = found.iterations
        self.evaluations = found.evaluations
        self._first: Minimum | None = found.minimum
        self.unknown = [
            i
            for i, block in enumerate(problem.blocks)
            if block.unknown_factor and i not in robust.noise and len(self.equations.block_rows(i)) > 0
        ]
        self._point = found.minimum.point if np.isfinite(found.minimum.cost) else self.equations.numbers

    def weighted(self) -> tuple[Minimum, Mapping[int, Noise], Floats | None]:
        """The minimum with the final weights, and the noise of each block whose factor is unknown."""
        robust = self._robust
        rows = {i: self.equations.block_rows(i) for i in self.unknown}
        stated = sum(len(r) for r in rows.values()) < self.equations.count
        if not self.unknown:
            return self._minimise(robust.factors), robust.noise, robust.factors
        if len(self.unknown) == 1 and not stated:
            minimum = self._minimise(None)
            observed = self._observed(minimum)
            cost = float(np.square(robust.scattering(minimum.residuals)).sum())
            noise = common_factor(cost, self.equations.count + observed.equalities - observed.rank)
            return minimum, {self.unknown[0]: noise}, None
        groups = [rows[i] for i in self.unknown]
        components = variance_components(self._reweighted, groups)
        factors = self._row_factors([noise.factor for noise in components.noises])
        noises = {**robust.noise, **dict(zip(self.unknown, components.noises, strict=True))}
        return self._minimise(factors), noises, factors

    def _row_factors(self, values: Sequence[float] | Floats) -> Floats:
        """Factors by residual (all of them) from those of the unknown blocks."""
        by_row = np.ones(self.equations.whole) if self._robust.factors is None else self._robust.factors.copy()
        for number, value in zip(self.unknown, values, strict=True):
            by_row[block_rows(self.equations.groups, number)] = value
        return by_row

    def _reweighted(self, factors: Floats) -> tuple[Floats, Floats]:
        minimum = self._minimise(self._row_factors(factors))
        observed = self._observed(minimum)
        return self._robust.scattering(minimum.residuals), redundancy_numbers(
            minimum.jacobian, observed, minimum.blocks
        )

    def _observed(self, minimum: Minimum) -> Observability:
        return observed_at(minimum, self.equations.coordinates(minimum.point))

    def _minimise(self, factors: Floats | None) -> Minimum:
        minimum = self._minimum(factors)
        spread = np.sqrt(minimum.cost / max(self.equations.count, 1)) if self.unknown else 1.0
        return without_stationary(self.equations.with_factors(factors), minimum, float(spread))

    def _minimum(self, factors: Floats | None) -> Minimum:
        if self._first is not None and _same(factors, self._robust.factors):
            first, self._first = self._first, None
            return first
        limit = self.settings.max_iterations
        if self.iterations:
            limit = min(limit, max(REWEIGHTED_ITERATIONS - self.iterations, 1))
        settings = replace(self.settings, max_iterations=limit)
        minimum = minimise(self.equations.with_factors(factors), self._point, settings, self._place)
        self.iterations += minimum.iterations
        self.evaluations += minimum.evaluations
        if np.isfinite(minimum.cost):
            self._point = minimum.point
        return minimum


def _same(first: Floats | None, second: Floats | None) -> bool:
    """Whether two sets of noise factors are equal; None: all 1."""
    if first is None or second is None:
        other = second if first is None else first
        return other is None or bool((other == 1.0).all())
    return bool((first == second).all())


def _at_start(
    problem: Problem, tables: Mapping[str, Table], minimum: Minimum, equations: Assembled
) -> tuple[Diagnostic, ...]:
    """Where an equation has no finite value at the start: its place in the text and in the data."""
    if minimum.bad_row is None:
        return ()
    groups, bad = equations.groups, minimum.bad_row
    if bad >= equations.count:
        groups, bad = equations.constraints, bad - equations.count
    for group in groups:
        if group.first <= bad < group.first + group.count:
            row = (bad - group.first) // group.kernel.outputs
            table = problem.blocks[group.kernel.owner].table
            place = None
            if table is not None and group.positions is not None:
                place = tables[table].place(int(group.positions[row]))
            return (faults.not_finite_at_start(group.kernel.span, group.kernel.name, place),)
    return ()
