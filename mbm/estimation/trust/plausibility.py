"""Whether an answer agrees with what it was made from: the model with its linearisation, data with noise, priors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled
from mbm.equations.types import Covariance, Floats, Minimum
from mbm.estimation.search.solution import DerivedSolution
from mbm.estimation.trust.curvature import Curvature, DerivedEnds
from mbm.estimation.trust.nonlinearity import IntervalEnds
from mbm.estimation.uncertainty.derived import Propagation
from mbm.problem.naming import scalar_name
from mbm.problem.previous import has_before, looks_back
from mbm.problem.types import BlockRole, Problem
from mbm.solver.decisions import FARTHEST
from mbm.text.types import Diagnostic

IMPROBABLE = 1e-6
"""Probability of a cost as large as the one found below which data and stated noise disagree: never by chance."""

STRAINED = 4.0
"""Distance of a prior from what the data say without it, in standard deviations of that distance: once in 16,000."""

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
    found: list[Diagnostic] = []
    found += _without_value(propagation, derived)
    if bent is not None:
        found += _nonlinear(equations, bent.ends)
        found += _nonlinear_derived(problem, bent.derived)
    fit = outcome.fit
    if fit.chi2_p is not None and fit.sigma0 is not None and fit.chi2_p < IMPROBABLE and not equations.lossy:
        found.append(faults.noise_against_data(problem.span, fit.sigma0, fit.chi2_p))
    return (*found, *_strained(problem, equations, minimum, outcome.covariance))


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
        wrong = int(bad.sum())
        if wrong:
            yield faults.derived_not_finite(stated.span, stated.name, wrong if stated.table is not None else 0)


def _nonlinear(equations: Assembled, ends: IntervalEnds) -> tuple[Diagnostic, ...]:
    """One warning for each unknown some of whose stated intervals miss the ends of the true ones."""
    layout = equations.layout
    owners: dict[str, list[str]] = {}
    for place in ends.doubtful:
        coordinate = int(equations.free[place])
        text = _ends(layout.name(coordinate), float(ends.lower[place]), float(ends.upper[place]))
        owners.setdefault(layout.owner(coordinate).unknown.name, []).append(text)
    return tuple(faults.too_nonlinear(layout.entry(name).unknown.span, texts) for name, texts in owners.items())


def _nonlinear_derived(problem: Problem, derived: tuple[DerivedEnds, ...]) -> Iterator[Diagnostic]:
    """The same for derived quantities."""
    for one in derived:
        stated = problem.derived[one.owner]
        names = [scalar_name(stated.name, None, _index(stated.shape, int(i))) for i in one.known]
        texts = [_ends(names[i], float(one.ends.lower[i]), float(one.ends.upper[i])) for i in one.ends.doubtful]
        if texts:
            yield faults.too_nonlinear(stated.span, texts)


def _index(shape: tuple[int, ...], place: int) -> tuple[int, ...]:
    """The index, from 1, of a number of a quantity of this shape."""
    return tuple(int(i) + 1 for i in np.unravel_index(place, shape)) if shape else ()


def _ends(name: str, lower: float, upper: float) -> str:
    """``b2`` 2.1 times as far above, 0.8 times as far below."""
    return f"`{name}` {_reach(lower)} below and {_reach(upper)} above"


def _reach(ratio: float) -> str:
    if ratio < 0.0:
        return "turning back on the way"
    if not np.isfinite(ratio) or ratio > FARTHEST:
        return f"more than {FARTHEST:g} times as far"
    if ratio == 0.0:
        return "to where the model has no value"
    return f"{ratio:.2g} times as far"


def _strained(
    problem: Problem, equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """Priors that the data contradict."""
    priors = [i for i, block in enumerate(problem.blocks) if block.role is BlockRole.PRIOR]
    rows = {i: equations.block_rows(i) for i in priors}
    count = sum(map(len, rows.values()))
    if not count or len(minimum.residuals) != equations.count or minimum.blocks is not None:
        return ()
    limit = max(STRAINED, float(np.sqrt(2 * np.log(count / IMPROBABLE))) if count > 1 else STRAINED)
    found = []
    for number, places in rows.items():
        leverage = np.square(minimum.jacobian[places] @ estimated.factor).sum(axis=1)
        worst = _largest(innovations(minimum.residuals[places], leverage))
        if worst > limit:
            block = problem.blocks[number]
            found.append(faults.prior_against_data(block.span, block.name, worst))
    return tuple(found)


def innovations(residuals: Floats, leverage: Floats, least: float = CHECKED) -> Floats:
    """Residuals of priors over the root of one minus their leverage; 0 where not more than ``least`` of it is left.

    That is the difference of a prior from the estimate without it, over the standard deviation of that difference (the
    normalised innovation).
    """
    free = np.maximum(1.0 - leverage, 0.0)
    return np.where(free > least, residuals / np.sqrt(free), 0.0)


def _largest(values: Floats | Sequence[float]) -> float:
    finite = np.abs(np.asarray(values, dtype=np.float64))
    return float(np.nanmax(finite, initial=0.0))
