"""The numbers that sum a solve up: a line for each, by which reports, documents, columns and CSV files go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mbm.estimation.search.solution import Solution
from mbm.report.encode import number as finite
from mbm.report.types import SolveReport
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.estimation.batches.types import Columns

NO_FREEDOM = "there are no degrees of freedom"


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryNumber:
    """A number called ``name``, an attribute of `mbm.report.types.SolveReport` and a key of documents.

    ``of`` a solution, None where there is none, ``missing`` says why; ``columns`` of many solves (T,), NaN likewise.
    One that is ``extra`` stands in documents only where there is one, and in no table of many solves.
    """

    name: str
    of: Callable[[Solution], float | int | None]
    columns: Callable[[Columns], NDArray[Any]]
    missing: Callable[[Solution], str | None] = lambda _: None
    extra: bool = False


def _no_tail(solution: Solution) -> str | None:
    if solution.fit.dof <= 0:
        return NO_FREEDOM
    if solution.noise:
        return "the noise is estimated from the residuals"
    if solution.robust_cost is not None:
        return "with a robust loss the sum of squares does not follow the chi² law"
    if solution.log_likelihood is not None:
        return "the sum of squares of such readings (limits, rounded, small counts, long tails) follows no chi² law"
    return None


NUMBERS: tuple[SummaryNumber, ...] = (
    SummaryNumber(
        name="cost",
        of=lambda s: s.fit.cost,
        columns=lambda c: c.cost,
        missing=lambda s: None if isfinite(s.fit.cost) else "an equation has no finite value",
    ),
    SummaryNumber(name="dof", of=lambda s: s.fit.dof, columns=lambda c: c.dof),
    SummaryNumber(
        name="sigma0",
        of=lambda s: s.fit.sigma0,
        columns=lambda c: c.sigma0,
        missing=lambda s: NO_FREEDOM if s.fit.dof <= 0 else None,
    ),
    SummaryNumber(name="chi2_p", of=lambda s: s.fit.chi2_p, columns=lambda c: c.chi2_p, missing=_no_tail),
    SummaryNumber(name="robust_cost", of=lambda s: s.robust_cost, columns=lambda c: c.robust_cost, extra=True),
    SummaryNumber(
        name="log_likelihood",
        of=lambda s: s.log_likelihood,
        columns=lambda c: np.full(len(c.cost), np.nan) if c.log_likelihood is None else c.log_likelihood,
        extra=True,
    ),
    SummaryNumber(name="boxes", of=lambda _: None, columns=lambda c: np.full(len(c.cost), np.nan), extra=True),
)
USUAL = tuple(number.name for number in NUMBERS if not number.extra)
"""What each solve has, or a reason why it has none."""


def numbers_of(solution: Solution) -> tuple[Mapping[str, Any], Mapping[str, str]]:
    """The numbers of a solution by their names, and why those are missing of which that can be said.

    Nothing is known where the start has no value.
    """
    if solution.minimum.bad_row is not None:
        return {}, nothing_known(solution.minimum.reason.sentence)
    found = {number.name: finite(number.of(solution)) for number in NUMBERS}
    reasons = {number.name: number.missing(solution) for number in NUMBERS if found[number.name] is None}
    return found, {name: reason for name, reason in reasons.items() if reason is not None}


def nothing_known(reason: str) -> Mapping[str, str]:
    """The same ``reason`` for all of them."""
    return dict.fromkeys(USUAL, reason)


def numbers_at(columns: Columns, place: int, like: SolveReport) -> Mapping[str, Any]:
    """The numbers of one of many solves, of which it has the same as another one does."""
    return {
        number.name: finite(number.columns(columns)[place].item())
        for number in NUMBERS
        if not number.extra or getattr(like, number.name) is not None
    }
