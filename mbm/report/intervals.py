"""Estimates and derived quantities → their coverage intervals, in the unit that is shown. The table of intervals: a
line for each scalar, with its coverage factor and effective degrees of freedom.

A linear interval is value ± U with U = k·sigma, and k the quantile of Student's t for the effective degrees of freedom.
Where a hard limit lies within, the interval is the shortest that holds as much of the distribution between the limits;
where curvature misplaces the ends, it is that of the profile of the cost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from enum import StrEnum
from itertools import islice
from math import inf, isfinite, isinf, nan
from typing import Any

import numpy as np

from mbm.estimation.uncertainty.student import coverage_factors, shortest
from mbm.problem.naming import key_words
from mbm.report.columns import aligned, laid_out, left, right
from mbm.report.digits import measured, plain
from mbm.report.elements import factors, in_unit, scalars, shown_sigma, shown_values, unit_text
from mbm.report.encode import numbers, objects
from mbm.report.types import DerivedValue, Estimate, Floats, Mask, SolveReport
from mbm.text.shown import Paint, Style
from mbm.values import dataclass


class IntervalKind(StrEnum):
    """How an interval was found."""

    LINEAR = "t"
    PROFILE = "profile"
    LIMITED = "limited"


KINDS = tuple(IntervalKind)
"""Kinds by number."""

UP_TO = 1e-9
"""Share of the length of an interval that the way from the estimate to a limit may differ from the limit by."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intervals:
    """Of the scalars of an estimate or derived quantity, arrays of the shape of its sigmas, in the unit shown.

    ``dof`` are the effective degrees of freedom, ``k`` the coverage factors, ``expanded`` the expanded uncertainties
    k·sigma, ``low`` and ``high`` the ends of the intervals (infinite where a profile has none), ``kind`` numbers of
    `KINDS`. NaN where no standard deviation is known.
    """

    dof: Floats
    k: Floats
    expanded: Floats
    low: Floats
    high: Floats
    kind: np.ndarray

    def names(self) -> np.ndarray:
        """The words for the kinds, None where there is no interval."""
        nothing = np.isnan(self.low) & np.isnan(self.high)
        words = np.array([*(each.value for each in KINDS), None], dtype=object)
        return np.asarray(words[np.where(nothing, len(KINDS), self.kind)])

    def at(self, place: tuple[int, ...]) -> Intervals:
        """A part along the leading axes."""
        every = {each.name: np.asarray(getattr(self, each.name)[place]) for each in fields(self)}
        return replace(self, **every)

    def flat(self) -> Intervals:
        """The same along one axis."""
        return replace(self, **{each.name: np.ravel(getattr(self, each.name)) for each in fields(self)})


@np.errstate(all="ignore")
def level_of(given: object, own: float) -> float:
    """The coverage probability that a caller gives; None: ``own``, that of the solve.

    Raises:
        ValueError: it is no number between 0 and 1.

    """
    if given is None:
        return own
    try:
        level = nan if isinstance(given, str | bytes | bool) else float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        level = nan
    if not 0.0 < level < 1.0:
        message = f"the level of an interval is a number between 0 and 1, such as 0.95 for 95 %, and {given!r} is not"
        raise ValueError(message)
    return level


def intervals(item: Estimate | DerivedValue, level: float) -> Intervals:
    """The intervals of coverage probability ``level``."""
    values, sigma = shown_values(item), shown_sigma(item)
    spread = item.spread
    known = np.isfinite(sigma)
    dof, inflation = np.full(sigma.shape, np.inf), np.ones(sigma.shape)
    if spread is not None:
        fixed = item.fixed if isinstance(item, Estimate) else np.zeros(sigma.shape, dtype=bool)
        dof, inflation = np.where(fixed, np.inf, spread.dof), np.where(fixed, 1.0, spread.inflation)
    k = np.where(known, coverage_factors(level, dof) * inflation, np.nan)
    expanded = k * sigma
    found = Intervals(
        dof=np.where(known, dof, np.nan),
        k=k,
        expanded=expanded,
        low=np.array(values - expanded),
        high=np.array(values + expanded),
        kind=np.zeros(sigma.shape, dtype=np.int64),
    )
    if spread is not None:
        _followed(item, found, values, level)
        _limited(item, found, values, sigma, level)
    return found


def _followed(item: Estimate | DerivedValue, found: Intervals, values: Floats, level: float) -> None:
    """Put in the intervals of profiles."""
    spread = item.spread
    if spread is None or spread.ends is None:
        return
    below, above = (np.asarray(each / factors(item.quantity)) for each in spread.ends(level))
    which = ~np.isnan(below)
    found.low[which], found.high[which] = (values - below)[which], (values + above)[which]
    found.kind[which] = KINDS.index(IntervalKind.PROFILE)


