"""One solve → what is to be said beside its numbers: fit, noise, what is not determined, rows, priors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain, islice
from math import isfinite, pi

from mbm.report.digits import enclosed, plain
from mbm.report.elements import Scalar, scalars, unit_text
from mbm.report.faults import listed
from mbm.report.row_data import COORDINATE, OVER_POINTS, OVER_ROWS, RawResiduals, ResidualSummary, RootMean
from mbm.report.types import Alternative, DerivedValue, Estimate, Kind, Observability, Piece, SolveReport
from mbm.text.types import Diagnostic, Severity

MOST_NAMES = 12
"""Unused unknowns that are listed one by one."""

MOST_FREE = 20
"""Free combinations that are told one by one."""

UNLIKELY = 1e-3
"""A chi² test beyond this probability, on either side, is spoken of."""

MOST_OUTLIERS = 20
"""Outliers that are listed one by one."""

MOST_MEANS = 4
"""Root mean squares of raw residuals that are listed for one clause."""

MOST_FILES = 5
"""Files whose outliers are listed, of a table that was read from many."""

LARGE_PRIOR = 3.0
"""A prior that the estimates miss by more standard deviations than this is spoken of."""

MOST_SOLUTIONS = 4
"""Other solutions that are shown; the document has all."""
MOST_NUMBERS = 4
"""Numbers of another solution that are shown: unknowns that are one number first, then what differs most."""
NOTHING = 1e-9
"""Numbers that differ by less, relatively, are the same."""


def fit_sentence(solve: SolveReport) -> str | None:
    """Chi², degrees of freedom and p; without stated noise the sum of squares and sigma0."""
    if solve.cost is None or solve.dof is None or not (solve.estimates or solve.residual_summaries):
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
    if solve.robust_cost is not None:
        return f"sum of the losses {plain(solve.robust_cost, 5)}, {text}"
    return text if solve.sigma0 is None else f"{text}, sigma0 = {plain(solve.sigma0, 4)}"


def observability_sentences(found: Observability | None) -> Iterator[str]:
    """What the data do not determine, in words."""
    if found is None:
        return
    for direction in found.unobservable[:MOST_FREE]:
        yield f"not determined by the data: {direction.sentence}"
    if len(found.unobservable) > MOST_FREE:
        yield f"not determined by the data: {len(found.unobservable) - MOST_FREE} more (`--json` lists them)"
    told = {direction.sentence for direction in found.unobservable}
    for motion in found.gauge:
        if motion.sentence not in told:
            yield f"not determined by the data: {motion.sentence}"
    said = {name for direction in found.unobservable for name in direction.unknowns}
    unused = [name for name in found.unused if name not in said]
    if unused:
        yield f"in no equation: {listed(unused, MOST_NAMES)}"


def residual_sentences(solve: SolveReport) -> Iterator[str]:
    """Rows used and their rms, normalised, then as it was measured."""
    raw = solve.raw_residuals() if solve.residual_summaries else {}
    for clause, summary in solve.residual_summaries.items():
        said = raw.get(clause, RawResiduals())
        used = f"{summary.used} of {summary.rows} rows" if summary.used != summary.rows else _rows(summary.rows)
        rms = "" if summary.rms is None else f", rms {plain(summary.rms, 3)}"
        yield f"`{clause}`: {used}{rms}{_raw(said.means)}{_outliers(summary)}{_behind(said)}"


def _raw(means: tuple[RootMean, ...]) -> str:
    """The first of those that are for tables."""
    shown = [each for each in means if each.value is not None and each.brief]
    texts = [_raw_mean(each) for each in shown[:MOST_MEANS]]
    more = f" and {len(shown) - MOST_MEANS} more" if len(shown) > MOST_MEANS else ""
    return f", raw {', '.join(texts)}{more}" if texts else ""


def _behind(raw: RawResiduals) -> str:
    return f"; behind the camera: {_named_rows(raw.behind)}" if raw.behind else ""


def _raw_mean(mean: RootMean) -> str:
    unit = "" if mean.unit is None else f" {mean.unit}"
    over = "" if mean.per == OVER_ROWS else f" {'per' if mean.per in (OVER_POINTS, COORDINATE) else 'of'} {mean.per}"
    return f"{plain(mean.value or 0.0, 3)}{unit}{over}"


def _outliers(summary: ResidualSummary) -> str:
    """The rows taken for outliers, numbered as in the document, and those of the file where there is one."""
    if not summary.outliers:
        return ""
    by_file: dict[str, list[int]] = {}
    for place in summary.outlier_places:
        by_file.setdefault(place.file, []).append(place.row or 0)
    where = [f"{_named_rows(tuple(rows))} of {file}" for file, rows in islice(by_file.items(), MOST_FILES)]
    if len(by_file) > MOST_FILES:
        where.append(f"{len(by_file) - MOST_FILES} more files")
    return f"; outliers: {_named_rows(summary.outliers)}" + (f" ({', '.join(where)})" if where else "")


def _named_rows(rows: tuple[int, ...]) -> str:
    """`row 7`, `rows 7, 9 and 30 more`."""
    shown = ", ".join(str(row) for row in rows[:MOST_OUTLIERS])
    more = f" and {len(rows) - MOST_OUTLIERS} more" if len(rows) > MOST_OUTLIERS else ""
    return f"{'row' if len(rows) == 1 else 'rows'} {shown}{more}"


def prior_sentences(solve: SolveReport) -> Iterator[str]:
    """Priors that the data contradict."""
    for prior in solve.priors:
        if abs(prior.residual) > LARGE_PRIOR:
            yield (
                f"`{prior.name}` lies {plain(abs(prior.residual), 2)} standard deviations from "
                f"its prior {plain(prior.mean, 6)} ± {plain(prior.sigma, 2)}"
            )


def constraint_sentences(solve: SolveReport) -> Iterator[str]:
    """Constraints that do not hold; those that the data push against have a warning."""
    for each in solve.constraints:
        rows = f" in {_rows(len(each.violated_rows))} of `{each.over}`" if each.violated_rows else ""
        if each.violated:
            by = f"violated by {plain(each.violation, 4)}" if isfinite(each.violation) else "it has no finite value"
            yield f"constraint `{each.name}` does not hold{rows}: {by}"


def diagnostic_sentence(diagnostic: Diagnostic) -> str:
    """A diagnostic without its excerpt; an error with its place and mend."""
    said = f"{diagnostic.severity.value}[{diagnostic.code.name}]: {diagnostic.message}"
    if diagnostic.severity is not Severity.ERROR or diagnostic.place is None:
        return said
    return f"{said}, {diagnostic.place.where}: {diagnostic.mend}"


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def search_sentences(solve: SolveReport) -> Iterator[str]:
    """How many starts led where, and the other solutions that fit best; how many boxes, and the separate pieces."""
    if solve.boxes is not None:
        yield f"guaranteed bounds: {solve.boxes:,} box{'' if solve.boxes == 1 else 'es'} examined"
    for number, piece in enumerate(solve.pieces[:MOST_SOLUTIONS], 1):
        yield f"separate piece {number} of {len(solve.pieces)}{_narrowest(solve, piece)}"
    if len(solve.pieces) > MOST_SOLUTIONS:
        yield f"… and {len(solve.pieces) - MOST_SOLUTIONS} more pieces, which the document lists"
    tally = solve.starts
    if tally is not None:
        text = f"{tally.tried} starts: {tally.converged} converged, {tally.best_found} to the best fit"
        others = len(solve.alternatives)
        yield f"{text}; {others} other solution{'' if others == 1 else 's'}" if others else text
    for other in solve.alternatives[:MOST_SOLUTIONS]:
        yield _other(solve, other)
    left = len(solve.alternatives) - MOST_SOLUTIONS
    if left > 0:
        yield f"… and {left} more with larger costs, which the document lists"


def _narrowest(solve: SolveReport, piece: Piece) -> str:
    """The bounds of a piece that are narrower than those of the whole set, the narrowest first."""
    wholes: list[Estimate | DerivedValue] = [*solve.estimates, *solve.derived]
    parts: list[Estimate | DerivedValue] = [*piece.estimates, *piece.derived]
    found = []
    pairs = (zip(scalars(whole), scalars(part), strict=True) for whole, part in zip(wholes, parts, strict=True))
    for whole, part in chain.from_iterable(pairs):
        if whole.bounds is not None and part.bounds is not None:
            wide, narrow = whole.bounds[1] - whole.bounds[0], part.bounds[1] - part.bounds[0]
            if narrow < (1 - NOTHING) * wide:
                found.append((narrow / wide, part, part.bounds))
    found.sort(key=lambda each: each[0])
    texts = (f"{s.name} in {enclosed(*ends)} {unit_text(s.quantity)}".rstrip() for _, s, ends in found[:MOST_NUMBERS])
    return f": {', '.join(texts)}" if found else ""


def _other(solve: SolveReport, other: Alternative) -> str:
    cost = f"cost {plain(other.cost, 5)}"
    found = cost if other.robust_cost is None else f"sum of the losses {plain(other.robust_cost, 5)}, {cost}"
    if solve.starts is not None:
        found += f" from {other.starts} start{'' if other.starts == 1 else 's'}"
    remark = f" ({other.remark})" if other.remark else ""
    apart = sorted(_differences(solve.estimates, other.estimates), key=lambda each: each[:2])
    if not apart:
        return f"another solution, {found}{remark}"
    texts = (f"{s.name} = {plain(s.value, 5)} {unit_text(s.quantity)}".rstrip() for _, _, s in apart[:MOST_NUMBERS])
    more = len(apart) - MOST_NUMBERS
    what = "one more number that differs" if more == 1 else f"{more} more numbers that differ"
    rest = f" and {what}" if more > 0 else ""
    return f"another solution, {found}, with {', '.join(texts)}{rest}{remark}"


def _differences(best: Iterable[Estimate], other: Iterable[Estimate]) -> Iterator[tuple[bool, float, Scalar]]:
    """The numbers of ``other`` that are not those of ``best``: whether one of several of an unknown, less its relative
    difference; what is to be told first comes first in this order.
    """
    for one, another in zip(best, other, strict=True):
        theirs = tuple(scalars(another))
        for mine, its in zip(scalars(one), theirs, strict=True):
            apart = abs(its.value - mine.value)
            if its.quantity.kind is Kind.ANGLE:
                turn = 2 * pi / its.quantity.scale.factor
                apart = min(apart % turn, turn - apart % turn)
            size = max(abs(its.value), abs(mine.value))
            if size > 0 and apart > NOTHING * size:
                yield len(theirs) > 1, -apart / size, its
