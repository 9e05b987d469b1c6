"""One data set → one solution: assemble, find starts, minimise, decide the rank, propagate the uncertainty."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mbm.kernels.types import KernelSet
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.solution import faults
from mbm.solution.assembly import Assembled, Binder, EvaluationCache, Group, block_rows, mentioned
from mbm.solution.covariance import covariance, propagate
from mbm.solution.layout import free_positions, layout
from mbm.solution.minimise import minimise, solver_for
from mbm.solution.motion import with_motions
from mbm.solution.observability import observability
from mbm.solution.settings import Settings
from mbm.solution.solution import DerivedSolution, Solution
from mbm.solution.starts import completed
from mbm.solution.types import (
    Components,
    Covariance,
    Fit,
    Floats,
    Indices,
    Minimum,
    Noise,
    NoiseState,
    Observability,
)
from mbm.solution.variance import common_factor, fit_statistics, redundancy_numbers, variance_components
from mbm.text.types import Diagnostic

REWEIGHTED_ITERATIONS = 500
"""Iterations that the rounds of the variance components may take together; those left over get one each."""

GRADIENT_LIMIT = 20_000_000
"""Numbers in the gradients of derived quantities that are kept for their covariance."""

COVARIANCE_LIMIT = 2_000
"""Derived scalars whose full covariance is made; beyond, the marginal sigmas stay."""


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
    outcome = _statistics(problem, equations, minimum, observed, noise, factors)
    numbers = equations.all_numbers(minimum.point)
    derived, derived_covariance = _derived(problem, kernels, binder, weighted, numbers, observed, outcome.covariance)
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
        minimum = minimise(self.equations.with_factors(factors), self._point, settings)
        self.iterations += minimum.iterations
        self.evaluations += minimum.evaluations
        if np.isfinite(minimum.cost):
            self._point = minimum.point
        return minimum


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Statistics:
    covariance: Covariance
    fit: Fit
    sigma_known: bool
    diagnostics: tuple[Diagnostic, ...]


def _statistics(
    problem: Problem,
    equations: Assembled,
    minimum: Minimum,
    observed: Observability,
    noise: Mapping[int, Noise],
    factors: Floats | None,
) -> _Statistics:
    """Cost, degrees of freedom and covariance; a single unknown factor counts as σ = 1 in the cost (CONTRACT §2)."""
    cost, variance, known = minimum.cost, 1.0, True
    if len(noise) == 1 and factors is not None:
        residuals = minimum.residuals.copy()
        rows = block_rows(equations.groups, next(iter(noise)))
        residuals[rows] *= factors[rows]
        cost = float(residuals @ residuals)
    elif len(noise) == 1:
        only = next(iter(noise.values()))
        variance = only.factor**2 if only.state is NoiseState.ESTIMATED else 0.0
        known = only.state is not NoiseState.NO_REDUNDANCY
    diagnostics = tuple(
        faults.noise_not_estimated(problem.blocks[i].span, problem.blocks[i].name, n.state.value)
        for i, n in noise.items()
        if n.state is not NoiseState.ESTIMATED
    )
    return _Statistics(
        covariance=covariance(observed, variance),
        fit=fit_statistics(cost, equations.count, observed.rank, noise_stated=not noise),
        sigma_known=known,
        diagnostics=diagnostics,
    )


def _derived(
    problem: Problem,
    kernels: KernelSet,
    binder: Binder,
    equations: Assembled,
    numbers: Floats,
    observed: Observability,
    estimated: Covariance,
) -> tuple[tuple[DerivedSolution, ...], Floats | None]:
    columns = np.full(len(numbers), -1, dtype=np.int64)
    columns[equations.free] = np.arange(equations.dimension)
    found = []
    gradients: list[Floats] = []
    for owner in range(len(problem.derived)):
        one = _one_derived(owner, problem, kernels, binder, numbers, columns, equations.dimension, observed, estimated)
        found.append(one)
        if one.gradient is not None:
            gradients.append(one.gradient)
    total = sum(len(g) for g in gradients)
    if not gradients or len(gradients) < len(found) or total > COVARIANCE_LIMIT:
        return tuple(found), None
    return tuple(found), propagate(np.vstack(gradients), observed, estimated).matrix


def _one_derived(
    owner: int,
    problem: Problem,
    kernels: KernelSet,
    binder: Binder,
    numbers: Floats,
    columns: Indices,
    width: int,
    observed: Observability,
    estimated: Covariance,
) -> DerivedSolution:
    groups = binder.derived(kernels, owner)
    derived = problem.derived[owner]
    rows = len(binder.tables[derived.table]) if derived.table is not None else 1
    size = len(derived.cases[0].values) if derived.cases else 0
    values, sigma = np.full((rows, size), np.nan), np.full((rows, size), np.nan)
    keep = rows * size * width <= GRADIENT_LIMIT
    gradient = np.zeros((rows, size, width)) if keep else None
    for group in groups:
        positions = group.positions if group.positions is not None else np.arange(1)
        values[positions] = group.values(numbers)
        part = group.dense_jacobian(numbers, columns, width)
        flat = part.reshape(-1, width)
        for start in range(0, len(flat), COVARIANCE_LIMIT):
            stop = start + COVARIANCE_LIMIT
            chunk = propagate(flat[start:stop], observed, estimated).sigma
            places = np.arange(start, min(stop, len(flat)))
            sigma[positions[places // size], places % size] = chunk
        if gradient is not None:
            gradient[positions] = part
    return DerivedSolution(
        owner=owner,
        positions=np.arange(rows),
        values=values,
        sigma=sigma,
        gradient=gradient.reshape(-1, width) if gradient is not None else None,
    )


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
