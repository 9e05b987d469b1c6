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
from mbm.solution.assembly import Assembled, Binder, EvaluationCache, Group, block_rows, mentioned
from mbm.solution.derived import Propagation
from mbm.solution.layout import free_positions, layout
from mbm.solution.minimise import minimise, solver_for
from mbm.solution.motion import with_motions
from mbm.solution.observability import observability
from mbm.solution.settings import Settings
from mbm.solution.solution import Solution
from mbm.solution.starts import completed
from mbm.solution.statistics import statistics
from mbm.solution.types import (
    Components,
    Floats,
    Indices,
    Minimum,
    Noise,
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
    """The equations of one data set with every start known.

    Raises:
        MbmError: weights that are none, bounds the wrong way round, unknowns without a start.

    """
    places = layout(problem, tables, starts)
    binder = Binder(problem=problem, layout=places, tables=tables, cache=cache)
    groups = binder.equations(kernels)
    free = free_positions(places, mentioned(groups, len(places.start)))
    blank = Assembled(layout=places, groups=groups, numbers=places.start, free=free)
    return blank.freed(free, completed(blank, free)), binder


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
    """Solve one data set."""
    began = time.perf_counter()
    equations, binder = assemble(problem, kernels, tables, starts, cache)
    run = _Run(problem, equations, settings)
    minimum, noise, factors = run.weighted()
    weighted = equations.with_factors(factors)
    observed = observability(minimum.jacobian, minimum.point, minimum.at_bound != 0)
    observed = with_motions(weighted, minimum, observed)
    outcome = statistics(problem, equations, minimum, observed, noise, factors)
    numbers = equations.all_numbers(minimum.point)
    propagation = Propagation(
        problem=problem, kernels=kernels, binder=binder, equations=weighted, numbers=numbers, outcome=outcome
    )
    derived, derived_covariance = propagation.all_derived()
    used = mentioned(equations.groups, len(numbers))
    unused = np.flatnonzero(~used & ~equations.layout.fixed)
    diagnostics = (*_at_start(problem, tables, minimum, equations.groups), *outcome.diagnostics)
    return Solution(
        key=key,
        tables=tables,
        layout=equations.layout,
        groups=equations.groups,
        numbers=numbers,
        free=equations.free,
        minimum=minimum,
        observability=observed,
        covariance=outcome.covariance,
        derived_covariance=derived_covariance,
        derived=derived,
        fit=outcome.fit,
        noise=noise,
        factors=factors,
        sigma_known=outcome.sigma_known,
        unused=unused,
        method=solver_for(equations, settings).name,
        iterations=run.iterations,
        evaluations=run.evaluations,
        seconds=time.perf_counter() - began,
        diagnostics=diagnostics,
    )


class _Run:
    """Minimisations of one data set, again for each round of the variance components; counts the work."""

    def __init__(self, problem: Problem, equations: Assembled, settings: Settings) -> None:
        self.equations = equations
        self.settings = settings
        self._place = problem.span
        self.iterations = 0
        self.evaluations = 0
        self.unknown = [
            i
            for i, block in enumerate(problem.blocks)
            if block.unknown_factor and len(block_rows(equations.groups, i)) > 0
        ]
        self._point = equations.numbers[equations.free]
        self._last: Minimum | None = None

    def weighted(self) -> tuple[Minimum, Mapping[int, Noise], Floats | None]:
        """The minimum with the final weights, and the noise of each block whose factor is unknown."""
        rows = {i: block_rows(self.equations.groups, i) for i in self.unknown}
        stated = sum(len(r) for r in rows.values()) < self.equations.count
        if not self.unknown or (len(self.unknown) == 1 and not stated):
            minimum = self._minimise(None)
            if not self.unknown:
                return minimum, {}, None
            rank = observability(minimum.jacobian, minimum.point, minimum.at_bound != 0).rank
            noise = common_factor(minimum.cost, self.equations.count - rank)
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
        observed = observability(minimum.jacobian, minimum.point, minimum.at_bound != 0)
        return minimum.residuals, redundancy_numbers(minimum.jacobian, observed)

    def _minimise(self, factors: Floats | None) -> Minimum:
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