def _limited(item: Estimate | DerivedValue, found: Intervals, values: Floats, sigma: Floats, level: float) -> None:
    """Put in the intervals of values that a limit keeps from spreading as far as they would."""
    spread = item.spread
    if spread is None or spread.lower is None or spread.upper is None:
        return
    lower, upper = (in_unit(item.quantity, np.asarray(each)) for each in (spread.lower, spread.upper))
    followed = found.kind == KINDS.index(IntervalKind.PROFILE)
    _up_to(found, followed, lower, upper)
    scale = sigma * spread.inflation
    near = ~followed & ((found.low < lower) | (found.high > upper))
    for place in np.argwhere((scale > 0.0) & near & (lower < upper)):
        at = tuple(place)
        down, up = ((limit[at] - values[at]) / scale[at] for limit in (lower, upper))
        low, high = shortest(float(down), float(up), level, float(spread.dof[at]))
        # Up to a limit, the end is the limit itself, not what is left of it by a step there and back.
        found.low[at] = lower[at] if low == down else values[at] + low * scale[at]
        found.high[at] = upper[at] if high == up else values[at] + high * scale[at]
        found.kind[at] = KINDS.index(IntervalKind.LIMITED)


@np.errstate(invalid="ignore")  # an end at infinity is at no limit
def _up_to(found: Intervals, which: Mask, lower: Floats, upper: Floats) -> None:
    """Intervals that are followed up to a limit, or beyond, end at the limit itself."""
    rounding = UP_TO * (found.high - found.low)
    finite = which & np.isfinite(rounding)
    down, up = finite & (found.low <= lower + rounding), finite & (found.high >= upper - rounding)
    found.low[down], found.high[up] = lower[down], upper[up]
    found.kind[down | up] = KINDS.index(IntervalKind.LIMITED)


@np.errstate(all="ignore")
def may_be_cut(item: Estimate | DerivedValue, level: float) -> bool:
    """Whether a hard limit is within twice the linear interval of some number, or holds it."""
    spread = item.spread
    if spread is None or spread.lower is None or spread.upper is None:
        return False
    values = shown_values(item)
    reach = 2.0 * coverage_factors(level, spread.dof) * spread.inflation * shown_sigma(item)
    lower, upper = (in_unit(item.quantity, np.asarray(each)) for each in (spread.lower, spread.upper))
    held = item.at_bound if isinstance(item, Estimate) else None
    return (held is not None and bool(held.any())) or bool(((values - reach < lower) | (values + reach > upper)).any())


def interval_document(found: Intervals) -> dict[str, Any]:
    """What documents say of intervals: of several numbers, one `dof`, `k` or `interval_kind` that all of them have."""
    return {
        "dof": _single(objects(found.dof)),
        "k": _single(objects(found.k)),
        "U": numbers(found.expanded),
        "interval": _pairs(found.low, found.high),
        "interval_kind": _single(found.names()),
    }


def _pairs(low: Floats, high: Floats) -> Any:
    """[low, high] for each; None where nothing is known, and in place of an end that there is not."""
    found = np.stack([low, high], axis=-1)
    if bool(np.isfinite(found).all()):
        return found.tolist()
    if np.ndim(low) == 0:
        return None if bool(np.isnan(found).all()) else numbers(found)
    return [_pairs(*each) for each in zip(low, high, strict=True)]


def _single(values: np.ndarray) -> Any:
    """One value where all are the same, else (nested) lists."""
    flat = np.ravel(values).tolist()
    return flat[0] if flat and flat.count(flat[0]) == len(flat) else values.tolist()


MOST_LINES = 60
"""Lines that are shown unless all are asked for."""

ENDS_APART = 4.0
"""Standard deviations between the ends of a 95 % interval; they give the digits where it is not linear."""

MOST_CUT = 4
"""Intervals that limits cut, told one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntervalLine:
    """The interval of a scalar as text: its ends with the digits of the standard deviation, or of their distances."""

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
            sigma = scalar.sigma if kind == IntervalKind.LINEAR else nan
            yield IntervalLine(
                name=scalar.name,
                low=_end(low, sigma if isfinite(sigma) else _apart(low, high, scalar.value)),
                high=_end(high, sigma if isfinite(sigma) else _apart(high, low, scalar.value)),
                unit=unit_text(scalar.quantity),
                k=f"{k:.2f}" if isfinite(k) else "–",
                dof="∞" if isinf(dof) else f"{dof:.1f}".removesuffix(".0") if isfinite(dof) else "–",
                kind=kind,
            )


def _apart(end: float, other: float, value: float) -> float:
    """A standard deviation for the digits of an end: by how far it is from the other one, or from the value if that has
    no end, and two digits of itself at least.
    """
    whole = abs(other - end) if isfinite(other) else 2.0 * abs(end - value)
    return min(whole / ENDS_APART, abs(end) if abs(end) > UP_TO * whole else inf)


def _end(value: float, spread: float) -> str:
    """An end with the digits that a standard deviation of ``spread`` allows."""
    if not isfinite(value):
        return "∞" if value > 0 else "-∞"
    return measured(value, spread, exact=False).alone if 0.0 < spread < inf else plain(value, 6)
