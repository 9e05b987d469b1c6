"""Whether an answer agrees with what it was made from: the model with its linearisation, data with noise, priors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.problem.types import BlockRole, Problem
from mbm.solution import faults
from mbm.solution.assembly import Assembled
from mbm.solution.nonlinearity import IntervalEnds, interval_ends
from mbm.solution.types import Covariance, Fit, Floats, Minimum
from mbm.text.types import Diagnostic

IMPROBABLE = 1e-6
"""Probability of a cost as large as the one found below which data and stated noise disagree: never by chance."""

STRAINED = 4.0
"""Distance of a prior from what the data say without it, in standard deviations of that distance: once in 16,000."""


@np.errstate(all="ignore")
def doubts(
    problem: Problem,
    equations: Assembled,
    minimum: Minimum,
    estimated: Covariance,
    fit: Fit,
) -> tuple[Diagnostic, ...]:
    """Warnings about a solve that converged; ``equations`` and ``estimated`` are those of the minimum."""
    if not minimum.reason.converged:
        return ()
    found = [*_nonlinear(equations, interval_ends(equations, minimum, estimated))]
    if fit.chi2_p is not None and fit.sigma0 is not None and fit.chi2_p < IMPROBABLE and not equations.lossy:
        found.append(faults.noise_against_data(problem.span, fit.sigma0, fit.chi2_p))
    return (*found, *_strained(problem, equations, minimum, estimated))


def _nonlinear(equations: Assembled, ends: IntervalEnds | None) -> tuple[Diagnostic, ...]:
    """One warning for each unknown some of whose stated intervals miss the ends of the true ones."""
    if ends is None:
        return ()
    layout = equations.layout
    owners: dict[str, list[str]] = {}
    for place in ends.doubtful:
        coordinate = int(equations.free[place])
        text = _ends(layout.name(coordinate), float(ends.lower[place]), float(ends.upper[place]))
        owners.setdefault(layout.owner(coordinate).unknown.name, []).append(text)
    return tuple(faults.too_nonlinear(layout.entry(name).unknown.span, texts) for name, texts in owners.items())


def _ends(name: str, lower: float, upper: float) -> str:
    """``b2`` 2.1 times as far above, 0.8 times as far below."""
    return f"`{name}` {_reach(lower)} below and {_reach(upper)} above"


def _reach(ratio: float) -> str:
    if not np.isfinite(ratio) or ratio > faults.FARTHEST:
        return f"more than {faults.FARTHEST:g} times as far"
    if ratio == 0.0:
        return "to where the model has no value"
    return f"{ratio:.2g} times as far"


def _strained(
    problem: Problem, equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """Priors that the data contradict.

    The residual of a prior, over the root of one minus its leverage, is the difference of the prior from the estimate
    without it, over the standard deviation of that difference (the normalised innovation).
    """
    priors = [i for i, block in enumerate(problem.blocks) if block.role is BlockRole.PRIOR]
    rows = {i: equations.block_rows(i) for i in priors}
    count = sum(map(len, rows.values()))
    if not count or len(minimum.residuals) != equations.count or minimum.blocks is not None:
        return ()
    limit = max(STRAINED, float(np.sqrt(2 * np.log(count / IMPROBABLE))) if count > 1 else STRAINED)
    found = []
    for number, places in rows.items():
        leverage = np.square(minimum.jacobian[places] @ estimated.factor).sum(axis=1)
        free = np.maximum(1.0 - leverage, 0.0)
        innovation = np.where(free > 1e-12, minimum.residuals[places] / np.sqrt(free), 0.0)
        worst = _largest(innovation)
        if worst > limit:
            block = problem.blocks[number]
            found.append(faults.prior_against_data(block.span, block.name, worst))
    return tuple(found)


def _largest(values: Floats | Sequence[float]) -> float:
    finite = np.abs(np.asarray(values, dtype=np.float64))
    return float(np.nanmax(finite, initial=0.0))
