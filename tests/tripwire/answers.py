"""What is kept of an answer, and how two answers are compared: in standard deviations, never as text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import mbm
from tests.tripwire.cases import Case

SOLVES = 20
"""Of a problem with more solves the first so many are kept."""

NUMBERS = 200
"""Of a solve with more numbers so many are kept, evenly spread."""

SHIFTED = 1e-5
"""Standard deviations by which an estimate may differ: far above where any iteration ends, far below what matters."""

SPREAD = 1e-4
"""Relative difference of standard deviations, and of costs (1 + cost)."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """One solve: ``status`` (or the codes that refused it), estimates and deviations (k,), cost, degrees of freedom."""

    status: str
    values: np.ndarray
    sigmas: np.ndarray
    cost: float
    dof: int


NOTHING = np.zeros(0)


def refused(why: str) -> Answer:
    """No answer, but a reason."""
    return Answer(status=f"refused: {why}", values=NOTHING, sigmas=NOTHING, cost=np.nan, dof=-1)


def answers(case: Case, path: str) -> list[Answer]:
    """What a path answers now."""
    try:
        problem, data = case.load()
        solved = problem.solve(data=data or None, backend=path)
    except mbm.MbmError as error:
        return [refused(" ".join(sorted({diagnostic.code.name for diagnostic in error.diagnostics})))]
    except Exception as error:  # noqa: BLE001 - a fault of mbm in one case is recorded as any answer
        return [refused(f"by a fault, {type(error).__name__}")]
    return [_of(report) for report in solved.result.solves[:SOLVES]]


def _of(report) -> Answer:
    values, sigmas = [NOTHING], [NOTHING]
    for estimate in report.estimates:
        value = np.ravel(np.asarray(estimate.value, dtype=float))
        sigma = np.full(value.shape, np.nan)
        if estimate.sigma is not None and np.size(estimate.sigma) == value.size:
            sigma = np.ravel(estimate.sigma)
        elif estimate.sigma is not None:  # rotations and the like have other numbers than deviations
            sigma = np.full(value.shape, np.max(estimate.sigma, initial=0.0))
        values.append(value)
        sigmas.append(sigma)
    every = np.concatenate(values)
    picked = np.unique(np.linspace(0, max(len(every) - 1, 0), NUMBERS).astype(int))[: len(every)]
    return Answer(
        status=report.status,
        values=every[picked],
        # as they are kept: seven digits
        sigmas=np.concatenate(sigmas)[picked].astype(np.float32).astype(float),
        cost=np.nan if report.cost is None else float(report.cost),
        dof=-1 if report.dof is None else int(report.dof),
    )


def differences(before: Answer, now: Answer) -> list[str]:
    """What is not as it was."""
    if before.status != now.status:
        return [f"{now.status}, was {before.status}"]
    if before.status not in ("converged", "unobservable"):
        return []  # where an iteration that failed came to its end says nothing
    if before.values.shape != now.values.shape:
        return [f"{len(now.values)} numbers, were {len(before.values)}"]
    found = [] if before.dof == now.dof else [f"{now.dof} degrees of freedom, were {before.dof}"]
    if (np.isfinite(before.sigmas) != np.isfinite(now.sigmas)).any():
        return [*found, "other numbers are determined"]
    told = np.isfinite(before.sigmas)
    # What is fixed, or determined by constraints alone, has no σ to be measured by: rounding of its size.
    size = np.maximum(before.sigmas[told], 1e-7 * np.abs(before.values[told]))
    shift = np.abs(now.values[told] - before.values[told]) / np.maximum(size, 1e-300)
    if shift.size and not shift.max() <= SHIFTED:
        found.append(f"an estimate moved by {shift.max():.1e} σ")
    wide = np.abs(now.sigmas[told] - before.sigmas[told]) / np.maximum(size, 1e-300)
    if wide.size and not wide.max() <= SPREAD:
        found.append(f"a σ changed by {wide.max():.1e} of itself")
    if np.isfinite(before.cost) and not abs(now.cost - before.cost) <= SPREAD * (1 + abs(before.cost)):
        found.append(f"cost {now.cost:.9g}, was {before.cost:.9g}")
    return found


def compared(before: list[Answer], now: list[Answer]) -> list[str]:
    """What is not as it was in any of the solves."""
    if len(before) != len(now):
        return [f"{len(now)} solves, were {len(before)}"]
    each = [(k, differences(one, other)) for k, (one, other) in enumerate(zip(before, now, strict=True))]
    return [f"solve {k + 1}: {what}" for k, wrong in each for what in wrong]
