"""Readings that are no plain numbers: in steps that are coarse beside their scatter, or all the same at a limit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import comb, erfc, exp, pi, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum
from mbm.estimation.minimise.native.tails import solver_code
from mbm.estimation.native.code import AnyCode
from mbm.estimation.trust import faults
from mbm.estimation.trust.uneven import NO_DIFFERENCE, told_apart
from mbm.expression.nodes import Column
from mbm.expression.rows import RowChoice
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import Diagnostic

ALIKE, OPPOSED = 1.70, 2.58
"""Standard deviations from the mean beyond which successive residuals are taken to be correlated: positively, which
makes standard deviations too small, by chance in 4.5 % of all solves; negatively, in 0.5 %."""


def in_order(problem: Problem, owner: int) -> bool:
    """Whether the rows of a block stand in an order."""
    block = problem.blocks[owner]
    return block.role is BlockRole.OBSERVATION and block.table is not None and problem.sequence is None


def directions(equations: Assembled, minimum: Minimum, estimated: Covariance) -> Floats:
    """The orthonormal directions (m, k) in which residuals follow the estimates; NaN where one has no number."""
    image = minimum.jacobian @ estimated.factor
    if not equations.lossy and estimated.variance > 0.0:  # the factor is that of the inverse normal equations
        return np.asarray(image / np.sqrt(estimated.variance))
    return np.linalg.qr(image)[0] if bool(np.isfinite(image).all()) else np.full(image.shape, np.nan)


def lag_scores(code: AnyCode, residuals: Floats, basis: Floats, following: Indices) -> tuple[Floats, Floats, Floats]:
    """r, its mean and its standard deviation (…,); the latter NaN where too few rows follow one another.

    ``residuals`` (…, m); ``basis`` (…, m, k) orthonormal, the directions in which they follow the estimates;
    ``following`` (…, m) is the place of the residual after each, -1 for none. ``code`` is the solver's.
    """
    m, k = basis.shape[-2:]
    shape = residuals.shape[:-1]
    count = residuals.size // m
    scores, scratch = np.empty((*shape, 3)), np.empty(2 * k * (m + k) + m)
    code.expect(float(count * m * k * (2 * k + 4)))
    find = code.routine("lag_scores", int, int, int, *[object] * 5)
    find(count, m, k, *map(np.ascontiguousarray, (residuals, basis, following)), scratch, scores)
    return scores[..., 0], scores[..., 1], np.where(scores[..., 2] > 0.0, scores[..., 2], np.nan)


def correlated(found: Floats, expected: Floats, spread: Floats, share: float = 0.0) -> np.ndarray:
    """Where r is beyond what chance makes of it, or nearer to that than by a ``share``."""
    away = (found - expected) / spread
    return np.asarray((away > ALIKE * (1.0 - share)) | (away < -OPPOSED * (1.0 - share)))


@np.errstate(all="ignore")
def autocorrelation(
    problem: Problem,
    equations: Assembled,
    minimum: Minimum,
    basis: Floats,
    tested: Indices,
    *,
    overstated: bool,
) -> tuple[Diagnostic, ...]:
    """A warning where residuals at a minimum are correlated along the rows, but for places that are ``tested`` (k,).

    ``basis`` (m, k) has the directions in which residuals follow the estimates;
    ``overstated``: chi² says that the stated noise is too large.
    """
    if equations.rows is not None or equations.likely:
        return ()
    following = np.full(equations.count, -1, dtype=np.int64)
    for group in equations.groups:
        if in_order(problem, group.kernel.owner) and group.rows > 1:
            places = group.first + np.arange(group.count - group.kernel.outputs)
            following[places] = places + group.kernel.outputs
    following[tested] = -1
    if not bool((following >= 0).any()) or not bool(np.isfinite(basis).all()):
        return ()
    found, expected, spread = lag_scores(solver_code(equations), minimum.residuals, basis, following)
    if not correlated(found, expected, spread):
        return ()
    sums = float(found), float(expected), float(spread)
    return (faults.autocorrelated_residuals(problem.span, *sums, overstated=overstated),)


COARSE = 0.55
"""Standard deviation of the readings about the model, in steps, below which the steps are coarse: 0.29 is that of
rounding alone; where the scatter before rounding is half a step, it is 0.58."""

COARSE_SHIFT = 0.5
"""Standard deviations by which rounding may shift estimates from which on that matters."""

LEAST_ROWS = 4
"""Readings that tell their steps: two of them have to be alike, and two to differ."""

WHOLE = 1e-6
"""Distance from whole numbers of steps up to which readings are such: what changes of units leave."""


def rounded_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations whose unknown noise their residuals tell."""
    block = problem.blocks[owner]
    return read_column(problem, owner) if block.unknown_factor and len(block.cases) == 1 else None


