"""Whether stated uncertainties are true: many simulated data sets are solved, and the errors compared with the sigmas.
Estimates against the truth: the error of each number in the tangent coordinates that its sigma is stated for.

For each number (tangent coordinate) of each unknown, and each derived one: the ratio of the actual to the stated
standard deviation, and how often the stated 68 % and 95 % intervals hold the true value; for the costs, whether they
follow χ² (Kolmogorov-Smirnov). All with what chance allows for so many runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mbm.api.compiled import CompiledProblem
from mbm.api.problem import Problem
from mbm.compiler import Inputs
from mbm.equations.manifolds import tangent_axes
from mbm.expression.evaluate import evaluate
from mbm.problem.elaborated import Elaborated
from mbm.problem.manifold import Manifold, Piece
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Problem as ElaboratedProblem
from mbm.report.elements import element_names
from mbm.report.options import SimulationSettings, SolveSettings
from mbm.report.simulated import Simulated, Simulator
from mbm.report.types import DerivedValue, Estimate, Floats, Kind, SolveReport
from mbm.rotations import CONJUGATE, hamilton, vector_of_quaternion
from mbm.simulation.rows import Rows
from mbm.simulation.types import Truth
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoordinateErrors:
    """Truth minus estimate and standard deviation (SI) of each named number; sigma 0 or NaN where there is none."""

    names: tuple[str, ...]
    errors: Floats
    sigmas: Floats

    def joined(self, other: CoordinateErrors) -> CoordinateErrors:
        """These, then the others."""
        return CoordinateErrors(
            names=(*self.names, *other.names),
            errors=np.concatenate([self.errors, other.errors]),
            sigmas=np.concatenate([self.sigmas, other.sigmas]),
        )


def estimate_errors(solve: SolveReport, truth: Truth) -> CoordinateErrors:
    """The errors of all estimates of a solve."""
    names: list[str] = []
    errors, sigmas = [], []
    for estimate in solve.estimates:
        name = estimate.quantity.name
        entry = truth.layout.entry(name)
        true = truth.numbers[entry.range].reshape(entry.members, -1)
        found = np.asarray(estimate.value).reshape(entry.members, -1)
        names.extend(element_names(estimate.quantity, estimate.keys))
        errors.append(differences(entry.unknown.manifold, found, true).ravel())
        sigmas.append(_sigmas(estimate, errors[-1].size))
    return CoordinateErrors(names=tuple(names), errors=np.concatenate(errors), sigmas=np.concatenate(sigmas))


def _sigmas(item: Estimate | DerivedValue, size: int) -> Floats:
    if item.sigma is None:
        return np.full(size, np.nan)
    sigma = np.asarray(item.sigma, dtype=np.float64).ravel()
    if isinstance(item, Estimate):
        sigma = np.where(np.ravel(item.fixed), 0.0, sigma)
    return sigma


def differences(manifold: Manifold, found: Floats, true: Floats) -> Floats:
    """The steps (k, tangent) that lead from values (k, size) to the true ones; angles wrapped to (−π, π]."""
    steps = np.empty((len(found), manifold.tangent))
    for (piece, number, coordinate), angle in zip(manifold.spans(), manifold.angles, strict=True):
        a = found[:, number : number + piece.size]
        b = true[:, number : number + piece.size]
        steps[:, coordinate : coordinate + piece.tangent] = _step(piece, a, b, angle)
    return steps


def _step(piece: Piece, found: Floats, true: Floats, angle: bool) -> Floats:
    if piece is Piece.QUATERNION:
        return vector_of_quaternion(hamilton(found * CONJUGATE, true))
    if piece is Piece.SPHERE:
        across = np.stack([np.einsum("ij,ij->i", axis, true) for axis in tangent_axes(found)], axis=1)
        sine = np.linalg.norm(across, axis=1, keepdims=True)
        turn = np.arctan2(sine, np.einsum("ij,ij->i", found, true)[:, None])
        return np.asarray(across * np.where(sine > 0, turn / np.where(sine > 0, sine, 1.0), 1.0))
    if piece is Piece.SCALE:
        return np.asarray(np.log(true / found))
    return wrapped(true - found) if angle else np.asarray(true - found)


def wrapped(angles: Floats) -> Floats:
    """Representatives in (−π, π]."""
    return np.asarray(angles - 2 * np.pi * np.ceil(angles / (2 * np.pi) - 0.5))


def derived_errors(
    problem: ElaboratedProblem, solve: SolveReport, truth: Truth, tables: Mapping[str, Table]
) -> CoordinateErrors:
    """The errors of the derived quantities that are numbers or vectors; their true values use ``tables``."""
    names: list[str] = []
    errors, sigmas = [np.empty(0)], [np.empty(0)]
    for item, derived in zip(solve.derived, problem.derived, strict=True):
        if item.quantity.kind not in (Kind.REAL, Kind.ANGLE, Kind.VECTOR, Kind.ARRAY, Kind.POSITIVE):
            continue
        table = tables[derived.table] if derived.table is not None else None
        true = np.full((1 if table is None else len(table), len(derived.cases[0].values)), np.nan)
        for case in derived.cases:
            positions = rows_of(case.static, table) if table is not None else None
            rows = Rows(table=table, positions=positions, tables=tables, layout=truth.layout, numbers=truth.numbers)
            place = slice(None) if positions is None else positions
            for j, column in enumerate(evaluate(case.values, rows.lookup({}))):
                true[place, j] = column
        error = true.ravel() - np.asarray(item.value).ravel()
        errors.append(wrapped(error) if derived.angle else error)
        names.extend(element_names(item.quantity, item.keys))
        sigmas.append(_sigmas(item, error.size))
    return CoordinateErrors(names=tuple(names), errors=np.concatenate(errors), sigmas=np.concatenate(sigmas))


LEVELS = (0.6827, 0.95)

RUN = "run of a simulation"
"""The column that tells runs apart where many stand in one table: no file's column, and no name in a problem."""

