"""Solution → SolveReport: numbers get their names and units, statuses their sentences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.expression.dimension import Dimension
from mbm.expression.units import Unit
from mbm.problem.types import BlockRole, Derived, Problem, Unknown, UnknownKind
from mbm.report.freedom import free_directions
from mbm.report.pictures import plot_data
from mbm.report.residuals import prior_reports, residual_rows, residual_summaries
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Floats,
    Kind,
    Observability,
    Quantity,
    SolveReport,
    SolveStatus,
)
from mbm.solution.layout import Entry
from mbm.solution.solution import DerivedSolution, Failure, Solution
from mbm.solution.types import NoiseState

COVARIANCE_LIMIT = 300
"""Scalars whose covariance matrix is kept unless it is asked for."""

_NO_NOISE = "the noise is unknown, and without redundancy the residuals cannot tell it"
_FREE = "the data do not determine it"
_UNUSED = "no equation mentions it"


def solve_report(problem: Problem, solution: Solution, *, covariance_full: bool) -> SolveReport:
    """One solve as a report."""
    status, message = _status(solution)
    return SolveReport(
        status=status,
        message=message,
        key=dict(solution.key),
        method=solution.method,
        iterations=solution.iterations,
        evaluations=solution.evaluations,
        seconds=solution.seconds,
        cost=_finite(solution.fit.cost),
        dof=solution.fit.dof,
        sigma0=solution.fit.sigma0,
        chi2_p=solution.fit.chi2_p,
        reasons=_reasons(solution),
        estimates=tuple(_estimate(problem, solution, entry) for entry in solution.layout.entries),
        covariance=_covariance(problem, solution, full=covariance_full),
        derived=tuple(_derived(problem, solution, each) for each in solution.derived),
        derived_covariance=_derived_covariance(problem, solution),
        observability=_observability(solution),
        noise=_noise(problem, solution),
        residual_summaries=residual_summaries(problem, solution),
        residual_rows=lambda: residual_rows(problem, solution),
        plot_data=lambda: plot_data(problem, solution),
        priors=prior_reports(problem, solution),
        diagnostics=solution.diagnostics,
    )


def failure_report(failure: Failure) -> SolveReport:
    """A solve of several that could not be set up: no estimates, and the reason."""
    first = failure.diagnostics[0]
    return SolveReport(
        status=SolveStatus.NOT_CONVERGED,
        message=f"nothing was solved: {first.message}",
        key=dict(failure.key),
        reasons=dict.fromkeys(("cost", "dof", "sigma0", "chi2_p"), "nothing was solved"),
        diagnostics=failure.diagnostics,
    )


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _status(solution: Solution) -> tuple[SolveStatus, str]:
    reason = solution.minimum.reason
    if not reason.converged:
        return SolveStatus.NOT_CONVERGED, reason.sentence
    if not solution.observability.observable:
        return SolveStatus.UNOBSERVABLE, SolveStatus.UNOBSERVABLE.sentence
    return SolveStatus.CONVERGED, reason.sentence


def _reasons(solution: Solution) -> Mapping[str, str]:
    reasons = {}
    if solution.fit.dof <= 0:
        reasons["sigma0"] = reasons["chi2_p"] = "there are no degrees of freedom"
    elif solution.noise:
        reasons["chi2_p"] = "the noise is estimated from the residuals"
    if not np.isfinite(solution.fit.cost):
        reasons["cost"] = "an equation has no finite value"
    return reasons


def quantity_of(problem: Problem, unknown: Unknown) -> Quantity:
    """How an unknown is shown."""
    unit, factor = _unit(unknown.unit, unknown.kind is UnknownKind.ANGLE, problem, unknown.name, unknown.size)
    return Quantity(
        name=unknown.name,
        kind=Kind(unknown.kind.value),
        shape=unknown.shape,
        unit=unit,
        factor=factor,
        doc=unknown.doc or None,
    )


UNIT_ONE = "1"
"""`:unit 1` says of an unknown that it is a pure number; nobody wants to read it beside the value."""


def _unit(stated: Unit | None, angle: bool, problem: Problem, name: str, size: int) -> tuple[str | None, float]:
    if stated is not None:
        return (None if stated.symbol == UNIT_ONE else stated.symbol), stated.factor
    if angle:
        return "rad", 1.0
    found: set[Dimension | None] = {problem.dimensions.get((name, i)) for i in range(size)}
    dimension = next(iter(found)) if len(found) == 1 else None
    return (dimension.symbol() or None, 1.0) if dimension is not None else (None, 1.0)


def _estimate(problem: Problem, solution: Solution, entry: Entry) -> Estimate:
    unknown = entry.unknown
    shape = unknown.shape if entry.keys is None else (entry.members, *unknown.shape)
    numbers = solution.numbers[entry.range].copy()
    if unknown.kind is UnknownKind.ANGLE:
        numbers = _wrapped(numbers)
    place = {int(p): i for i, p in enumerate(solution.free)}
    sigma = np.full(entry.count, np.nan)
    bound = np.zeros(entry.count, dtype=bool)
    for i in range(entry.count):
        j = place.get(entry.offset + i)
        if j is not None:
            sigma[i] = solution.covariance.sigma[j] if solution.sigma_known else np.nan
            bound[i] = solution.minimum.at_bound[j] != 0
    fixed = solution.layout.fixed[entry.range].reshape(shape)
    undefined = np.isnan(sigma) & ~fixed.reshape(-1)
    unused = np.isin(np.arange(entry.offset, entry.offset + entry.count), solution.unused)
    reason = None
    if bool(undefined.any()):
        reason = _NO_NOISE if not solution.sigma_known else _UNUSED if bool((unused | ~undefined).all()) else _FREE
    return Estimate(
        quantity=quantity_of(problem, unknown),
        value=numbers.reshape(shape),
        sigma=sigma.reshape(shape),
        fixed=fixed,
        keys=entry.keys,
        per=_per(unknown),
        at_bound=bound.reshape(shape) if bool(bound.any()) else None,
        reason=reason,
    )


def _per(unknown: Unknown) -> str | None:
    return unknown.family.rows if unknown.family is not None else None


def _wrapped(angles: Floats) -> Floats:
    """Representatives in (−π, π]."""
    return np.asarray(angles - 2 * np.pi * np.ceil(angles / (2 * np.pi) - 0.5))


def _covariance(problem: Problem, solution: Solution, *, full: bool) -> CovarianceMatrix:
    factors = np.empty(len(solution.numbers))
    for entry in solution.layout.entries:
        factors[entry.range] = quantity_of(problem, entry.unknown).factor
    names = tuple(solution.layout.name(int(p)) for p in solution.free)
    chosen = tuple(float(f) for f in factors[solution.free])
    if len(names) > COVARIANCE_LIMIT and not full:
        reason = f"{len(names)} scalars; ask for it with `--covariance full`"
        return CovarianceMatrix(names=names, factors=chosen, matrix=None, reason=reason)
    matrix = solution.covariance.matrix if solution.sigma_known else np.full((len(names),) * 2, np.nan)
    unknown = None if solution.sigma_known else _NO_NOISE
    return CovarianceMatrix(names=names, factors=chosen, matrix=matrix, reason=unknown)


def _derived_quantity(problem: Problem, derived: Derived) -> Quantity:
    size = len(derived.cases[0].values) if derived.cases else 1
    unit, factor = _unit(derived.unit, derived.angle, problem, derived.name, size)
    kind = Kind.ANGLE if derived.angle and not derived.shape else Kind.VECTOR if derived.shape else Kind.REAL
    return Quantity(name=derived.name, kind=kind, shape=derived.shape, unit=unit, factor=factor)


def _derived(problem: Problem, solution: Solution, found: DerivedSolution) -> DerivedValue:
    derived = problem.derived[found.owner]
    shape = derived.shape if derived.table is None else (len(found.values), *derived.shape)
    sigma = found.sigma if solution.sigma_known else np.full_like(found.sigma, np.nan)
    values = _wrapped(found.values) if derived.angle and not derived.shape else found.values
    reason = None
    if bool(np.isnan(sigma).any()):
        reason = _FREE if solution.sigma_known else _NO_NOISE
    keys = None
    if derived.table is not None:
        table = solution.tables[derived.table]
        keys = tuple(table.keys()) if table.key is not None else tuple(float(r) for r in table.rows)
    return DerivedValue(
        quantity=_derived_quantity(problem, derived),
        value=values.reshape(shape),
        sigma=sigma.reshape(shape),
        keys=keys,
        over=derived.table,
        reason=reason,
    )


def _derived_covariance(problem: Problem, solution: Solution) -> CovarianceMatrix | None:
    if not solution.derived:
        return None
    names: list[str] = []
    factors: list[float] = []
    for found in solution.derived:
        derived = problem.derived[found.owner]
        quantity = _derived_quantity(problem, derived)
        value = _derived(problem, solution, found)
        for key in value.keys if value.keys is not None else (None,):
            names.extend(_element_names(quantity, key))
        factors.extend([quantity.factor] * (len(names) - len(factors)))
    matrix = solution.derived_covariance
    if matrix is None:
        return CovarianceMatrix(
            names=tuple(names), factors=tuple(factors), matrix=None, reason=f"{len(names)} scalars are too many"
        )
    return CovarianceMatrix(names=tuple(names), factors=tuple(factors), matrix=matrix)


def _element_names(quantity: Quantity, key: str | float | None) -> list[str]:
    base = quantity.name
    if key is not None:
        base += f'["{key}"]' if isinstance(key, str) else f"[{key:g}]"
    if not quantity.shape:
        return [base]
    if len(quantity.shape) == 1:
        return [f"{base}[{i + 1}]" for i in range(quantity.shape[0])]
    return [f"{base}[{i + 1},{j + 1}]" for i in range(quantity.shape[0]) for j in range(quantity.shape[1])]


def _observability(solution: Solution) -> Observability:
    found = solution.observability
    return Observability(
        rank=found.rank,
        dimension=found.dimension,
        condition=float(found.condition),
        unobservable=free_directions(solution),
        unused=_unused(solution),
    )


def _unused(solution: Solution) -> tuple[str, ...]:
    """Unknowns (or members of families) that no equation mentions, each named once."""
    unused = set(solution.unused.tolist())
    names = []
    for entry in solution.layout.entries:
        size = entry.unknown.size
        for member in range(entry.members):
            places = range(entry.offset + member * size, entry.offset + (member + 1) * size)
            if all(p in unused for p in places):
                name = solution.layout.name(places[0])
                names.append(name[: name.rindex("[")] if entry.unknown.shape else name)
    return tuple(names)


def _noise(problem: Problem, solution: Solution) -> Mapping[str, float | None]:
    found: dict[str, float | None] = {}
    for i, block in enumerate(problem.blocks):
        if block.role is BlockRole.OBSERVATION:
            noise = solution.noise.get(i)
            estimated = noise is not None and noise.state is NoiseState.ESTIMATED
            found[block.name] = noise.factor if noise is not None and estimated else None
    return found