def read_column(problem: Problem, owner: int) -> str | None:
    """The column that holds the readings of a block of scalar equations."""
    block = problem.blocks[owner]
    if block.role is not BlockRole.OBSERVATION or block.table is None:
        return None
    sides = {each.measured for case in block.cases for each in case.equations}
    if len(sides) != 1 or any(len(case.equations) != 1 for case in block.cases):
        return None
    (measured,) = sides
    if measured is None or len(measured) != 1 or not isinstance(measured[0], Column):
        return None
    column = measured[0]
    simple = column.row is RowChoice.EACH and column.table == block.table and column.sampling is None
    return column.name if simple and column.member is None else None


@np.errstate(all="ignore")
def steps(readings: Floats) -> Floats:
    """The steps (…,) of readings (…, m), NaN where there is none; NaN where they are in no steps, or all are alike.

    Readings of a continuous quantity are never alike, and no whole numbers of their smallest difference.
    """
    ordered = np.sort(readings, axis=-1)
    apart = np.diff(ordered, axis=-1)
    step = np.min(np.where(apart > 0.0, apart, np.inf), axis=-1, initial=np.inf)
    counted = (ordered - ordered[..., :1]) / step[..., None]
    whole = (np.isnan(counted) | (np.abs(counted - np.rint(counted)) <= WHOLE)).all(axis=-1)
    alike = (apart == 0.0).any(axis=-1) & (np.isfinite(readings).sum(axis=-1) >= LEAST_ROWS)
    return np.where(whole & alike & np.isfinite(step), step, np.nan)


@np.errstate(all="ignore")
def coarse(readings: Floats, raw: Floats, deviations: Floats, basis: Floats, share: float = 0.0) -> Mask:
    """Where the steps of readings are coarse, or nearly: nearer to that than by a ``share``.

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates. The rounding error of the reading of y has the first harmonic h/π sin(2π y/h).
    """
    there = np.isfinite(readings)
    step = steps(readings)
    known, scatter = np.where(there, deviations, np.nan), np.full(step.shape, np.nan)
    some = np.isfinite(known).any(axis=-1)
    scatter[some] = np.nanmedian(known[some], axis=-1)
    wave = np.exp(2j * np.pi * (readings + raw) / step[..., None]) / deviations
    along = np.einsum("...mk,...m->...k", basis, np.where(there, wave, 0.0))
    shift = step / np.pi * np.sqrt(np.square(np.abs(along)).sum(axis=-1))
    return np.asarray((scatter < COARSE * step * (1.0 + share)) & (shift > COARSE_SHIFT * (1.0 - share)))


