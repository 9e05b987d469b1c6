"""Whether an answer agrees with what it was made from: the model with its linearisation, data with noise, priors.

Scales of a likelihood that are estimated as zero, or where nothing tells them from zero.

Where readings fit exactly, the likelihood of a scale has no maximum: it grows, or stays as it is, as the scale falls to
zero. A scale beside another one may be zero as well: its information falls with it, and its standard deviation, which
is of the curvature at zero, means nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.binding import Group, mentioned
from mbm.equations.losses import loss_weights
from mbm.equations.solves import alone
from mbm.equations.types import Covariance, Floats, Mask, Minimum
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust import faults as trust_faults
from mbm.estimation.trust.alike import directions
from mbm.estimation.trust.coarse import of_readings, uneven_rows
from mbm.estimation.trust.curvature import Curvature, DerivedEnds
from mbm.estimation.trust.fits import Fits, Said, only
from mbm.estimation.trust.hidden import hidden_outliers
from mbm.estimation.trust.nonlinearity import IntervalEnds
from mbm.estimation.uncertainty.derived import Propagation
from mbm.estimation.uncertainty.statistics import Statistics, plain_residuals
from mbm.estimation.uncertainty.variance import redundancy_numbers
from mbm.expression.evaluate import evaluate
from mbm.problem.naming import scalar_name
from mbm.problem.previous import has_before, looks_back
from mbm.problem.rows import lookup
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import BlockRole, Problem
from mbm.solver.chi_square import chi_square_tail
from mbm.solver.decisions import FARTHEST
from mbm.text.types import Diagnostic, Span
from mbm.values import once

IMPROBABLE = 1e-6
"""Probability of a cost as large as the one found below which data and stated noise disagree: never by chance."""

UNLIKELY = 0.01
"""Probability of a cost as large, or as small, as the one found below which the noise is probably stated wrongly."""

MADE_UP = 1e-6
"""Residuals, as a share of the stated noise, below which data were made without noise, and say nothing about it."""

STRAINED = 4.0
"""Distance of a prior from what the data say without it, in standard deviations of that distance: once in 16,000."""

OF_RESIDUALS = (
    faults.NOISE_AGAINST_DATA,
    trust_faults.IMPROBABLE_NOISE,
    trust_faults.HIDDEN_OUTLIERS,
    trust_faults.AUTOCORRELATED_RESIDUALS,
    trust_faults.UNEVEN_NOISE,
    trust_faults.OUTLYING_ROW,
    trust_faults.READINGS_AT_EDGE,
)
"""What may be said of residuals, by `of_residuals`."""

CHECKED = 1e-12
"""Redundancy of a prior up to which nothing checks it."""


@np.errstate(all="ignore")
def doubts(
    propagation: Propagation, minimum: Minimum, derived: tuple[DerivedSolution, ...], bent: Curvature | None
) -> tuple[Diagnostic, ...]:
    """Warnings about a solve that converged; ``propagation`` holds the equations and covariance at the minimum.

    ``bent`` is what `curvature` found there.
    """
    if not minimum.reason.converged:
        return ()
    problem, equations, outcome = propagation.problem, propagation.equations, propagation.outcome
    found = [*_without_value(propagation, derived)]
    if bent is not None:
        found += _nonlinear(equations, bent.ends)
        found += _nonlinear_derived(propagation, bent.derived)
    fit = fit_of(propagation, minimum)
    dense = fit if minimum.blocks is None else None
    found += (*of_residuals(propagation, minimum, fit), *(() if dense is None else only(of_readings(dense))))
    if equations.likely:  # loaded by problems with likelihoods only
        found += vanishing_scales(problem, propagation.binder.tables, equations, minimum, outcome.covariance)
    if outcome.freedoms.poor:
        found.append(trust_faults.small_sample(problem.span))
    if equations.lossy or equations.rows is not None:  # loaded by robust problems only, so that others start at once
        from mbm.estimation.trust.left_out import of_left_out

        found += of_left_out(propagation, minimum)
    return (*found, *(only(strained(dense)) if dense is not None else ()))


def fit_of(propagation: Propagation, minimum: Minimum) -> Fits | None:
    """The solve as one of several; None where the residuals are those of other rows."""
    equations, estimated = propagation.equations, propagation.outcome.covariance
    if len(minimum.residuals) != equations.count:
        return None
    image = np.zeros((equations.count, 0)) if minimum.blocks is not None else minimum.jacobian @ estimated.factor
    scaled = not equations.lossy and estimated.variance > 0.0  # else the factor is not that of the normal equations
    image = image / np.sqrt(estimated.variance) if scaled else image
    solves, plain, observed = alone(equations), plain_residuals(equations, minimum), propagation.outcome.observed
    pushed = minimum.constraints is not None and bool(minimum.constraints.forcing.any())
    return Fits(
        problem=propagation.problem,
        tables=propagation.binder.tables,
        solves=solves,
        residuals=equations.expanded(minimum.residuals)[None],
        pull=equations.expanded(plain * loss_weights(loss_lines(equations), plain))[None],
        basis=equations.expanded(directions(image, scaled=scaled))[None],
        image=equations.expanded(image)[None],
        noise=np.sqrt([estimated.variance]),
        held=np.array([pushed or bool(minimum.at_bound.any())]),
        stated=once(solves.deviations),
        redundancy=lambda _: equations.expanded(redundancy_numbers(minimum.jacobian, observed, minimum.blocks)),
    )


@np.errstate(all="ignore")
def of_residuals(propagation: Propagation, minimum: Minimum, fit: Fits | None) -> tuple[Diagnostic, ...]:
    """Doubts of the noise, by the sizes of residuals and their order; as for `doubts`."""
    return (
        *_noise(propagation.problem, propagation.equations, propagation.outcome),
        *(() if fit is None else only(hidden_outliers(fit))),
        *_correlated(propagation, minimum, fit),
    )


def _correlated(propagation: Propagation, minimum: Minimum, fit: Fits | None) -> tuple[Diagnostic, ...]:
    """Errors that are alike along the rows: of chains first, as these name their clause, then of the other rows.

    Where none are, those that grow with the readings.
    """
    problem, equations, outcome = propagation.problem, propagation.equations, propagation.outcome
    tested, sigma0, tail = np.empty(0, dtype=np.int64), outcome.fit.sigma0, _tail(problem, equations, outcome)
    over = sigma0 is not None and tail is not None and bool(overstated(tail, sigma0))
    families = any(entry.members > 1 for entry in equations.layout.entries)
    if families or any(block.earlier for block in problem.blocks):
        # Loaded by problems with families, states and `previous` only, so that the others start at once.
        from mbm.estimation.trust.chains import correlated_chains, tested_chains

        chains = tested_chains(problem, equations, minimum)
        found = correlated_chains(problem, equations, minimum, chains, overstated=over)
        if found:
            return found
        tested = np.concatenate([tested, *(each.places.ravel() for each in chains)])
    if minimum.blocks is not None or fit is None:
        return ()
    return only(uneven_rows(fit, np.array([over]), tested))


def _noise(problem: Problem, equations: Assembled, outcome: Statistics) -> Iterator[Diagnostic]:
    """The χ² of the residuals against the stated noise."""
    fit, tail = outcome.fit, _tail(problem, equations, outcome)
    if fit.sigma0 is None or tail is None:
        return
    if tail < IMPROBABLE and not equations.lossy:
        yield faults.noise_against_data(problem.span, fit.sigma0, tail)
    elif improbable(np.array(tail), np.array(fit.sigma0), lossy=equations.lossy):
        yield improbable_noise(problem.span, fit.sigma0, tail)


def follows_statement(equations: Assembled) -> bool:
    """Whether some noise is stated that standard deviations follow: under losses they follow the residuals."""
    return any(group.role is BlockRole.OBSERVATION and not group.losses for group in equations.groups)


def _tail(problem: Problem, equations: Assembled, outcome: Statistics) -> float | None:
    """P of a χ² as large; under losses, which make it smaller, too; None where nothing follows the stated noise."""
    fit = outcome.fit
    if equations.lossy and not follows_statement(equations):
        return None
    if fit.chi2_p is None and fit.sigma0 is not None and equations.likely:
        return None if equations.lossy or problem.estimates_noise else _scattered(outcome)
    tested = not equations.lossy or equations.rows is not None or equations.likely or problem.estimates_noise
    return fit.chi2_p if tested or fit.sigma0 is None else chi_square_tail(fit.cost, fit.dof)


def _scattered(outcome: Statistics) -> float | None:
    """The same of counts that are too small for χ², which shows that they scatter too much, and no more."""
    factor = np.inf if outcome.counted is None else float(outcome.counted.larger[0])
    tail = chi_square_tail(outcome.fit.cost / factor, outcome.fit.dof) if np.isfinite(factor) else 1.0
    return tail if tail < UNLIKELY else None


def improbable(tail: Floats, sigma0: Floats, *, lossy: bool) -> Mask:
    """Where χ² is among the largest or smallest that the stated noise makes; ``tail`` is P of one as large.

    Under losses large residuals are expected, and only small ones improbable.
    """
    small = overstated(tail, sigma0)
    return np.asarray(small if lossy else small | ((tail < UNLIKELY) & (tail >= IMPROBABLE)))


def overstated(tail: Floats | float, sigma0: Floats | float) -> Mask:
    """Where χ² is among the smallest that the stated noise makes."""
    return np.asarray((np.subtract(1.0, tail) < UNLIKELY) & np.greater(sigma0, MADE_UP))


def improbable_noise(span: Span, sigma0: float, tail: float) -> Diagnostic:
    """Such a χ²."""
    large = tail < UNLIKELY
    return trust_faults.improbable_noise(span, sigma0, tail if large else 1.0 - tail, large=large)


def _without_value(propagation: Propagation, derived: tuple[DerivedSolution, ...]) -> Iterator[Diagnostic]:
    """One warning for each quantity that is not finite although all estimates are."""
    if not bool(np.isfinite(propagation.numbers).all()):
        return
    for one in derived:
        stated = propagation.problem.derived[one.owner]
        bad = (~np.isfinite(one.values)).any(axis=1)
        if stated.table is not None and looks_back(
            (n for case in stated.cases for n in case.values), (case.static for case in stated.cases)
        ):
            bad &= has_before(propagation.binder.tables[stated.table])
        if wrong := int(bad.sum()):
            rows = wrong if stated.table is not None else 0
            yield faults.derived_not_finite(stated.span, stated.name, rows, one.undefined)


def _nonlinear(equations: Assembled, ends: IntervalEnds) -> tuple[Diagnostic, ...]:
    """One warning for each unknown some of whose stated intervals miss the ends of the true ones."""
    layout = equations.layout
    owners: dict[str, list[str]] = {}
    for place in ends.doubtful:
        coordinate = int(equations.free[place])
        text = reaches(layout.name(coordinate), float(ends.lower[place]), float(ends.upper[place]))
        owners.setdefault(layout.owner(coordinate).unknown.name, []).append(text)
    return tuple(faults.too_nonlinear(layout.entry(name).unknown.span, texts) for name, texts in owners.items())


def _nonlinear_derived(propagation: Propagation, derived: tuple[DerivedEnds, ...]) -> Iterator[Diagnostic]:
    """The same for derived quantities, and their rows where they have some."""
    for one in derived:
        stated = propagation.problem.derived[one.owner]
        keys: Sequence[CellKey | None] = (None,)
        if stated.table is not None:
            table = propagation.binder.tables[stated.table]
            keys = table.keys() if table.key is not None else tuple(float(row) for row in table.rows)
        size = int(np.prod(stated.shape, dtype=np.int64))
        texts = []
        for i in one.ends.doubtful:
            row, place = divmod(int(one.known[i]), size)
            name = scalar_name(stated.name, keys[row], _index(stated.shape, place))
            texts.append(reaches(name, float(one.ends.lower[i]), float(one.ends.upper[i])))
        for which in one.flat.tolist():
            row, place = divmod(which, size)
            name = scalar_name(stated.name, keys[row], _index(stated.shape, place))
            texts.append(still(name))
        if texts:
            yield faults.too_nonlinear(stated.span, texts)


def _index(shape: tuple[int, ...], place: int) -> tuple[int, ...]:
    """The index, from 1, of a number of a quantity of this shape."""
    return tuple(int(i) + 1 for i in np.unravel_index(place, shape)) if shape else ()


def still(name: str) -> str:
    """A number whose derivative is zero."""
    return f"`{name}` beyond its width of 0, as the derivative is zero there"


def reaches(name: str, lower: float, upper: float) -> str:
    """``b2`` 2.1 times as far above, 0.8 times as far below."""
    return f"`{name}` {_reach(lower)} below and {_reach(upper)} above"


def _reach(ratio: float) -> str:
    if ratio < 0.0:
        return "turning back on the way"
    if not np.isfinite(ratio) or ratio > FARTHEST:
        return f"more than {FARTHEST:g} times as far"
    if ratio == 0.0:
        return "to where the model has no value"
    times = f"{ratio:.2g}"
    return "as far" if times == "1" else f"{times} times as far"


def strained(fits: Fits) -> Said:
    """Priors that the data contradict."""
    blocks = fits.problem.blocks
    priors = {i: fits.solves.block_slots(i) for i, block in enumerate(blocks) if block.role is BlockRole.PRIOR}
    count = sum((np.bincount(solve, minlength=fits.solves.count) for solve, _ in priors.values()), np.zeros(1))
    limit = np.where(count > 1, np.maximum(STRAINED, np.sqrt(2 * np.log(count / IMPROBABLE))), STRAINED)
    for number, own in priors.items():
        away = np.abs(innovations(fits.residuals[own], np.square(fits.image[own]).sum(axis=1)))
        worst = np.zeros(fits.solves.count)
        np.maximum.at(worst, own[0], np.where(np.isfinite(away), away, 0.0))
        block = blocks[number]
        for place in np.flatnonzero(worst > limit).tolist():
            yield place, partial(faults.prior_against_data, block.span, block.name, float(worst[place]))


def innovations(residuals: Floats, leverage: Floats) -> Floats:
    """Residuals of priors over the root of one minus their leverage; 0 where nothing of it is left to check them.

    That is the difference of a prior from the estimate without it, over the standard deviation of that difference (the
    normalised innovation).
    """
    free = np.maximum(1.0 - leverage, 0.0)
    return np.where(free > CHECKED, residuals / np.sqrt(free), 0.0)


EXACT = 1e-9
"""Size of the residuals, beside that of what is measured, below which readings fit exactly: far below what anything
measures, and above rounding."""

UNTOLD = 10.0
"""Standard deviation of a scale, in scales, or of its logarithm, from which it is not told from nothing: what is told
by two rows has one of 0.7, and a scale that falls to nothing loses its information with its square."""

GONE = 10.0
"""Fall of the logarithm of a scale after which nothing is left of it."""

MINOR = 0.5
"""Share of the variance below which a part is not all there is: what moves deviations by more is no logarithm of one
that vanishes."""

FALL = 0.1
"""Share of the variance that is due to scales in whose place there might be nothing."""


def vanishing_scales(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, covariance: Covariance
) -> tuple[Diagnostic, ...]:
    """What is said of scales that have vanished at the minimum, one for each clause and cause."""
    layout = equations.layout
    sigma = np.full(len(layout.number), np.nan)
    if covariance.sigma.size == equations.dimension:
        sigma[equations.free] = covariance.sigma
    found: list[Diagnostic] = []
    for group in equations.groups:
        if group.readings is None or not group.readings.scales or group.role is not BlockRole.OBSERVATION:
            continue
        block, count = problem.blocks[group.kernel.owner], len(layout.number)
        scales = np.flatnonzero(mentioned((group,), count) & ~mentioned((group.written,), count))
        scales = scales[np.isin(scales, equations.free) & (layout.number[scales] >= 0)]
        point, places, positive = minimum.point, layout.number[scales], layout.positive[scales]
        gone = np.array([_gone(group, point, k, positive=bool(p)) for k, p in zip(places, positive, strict=True)])
        left = np.tile(point, (len(scales), 1))
        left[np.arange(len(scales)), places] = gone
        share = np.array([_shares(group, point, each).max(initial=0.0) for each in left])
        size = np.where(gone == point[places] - GONE, np.where(share < MINOR, 1.0, np.inf), np.abs(point[places]))
        untold = scales[(sigma[scales] > UNTOLD * size) | (share < EXACT)]
        without = point.copy()
        without[places] = gone
        raw = np.abs(group.written.values(minimum.point)).max(initial=0.0)
        fits = bool(raw <= EXACT * _size(problem, tables, group))
        exact = fits and bool((_shares(group, point, without) > FALL).any())
        names = tuple(layout.name(k) for k in (scales if exact else untold))
        if names:
            found.append(trust_faults.vanishing_scale(problem.span, block.name, names, exact=exact))
    return tuple(dict.fromkeys(found))


def _size(problem: Problem, tables: Mapping[str, Table], group: Group) -> float:
    """The largest number on the measured side of a clause; 0 where there is none."""
    block = problem.blocks[group.kernel.owner]
    table = None if block.table is None else tables[block.table]
    largest = 0.0
    for equation in block.cases[group.kernel.case].equations:
        for each in evaluate(equation.measured or (), lookup(table, group.positions, tables)):
            numbers = np.abs(np.asarray(each, dtype=float))
            largest = max(largest, float(numbers[np.isfinite(numbers)].max(initial=0.0)))
    return largest


@np.errstate(all="ignore")
def _shares(group: Group, point: Floats, lower: Floats) -> Floats:
    """The share of each row's variance that is due to what is larger at ``point`` (N,) than at ``lower`` (N,)."""
    shifted = () if group.readings is None else group.readings.shifted
    logs = [np.square(group.values(each)[:, shifted]) for each in (point, lower)]
    return np.asarray(np.nan_to_num(1.0 - np.exp(logs[1] - logs[0]), nan=1.0))


def _gone(group: Group, point: Floats, place: int, *, positive: bool) -> float:
    """Where nothing is left of a scale: far below its value where it is positive, at 0 where its sign says nothing, and
    far down where it is a logarithm.
    """
    if positive:
        return float(point[place] * np.exp(-GONE))
    sides = np.stack([point, point])
    sides[:, place] = 1.0, -1.0
    even = bool((np.abs(_shares(group, *sides)) <= EXACT).all())
    return 0.0 if even else float(point[place] - GONE)
