"""One solve → what is to be said beside its numbers: fit, noise, what is not determined, outliers, constraints."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.report.digits import plain
from mbm.report.types import Alternative, Observability, ResidualSummary, SolveReport
from mbm.text.types import Diagnostic

MOST_ROWS = 12
"""Outliers that are listed one by one."""

UNLIKELY = 1e-3
"""A chi² test beyond this probability, on either side, is spoken of."""

LARGE_PRIOR = 3.0
"""A prior that the estimates miss by more standard deviations than this is spoken of."""


def fit_sentence(solve: SolveReport) -> str | None:
    """Chi², degrees of freedom and p; without stated noise the sum of squares and sigma0."""
    if solve.cost is None or solve.dof is None:
        return None
    freedom = f"{solve.dof} degree{'' if solve.dof == 1 else 's'} of freedom"
    if solve.chi2_p is not None:
        text = f"chi² = {plain(solve.cost, 5)} with {freedom}, p = {plain(solve.chi2_p, 2)}"
        if solve.chi2_p < UNLIKELY:
            return f"{text}: the residuals are larger than the stated noise allows"
        if solve.chi2_p > 1 - UNLIKELY:
            return f"{text}: the residuals are smaller than the stated noise would make them"
        return text
    text = f"sum of squares {plain(solve.cost, 5)} with {freedom}"
    return text if solve.sigma0 is None else f"{text}, sigma0 = {plain(solve.sigma0, 4)}"


def noise_sentences(solve: SolveReport) -> Iterator[str]:
    """The factors that were estimated."""
    for clause, factor in solve.noise.items():
        if factor is not None:
            yield f"noise of `{clause}` estimated from its residuals: factor {plain(factor, 4)}"


def observability_sentences(found: Observability | None) -> Iterator[str]:
    """What the data do not determine, in words."""
    if found is None:
        return
    for direction in found.unobservable:
        yield f"not determined by the data: {direction.sentence}"
    for direction in found.gauge:
        yield f"free, set by the minimum-norm datum: {direction.sentence}"
    said = {name for direction in found.unobservable for name in direction.unknowns}
    unused = [name for name in found.unused if name not in said]
    if unused:
        names = ", ".join(f"`{name}`" for name in unused[:MOST_ROWS])
        yield f"in no equation: {names}{_and_more(len(unused))}"


def residual_sentences(solve: SolveReport) -> Iterator[str]:
    """Rows used, rms, and the outliers by the row in their file."""
    for clause, summary in solve.residual_summaries.items():
        used = f"{summary.used} of {summary.rows} rows" if summary.used != summary.rows else _rows(summary.rows)
        rms = "" if summary.rms is None else f", rms {plain(summary.rms, 3)}"
        yield f"`{clause}`: {used}{rms}"
        if summary.outliers:
            yield f"outliers in `{clause}`: {_outliers(summary)}"


def constraint_sentences(solve: SolveReport) -> Iterator[str]:
    """Violated and active constraints, and priors that the data contradict."""
    for constraint in solve.constraints:
        if constraint.violation > 0:
            yield f"constraint `{constraint.name}` is violated by {plain(constraint.violation, 3)}"
        elif constraint.active and constraint.type != "=":
            yield f"constraint `{constraint.name}` is active"
    for prior in solve.priors:
        if abs(prior.residual) > LARGE_PRIOR:
            yield (
                f"`{prior.name}` lies {plain(abs(prior.residual), 2)} standard deviations from "
                f"its prior {plain(prior.mean, 6)} ± {plain(prior.sigma, 2)}"
            )


def start_sentences(solve: SolveReport) -> Iterator[str]:
    """What several starts found."""
    if solve.starts is not None:
        starts = solve.starts
        yield f"{starts.tried} starts: {starts.converged} converged, {starts.best_found} to the best minimum"
    if solve.alternatives:
        yield f"other minima: {'; '.join(_minimum(alternative) for alternative in solve.alternatives[:MOST_ROWS])}"


def diagnostic_sentence(diagnostic: Diagnostic) -> str:
    """A diagnostic without its excerpt."""
    return f"{diagnostic.severity.value}[{diagnostic.code.name}]: {diagnostic.message}"


def _minimum(alternative: Alternative) -> str:
    found = "once" if alternative.starts == 1 else f"{alternative.starts} times"
    return f"cost {plain(alternative.cost, 5)} (found {found})"


def _outliers(summary: ResidualSummary) -> str:
    rows = summary.outlier_file_rows or summary.outliers
    listed = ", ".join(str(row) for row in rows[:MOST_ROWS])
    of_file = f" of {summary.file}" if summary.outlier_file_rows and summary.file else ""
    return f"row{'' if len(rows) == 1 else 's'} {listed}{_and_more(len(rows))}{of_file}"


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def _and_more(count: int) -> str:
    return f" and {count - MOST_ROWS} more" if count > MOST_ROWS else ""