ROWS_AT_ONCE = 500_000
"""Rows of the largest table, of all runs that are solved together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberCoverage:
    """One number over all runs.

    ``ratio`` is the actual over the stated standard deviation, ``ratio_error`` the standard deviation that chance gives
    it; ``covered`` are the shares of runs in which the 68 % and 95 % intervals hold the true value (those of Student's
    t where the noise was estimated); ``bias`` the mean error over its own standard deviation of chance.
    """

    name: str
    runs: int
    ratio: float
    ratio_error: float
    covered: tuple[float, float]
    bias: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """All numbers; ``pooled`` is the root mean square of their ratios, with ``pooled_error`` of chance.

    ``failures`` are runs without a trusted answer, which are left out. ``cost_p`` is the probability of costs as far
    from χ² as these (None: the noise is not stated). ``warned`` is the share of runs with the warning `too-nonlinear`.
    """

    runs: int
    failures: int
    numbers: tuple[NumberCoverage, ...]
    pooled: float
    pooled_error: float
    cost_p: float | None
    warned: float

    def worst_ratio(self) -> float:
        """The ratio that is farthest from 1."""
        return max((n.ratio for n in self.numbers), key=lambda r: abs(math.log(r)) if r > 0 else math.inf)

    def expected_coverage(self, level: int) -> tuple[float, float]:
        """The nominal share of interval ``level`` (0: 68 %, 1: 95 %), and the deviation that chance gives it."""
        share = LEVELS[level]
        return share, math.sqrt(share * (1 - share) / max(self.runs - self.failures, 1))


def coverage(
    problem: Problem,
    *,
    runs: int,
    at: Mapping[str, object] | None = None,
    seed: int = 1,
    data: Mapping[str, object] | None = None,
    noise: Mapping[str, object] | None = None,
    outliers: tuple[float, float] | None = None,
    draw_priors: bool = False,
    start_at_truth: bool = True,
) -> Coverage:
    """Simulate and solve ``runs`` data sets of a problem without ``for-each``.

    Args:
        problem: the problem; its tables are read once.
        runs: how many data sets.
        at: true values as ``Problem.simulate`` takes them; where absent, the starts.
        seed: the noise of run k follows from ``seed`` and k.
        data: tables in place of those that the problem names.
        noise: as ``Problem.simulate``.
        outliers: as ``Problem.simulate``.
        draw_priors: as ``Problem.simulate``; each run then has true values of its own. What has a prior must be drawn
            from it: its sigma says how far the truth varies about the mean, not how far estimates vary about the truth.
        start_at_truth: begin each solve at the true values, so that the uncertainty of the estimates is judged, not the
            search for the minimum.

    Raises:
        MbmError: the problem or the data are wrong.

    """
    tables = dict(data or {})
    simulator = problem.simulator(Inputs(tables=tables, sandbox=problem.sandbox))
    compiled = problem.compile(data=tables)
    settings = SimulationSettings(
        at=dict(at or {}), seed=seed, noise=dict(noise or {}), outliers=outliers, draw_priors=draw_priors
    )
    found: list[_Run] = []
    failures = warned = 0
    for solve, truth in _solves(compiled, simulator, settings, runs, start_at_truth):
        warned += any(d.code.name == "too-nonlinear" for d in solve.diagnostics)
        if not solve.status.trusted:
            failures += 1
            continue
        found.append(_run(simulator.found, solve, truth))
    return _summary(found, runs, failures, warned)


def _solves(
    compiled: CompiledProblem, simulator: Simulator, settings: SimulationSettings, runs: int, start_at_truth: bool
) -> Iterator[tuple[SolveReport, Truth]]:
    """The solves of all runs with the truth of each: many data sets in one table where the problem allows that."""
    seeds = [_run_seed(settings.seed, run) for run in range(runs)]
    size = max((len(table) for table in simulator.found.tables.values()), default=1)
    at_once = max(ROWS_AT_ONCE // max(size, 1), 1)
    for first in range(0, runs, at_once):
        mine = seeds[first : first + at_once]
        made = simulator.repeated(settings, mine, RUN)
        if made is not None:
            asked = SolveSettings(init=made.truth if start_at_truth else None, for_each=(RUN,))
            yield from ((solve, made.truths[0]) for solve in compiled.result(asked, made.data).solves)
            continue
        for seed in mine:
            alone = simulator.measurements(replace(settings, seed=seed))
            yield _solved(compiled, alone, start_at_truth), alone.truths[0]


def _run_seed(seed: int, run: int) -> int:
    """Seeds of different runs never meet those of another seed's runs."""
    return seed * 1_000_003 + run


