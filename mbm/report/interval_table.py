"""The table of intervals: a line for each scalar, with its coverage factor and effective degrees of freedom."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from math import inf, isfinite, isinf

import numpy as np

from mbm.problem.naming import key_words
from mbm.report.columns import aligned, laid_out, left, right
from mbm.report.digits import measured, plain
from mbm.report.elements import scalars, unit_text
from mbm.report.intervals import IntervalKind, intervals, may_be_cut
from mbm.report.types import DerivedValue, Estimate, SolveReport
from mbm.text.shown import Paint, Style
from mbm.values import dataclass

MOST_LINES = 60
"""Lines that are shown unless all are asked for."""

ENDS_APART = 4.0
"""Standard deviations between the ends of a 95 % interval; they give the digits where none is known."""

MOST_CUT = 4
"""Intervals that limits cut, told one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntervalLine:
    """The interval of a scalar as text: its ends with the digits of the standard deviation or of its length."""

    name: str
    low: str
    high: str
    unit: str
    k: str
    dof: str
    kind: str


def interval_lines(solves: Sequence[SolveReport], paint: Paint, full: bool) -> Iterator[str]:
    """The intervals of all estimates and derived quantities that have one, solve after solve."""
    every = ((key_words(solve.key), line) for solve in solves for line in lines_of(solve))
    lines = list(every if full else islice(every, MOST_LINES + 1))
    shown = lines if full else lines[:MOST_LINES]
    levels = dict.fromkeys(f"{plain(100 * solve.coverage, 6)} %" for solve in solves[:1])
    yield f"{next(iter(levels), '')} intervals".lstrip()
    rows = [(f"{key}: {a.name}" if key else a.name, a.low, a.high, a.unit, a.k, a.dof) for key, a in shown]
    columns = laid_out(rows, (left, aligned, aligned, left, aligned, right))
    for (_, line), (name, low, high, unit, k, dof) in zip(shown, columns, strict=True):
        note = f"  {paint(line.kind, Style.QUIET)}" if line.kind != IntervalKind.LINEAR else ""
        yield f"  {paint(name, Style.HEADING)}  {low} … {high}  {unit}  k = {k}  dof = {dof}{note}"
    if len(lines) > len(shown):
        yield paint("  … and more (-v shows all; --estimates and --json have them too)", Style.QUIET)


def cut_sentences(solve: SolveReport) -> Iterator[str]:
    """The intervals of a solve that a hard limit cuts, in words."""
    every: tuple[Estimate | DerivedValue, ...] = (*solve.estimates, *solve.derived)
    near = [item for item in every if may_be_cut(item, solve.coverage)]
    cut = [line for line in lines_of(solve, near) if line.kind == IntervalKind.LIMITED]
    for line in cut[:MOST_CUT]:
        interval = f"{line.low} … {line.high} {line.unit}".rstrip()
        yield f"a hard limit cuts the {plain(100 * solve.coverage, 6)} % interval of `{line.name}`: {interval}"
    if len(cut) > MOST_CUT:
        yield f"… and of {len(cut) - MOST_CUT:,} more numbers (`--intervals`)"


def lines_of(solve: SolveReport, items: Iterable[Estimate | DerivedValue] | None = None) -> Iterator[IntervalLine]:
    """The intervals of a solve, or of some of its items, but of what was fixed or has none."""
    every: tuple[Estimate | DerivedValue, ...] = (*solve.estimates, *solve.derived)
    for item in every if items is None else items:
        found = intervals(item, solve.coverage)
        parts = (found.dof, found.k, found.low, found.high, found.names())
        columns = (np.ravel(part).tolist() for part in parts)
        for scalar, dof, k, low, high, kind in zip(scalars(item), *columns, strict=True):
            if kind is None or scalar.fixed:
                continue
            spread = scalar.sigma if isfinite(scalar.sigma) else (high - low) / ENDS_APART
            yield IntervalLine(
                name=scalar.name,
                low=_end(low, spread),
                high=_end(high, spread),
                unit=unit_text(scalar.quantity),
                k=f"{k:.2f}" if isfinite(k) else "–",
                dof="∞" if isinf(dof) else f"{dof:.1f}".removesuffix(".0") if isfinite(dof) else "–",
                kind=kind,
            )


def _end(value: float, spread: float) -> str:
    """An end with the digits that a standard deviation of ``spread`` allows."""
    if not isfinite(value):
        return "∞" if value > 0 else "-∞"
    return measured(value, spread, exact=False).alone if 0.0 < spread < inf else plain(value, 6)
