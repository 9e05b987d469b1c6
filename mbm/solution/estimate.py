"""One data set → one solution: assemble, find starts, minimise, decide the rank, propagate the uncertainty."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.solution import faults
from mbm.solution.assembly import Assembled, blank
from mbm.solution.binding import Binder, EvaluationCache, Group, mentioned
from mbm.solution.derived import Propagation
from mbm.solution.layout import layout
from mbm.solution.minimise import minimise, solver_for
from mbm.solution.motion import with_motions
from mbm.solution.observability import observed_at
from mbm.solution.search import Found, search
from mbm.solution.settings import Settings
from mbm.solution.solution import Solution
from mbm.solution.starting import beginnings
from mbm.solution.statistics import statistics
from mbm.solution.types import (
    Components,
    Floats,
    Indices,
    Minimum,
    Noise,
    Observability,
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
    places = layout(problem, tables, starts)
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
) -> Solution:
    """Solve one data set.

    Raises:
        MbmError: it cannot be set up, or no start is known and none can be found.

    """
    began = time.perf_counter()
    equations, binder = assemble(problem, kernels, tables, starts, cache)
    found = search(equations, beginnings(equations, settings), settings, problem.span)
    run = _Run(problem, equations, settings, found)
    minimum, noise, factors = run.weighted()
    weighted = equations.with_factors(factors)
    observed = observed_at(minimum, weighted.coordinates(minimum.point))
    observed = with_motions(weighted, minimum, observed)
    outcome = statistics(problem, equations, minimum, observed, noise, factors)
    propagation = Propagation(
        problem=problem, kernels=kernels, binder=binder, equations=weighted, numbers=minimum.point, outcome=outcome
    )
    derived, derived_covariance = propagation.all_derived()
    places = equations.layout
    used = mentioned((*equations.groups, *equations.constraints), len(places.number))
    diagnostics = (*_at_start(problem, tables, minimum, equations.groups), *outcome.diagnostics)
    return Solution(
        key=key,
        tables=tables,
        layout=places,
        groups=equations.groups,
        numbers=minimum.point,
        free=equations.free,
        minimum=minimum,
        residuals=weighted.everything().plain_residuals(minimum.point),
        weights=None,
        alternatives=found.alternatives,
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
        method=solver_for(equations, settings).name,
        iterations=run.iterations,
        evaluations=run.evaluations,
        seconds=time.perf_counter() - began,
        diagnostics=diagnostics,
    )


class _Run:
    """Minimisations of one data set, again for each round of the variance components; counts the work.

    ``found`` is the minimum with the noise as stated.
    """

    def __init__(self, problem: Problem, equations: Assembled, settings: Settings, found: Found) -> None:
        self.equations = equations
        self.settings = settings
        self._place = problem.span
        self.iterations = found.iterations
        self.evaluations = found.evaluations
        self._first: Minimum | None = found.minimum
        self.unknown = [
            i for i, block in enumerate(problem.blocks) if block.unknown_factor and len(equations.block_rows(i)) > 0
        ]
        self._point = found.minimum.point if np.isfinite(found.minimum.cost) else equations.numbers

    def weighted(self) -> tuple[Minimum, Mapping[int, Noise], Floats | None]:
        """The minimum with the final weights, and the noise of each block whose factor is unknown."""
        rows = {i: self.equations.block_rows(i) for i in self.unknown}
        stated = sum(len(r) for r in rows.values()) < self.equations.count
        if not self.unknown or (len(self.unknown) == 1 and not stated):
            minimum = self._minimise(None)
            if not self.unknown:
                return minimum, {}, None
            observed = self._observed(minimum)
            noise = common_factor(minimum.cost, self.equations.count + observed.equalities - observed.rank)
            return minimum, {self.unknown[0]: noise}, None
        groups = [rows[i] for i in self.unknown]
        components = variance_components(lambda factors: self._reweighted(factors, groups), groups)
        factors = self._row_factors(components, groups)
        return self._minimise(factors), dict(zip(self.unknown, components.noises, strict=True)), factors

    def _row_factors(self, components: Components, groups: list[Indices]) -> Floats:
        factors = np.ones(self.equations.count)
        for noise, rows in zip(components.noises, groups, strict=True):
            factors[rows] = noise.factor
        return factors

    def _reweighted(self, factors: Floats, groups: list[Indices]) -> tuple[Floats, Floats]:
        by_row = np.ones(self.equations.count)
        for factor, rows in zip(factors, groups, strict=True):
            by_row[rows] = factor
        minimum = self._minimise(by_row)
        observed = self._observed(minimum)
        return minimum.residuals, redundancy_numbers(minimum.jacobian, observed)

    def _observed(self, minimum: Minimum) -> Observability:
        return observed_at(minimum, self.equations.coordinates(minimum.point))

    def _minimise(self, factors: Floats | None) -> Minimum:
        if self._first is not None and (factors is None or bool((factors == 1.0).all())):
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


def _at_start(
    problem: Problem, tables: Mapping[str, Table], minimum: Minimum, groups: tuple[Group, ...]
) -> tuple[Diagnostic, ...]:
    """Where an equation has no finite value at the start: its place in the text and in the data."""
    if minimum.bad_row is None:
        return ()
    for group in groups:
        if group.first <= minimum.bad_row < group.first + group.count:
            row = (minimum.bad_row - group.first) // group.kernel.outputs
            table = problem.blocks[group.kernel.owner].table
            place = None
            if table is not None and group.positions is not None:
                place = tables[table].place(int(group.positions[row]))
            return (faults.not_finite_at_start(group.kernel.span, group.kernel.name, place),)
    return ()