def _solved(compiled: CompiledProblem, made: Simulated, start_at_truth: bool) -> SolveReport:
    settings = SolveSettings(init=made.truth if start_at_truth else None)
    return compiled.result(settings, made).solves[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """Errors of one run; ``cost`` is None where the noise is not stated, ``estimated`` says whether it is estimated."""

    errors: CoordinateErrors
    cost: float | None
    dof: int
    estimated: bool


def _run(found: Elaborated, solve: SolveReport, truth: Truth) -> _Run:
    errors = estimate_errors(solve, truth)
    joined = errors.joined(derived_errors(found.problem, solve, truth, found.tables))
    stated = solve.chi2_p is not None
    dof = solve.dof or 0
    estimated = not stated and any(factor is not None for factor in solve.noise.values())
    return _Run(
        errors=joined,
        cost=solve.cost if stated else None,
        dof=dof,
        estimated=estimated,
    )


def _quantiles(found: list[_Run]) -> Floats:
    """Half widths (runs, 2) of the 68 % and 95 % intervals in deviations: of t where the noise was estimated."""
    from scipy.stats import norm, t

    shares = np.array([(1 + level) / 2 for level in LEVELS])
    freedom = np.array([run.dof if run.estimated and run.dof > 0 else 0 for run in found], dtype=np.int64)
    kinds, kind = np.unique(freedom, return_inverse=True)
    widths = [t.ppf(shares, dof) if dof else norm.ppf(shares) for dof in kinds.tolist()]
    return np.asarray(np.reshape(widths, (-1, 2))[kind])


def _summary(found: list[_Run], runs: int, failures: int, warned: int) -> Coverage:
    names = found[0].errors.names if found else ()
    errors = np.array([run.errors.errors for run in found]).reshape(len(found), len(names))
    sigmas = np.array([run.errors.sigmas for run in found]).reshape(len(found), len(names))
    widths = _quantiles(found)
    numbers = tuple(_number(name, errors[:, i], sigmas[:, i], widths) for i, name in enumerate(names))
    pooled, pooled_error = _pooled(errors, sigmas)
    return Coverage(
        runs=runs,
        failures=failures,
        numbers=tuple(n for n in numbers if n is not None),
        pooled=pooled,
        pooled_error=pooled_error,
        cost_p=_cost_probability(found),
        warned=warned / runs if runs else 0.0,
    )


def _pooled(errors: Floats, sigmas: Floats) -> tuple[float, float]:
    """The root mean square of the ratios of all numbers, and its standard deviation of chance."""
    known = np.isfinite(errors) & np.isfinite(sigmas) & (sigmas > 0)
    usable = known.sum(axis=0) > 1
    if not bool(usable.any()):
        return math.nan, math.nan
    known, errors, sigmas = known[:, usable], errors[:, usable], sigmas[:, usable]
    stated = np.sum(np.where(known, sigmas, 0.0) ** 2, axis=0) / known.sum(axis=0)
    shares = np.where(known, errors, 0.0) ** 2 / stated / (known.mean(axis=0) * known.shape[1])
    runs = shares.sum(axis=1)
    pooled = math.sqrt(float(runs.mean()))
    spread = float(runs.std(ddof=1)) / math.sqrt(len(runs))
    return pooled, spread / (2 * pooled) if pooled > 0 else math.nan


def _number(name: str, errors: Floats, sigmas: Floats, widths: Floats) -> NumberCoverage | None:
    usable = np.isfinite(errors) & np.isfinite(sigmas) & (sigmas > 0)
    if int(usable.sum()) < 2:
        return None
    error, sigma, width = errors[usable], sigmas[usable], widths[usable]
    count = len(error)
    square = float(np.mean(error**2))
    ratio = math.sqrt(square / float(np.mean(sigma**2)))
    kurtosis = float(np.mean(error**4)) / square**2 if square > 0 else 3.0
    inside = np.abs(error)[:, None] <= sigma[:, None] * width
    deviation = float(np.std(error, ddof=1))
    return NumberCoverage(
        name=name,
        runs=count,
        ratio=ratio,
        ratio_error=ratio * math.sqrt(max(kurtosis - 1, 0.0) / (4 * count)),
        covered=(float(inside[:, 0].mean()), float(inside[:, 1].mean())),
        bias=float(np.mean(error)) / (deviation / math.sqrt(count)) if deviation > 0 else 0.0,
    )


def _cost_probability(found: list[_Run]) -> float | None:
    """The probability, if costs follow χ², of a distribution as far from it."""
    from scipy.stats import chi2, kstest

    tested = np.array([(run.cost, run.dof) for run in found if run.cost is not None and run.dof > 0]).reshape(-1, 2)
    shares = chi2.cdf(tested[:, 0], tested[:, 1])
    return float(kstest(shares, "uniform").pvalue) if len(shares) > 1 else None