def coarse_readings(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """A warning for each clause whose readings have coarse steps at a minimum."""
    if minimum.blocks is not None or equations.rows is not None or equations.likely or equations.lossy:
        return ()
    stepped = dict(_stepped(problem, tables, equations))
    if not stepped or not bool(np.isfinite(estimated.factor).all()):
        return ()
    basis = directions(equations, minimum, estimated)
    factors = np.ones(equations.count) if equations.factors is None else equations.picked(equations.factors)
    redundancy = max(equations.count - basis.shape[1], 1)
    common = float(np.sqrt(minimum.cost / redundancy)) if equations.factors is None else 1.0
    told = []
    for number, readings in stepped.items():
        group = equations.groups[number]
        block = problem.blocks[group.kernel.owner]
        own = slice(group.first, group.first + group.count)
        unit = factors[own] / group.whiteners[0].weights[:, 0]
        if bool(coarse(readings, minimum.residuals[own] * unit, common * unit, basis[own])):
            scatter = common * float(np.median(unit)) / float(steps(readings))
            counts = bool((readings >= 0.0).all() and (readings == np.rint(readings)).all())
            told.append(faults.coarse_readings(block.span, block.name, scatter, counts=counts))
    return tuple(told)


def _stepped(problem: Problem, tables: Mapping[str, Table], equations: Assembled) -> Iterator[tuple[int, Floats]]:
    """The groups, by number, whose readings are in steps, and these readings (rows,)."""
    for number, group in enumerate(equations.groups):
        owner = group.kernel.owner
        name, table = rounded_column(problem, owner), problem.blocks[owner].table
        if name is None or table is None or group.positions is None or group.rows < LEAST_ROWS:
            continue
        readings = tables[table].numbers(name)[np.asarray(group.positions)]
        if bool(np.isfinite(steps(readings))):
            yield number, readings


SELDOM = 0.01
"""Probability below which readings are not alike by chance: that of one of six which is 0 is 0.065 with three figures,
and 0.0065 with four."""

EDGE_SHIFT = 0.1
"""Standard deviations by which limits shift estimates from which on that matters, as far as the estimates tell, which
are shifted themselves: of six readings about 0 one that is shown as 0 tells 0.17 of 0.3."""

NEAR, BEYOND = 2.0, 5.0
"""Standard deviations from a limit up to which a reading might have been beyond it; and from which on it was not."""

FINEST = 1e-6
"""Steps, as a share of the range of readings, below which they are not told from what changes of units leave."""

LEAST_OTHERS = 2
"""Readings within the limit that tell how fine readings are."""

SIGNS = 1.0, -1.0
"""The lower edge, and the upper one."""


@np.errstate(all="ignore")
def at_edge(
    readings: Floats, raw: Floats, deviations: Floats, basis: Floats, sign: float, margin: float = 0.0
) -> tuple[Floats, Mask]:
    """The least (``sign`` 1) or largest (−1) of the readings (…,), and whether it may be a limit that matters (…,).

    ``readings`` (…, m) are NaN for other rows, ``raw`` (…, m) what the model is larger by, ``deviations`` (…, m) the
    standard deviations as estimated, ``basis`` (…, m, k) orthonormal, the directions in which residuals follow
    estimates. Limits are reached nearer by a share ``margin``.
    """
    there = np.isfinite(readings)
    ordered = np.where(there, sign * readings, np.inf)
    least = ordered.min(axis=-1, keepdims=True)
    tied = there & (ordered == least)
    count = tied.sum(axis=-1)
    edge = sign * least[..., 0] + 0.0
    told = (count > 1) | (least[..., 0] == 0.0)
    if not told.any():
        return edge, told
    depth = np.where(there, least - ordered - sign * raw, -np.inf) / deviations
    near = (depth > -NEAR * (1.0 + margin)).sum(axis=-1)
    size = np.where(there, np.abs(readings), 0.0).max(axis=-1, keepdims=True)
    noisy = (there & (np.abs(raw) > NO_DIFFERENCE * size)).any(axis=-1)
    found = noisy & told & ((count > 1) | (near > 1))
    hidden = np.zeros(depth.shape)
    tied &= found[..., None]
    hidden[tied] = [_below(each) for each in depth[tied].tolist()]
    shift = np.sqrt(np.square(np.einsum("...mk,...m->...k", basis, hidden)).sum(axis=-1))
    return edge, np.asarray(found & (shift > EDGE_SHIFT * (1.0 - margin)))


def _below(depth: float) -> float:
    """How far a standard normal value is below ``depth`` on average, if it is below."""
    depth = max(depth, -BEYOND)
    return depth + sqrt(2.0 / pi) * exp(-0.5 * depth * depth) / erfc(-depth / sqrt(2.0))


def by_chance(count: int, rows: int, others: Floats, deviation: float) -> float:
    """A bound of the probability that so many readings of some rows are equal to a value by chance.

    ``others`` (n,) are the distances from it of readings of one kind, which tell how fine these are.
    """
    if len(others) < LEAST_OTHERS:
        return 1.0
    once = grid(others) / (deviation * sqrt(2.0 * pi))
    return rows * once if count == 1 else comb(rows, count) * once ** (count - 1)


def grid(distances: Floats) -> float:
    """The largest step of which all ``distances`` (n,) > 0 are whole multiples, by Euclid's algorithm."""
    finest, step = FINEST * float(distances.max()), 0.0
    for each in distances.tolist():
        larger, smaller = each, step
        while smaller > finest:
            larger, smaller = smaller, abs(larger - round(larger / smaller) * smaller)
        step = larger
    return step


def clauses_read(problem: Problem, equations: Assembled) -> dict[int, tuple[str, str]]:
    """The table and the column that hold the readings, of each clause of which such readings may be told."""
    found = {}
    for owner in told_apart(problem, equations):
        column, table = read_column(problem, owner), problem.blocks[owner].table
        if column is not None and table is not None:
            found[owner] = table, column
    return found


@np.errstate(all="ignore")
def readings_at_edges(
    problem: Problem,
    tables: Mapping[str, Table],
    equations: Assembled,
    minimum: Minimum,
    basis: Floats,
    variance: float,
) -> Iterator[Diagnostic]:
    """A warning for each clause some of whose readings stand at a limit that is not stated.

    ``basis`` (m, k) are the directions of the fit, ``variance`` is that of whitened residuals.
    """
    factors = np.ones(equations.count) if equations.factors is None else equations.picked(equations.factors)
    read: dict[int, tuple[Floats, Indices]] = {}
    for owner, (table, column) in clauses_read(problem, equations).items():
        groups = [group for group in equations.groups if group.kernel.owner == owner and group.rows]
        numbers = tables[table].numbers(column)
        if groups:
            places = np.concatenate([group.first + np.arange(group.rows) for group in groups])
            read[owner] = np.concatenate([numbers[np.asarray(group.positions)] for group in groups]), places
    weights = np.ones(equations.count)
    for group in equations.groups:
        if group.kernel.owner in read:
            weights[group.first : group.first + group.rows] = group.whiteners[0].weights[:, 0]
    deviations = factors * np.sqrt(variance) / weights
    for owner, (readings, places) in read.items():
        own, block = deviations[places], problem.blocks[owner]
        alike = [each for other, (each, _) in read.items() if problem.blocks[other].factor_name == block.factor_name]
        for sign in SIGNS:
            edge, suspect = at_edge(readings, minimum.residuals[places] * own, own, basis[places], sign)
            if not suspect:
                continue
            away = np.abs(np.concatenate(alike) - edge)
            count = int((readings == edge).sum())
            if by_chance(count, len(readings), away[away > 0.0], float(np.median(own))) < SELDOM:
                yield faults.readings_at_edge(
                    block.span, block.name, (count, len(readings)), float(edge), lower=sign > 0
                )
                break
