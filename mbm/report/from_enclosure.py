"""Enclosure → SolveReport: guaranteed bounds with their names and units."""

from __future__ import annotations

import numpy as np

from mbm.equations.layout import Entry, half_turns
from mbm.estimation.intervals.network import Enclosure, Ranges
from mbm.problem.types import Derived, Problem, UnknownKind
from mbm.report.numbers import nothing_known
from mbm.report.quantities import derived_quantity, keys_over, quantity_of, repeated
from mbm.report.types import DerivedValue, Estimate, Floats, Piece, SolveReport, SolveStatus

_ENCLOSED = "every solution lies within the bounds"
_EMPTY = "no values meet all observations within their bounds and all constraints"
_NO_FIT = "interval methods fit nothing"


def enclosure_report(problem: Problem, found: Enclosure) -> SolveReport:
    """One solve by interval methods as a report."""
    status, message = SolveStatus.CONVERGED, _ENCLOSED
    if found.whole is None:
        status, message = SolveStatus.INFEASIBLE, _EMPTY
    elif not found.reached:
        status = SolveStatus.NOT_CONVERGED
        message = f"the bounds hold, but may be wider than `:width` asks: the search ended at {found.boxes:,} boxes"
    numbers = _nothing(found) if found.whole is None else found.whole
    return SolveReport(
        status=status,
        message=message,
        key=dict(found.key),
        method=found.method,
        boxes=found.boxes,
        seconds=found.seconds,
        reasons=nothing_known(_NO_FIT),
        estimates=_estimates(problem, found, numbers),
        derived=_derived(problem, found, numbers),
        pieces=tuple(
            Piece(estimates=_estimates(problem, found, each), derived=_derived(problem, found, each))
            for each in found.pieces
        ),
    )


def _nothing(found: Enclosure) -> Ranges:
    """The numbers of an empty set: there are none."""
    scalars = sum(len(w.nodes) * (1 if w.positions is None else len(w.positions)) for w in found.wanted)
    numbers, derived = np.full(len(found.layout.start), np.nan), np.full(scalars, np.nan)
    return Ranges(low=numbers, high=numbers, derived_low=derived, derived_high=derived)


def _estimates(problem: Problem, found: Enclosure, numbers: Ranges) -> tuple[Estimate, ...]:
    return tuple(_estimate(problem, found, entry, numbers) for entry in found.layout.entries)


def _estimate(problem: Problem, found: Enclosure, entry: Entry, numbers: Ranges) -> Estimate:
    unknown = entry.unknown
    leading = () if entry.keys is None else (entry.members,)
    steps = () if entry.steps is None else (len(entry.steps),)
    shape = (*leading, *(unknown.shape if not unknown.dimension else (unknown.freedom,)))
    low, high = numbers.low[entry.range], numbers.high[entry.range]
    value = _middle(low, high)
    if unknown.kind is UnknownKind.ANGLE:
        value = half_turns(value)
    return Estimate(
        quantity=quantity_of(problem, unknown),
        value=repeated(value.reshape((*leading, *unknown.shape)), steps),
        sigma=None,
        fixed=repeated(found.layout.fixed[entry.coordinates].reshape(shape), steps),
        keys=entry.keys if entry.steps is None else entry.steps,
        per=unknown.family.rows if unknown.family is not None else None,
        reason=_EMPTY if found.whole is None else None,
        bounds=repeated(np.stack([low, high], axis=-1).reshape((*shape, 2)), steps),
    )


def _middle(low: Floats, high: Floats) -> Floats:
    """The middle of bounds; NaN where there is none."""
    with np.errstate(invalid="ignore"):
        middle = low / 2 + high / 2
    return np.asarray(np.where(np.isfinite(low) & np.isfinite(high), middle, np.nan))


def _derived(problem: Problem, found: Enclosure, numbers: Ranges) -> tuple[DerivedValue, ...]:
    """The derived quantities: what the cases of each give for their rows, in the order of the table."""
    result, place = [], 0
    for owner, derived in enumerate(problem.derived):
        rows = 1 if derived.table is None else len(found.tables[derived.table])
        size = len(derived.cases[0].values) if derived.cases else 1
        ends = np.full((rows, size, 2), np.nan)
        for wanted in (each for each in found.wanted if each.owner == owner):
            which = slice(None) if wanted.positions is None else wanted.positions
            count = (rows if wanted.positions is None else len(wanted.positions)) * size
            for side, values in enumerate((numbers.derived_low, numbers.derived_high)):
                ends[which, :, side] = values[place : place + count].reshape(-1, size)
            place += count
        result.append(_derived_value(problem, found, derived, ends))
    return tuple(result)


def _derived_value(problem: Problem, found: Enclosure, derived: Derived, ends: Floats) -> DerivedValue:
    leading = () if derived.table is None else (len(ends),)
    shape = (*leading, *derived.shape)
    over, keys = keys_over(derived, found.tables)
    value = _middle(ends[..., 0], ends[..., 1])
    return DerivedValue(
        quantity=derived_quantity(problem, derived),
        value=(half_turns(value) if derived.turns else value).reshape(shape),
        sigma=None,
        keys=keys,
        over=over,
        reason=_EMPTY if found.whole is None else None,
        bounds=ends.reshape((*shape, 2)),
    )
