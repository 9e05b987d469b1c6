"""Aggregates over the rows of a table: what they come to, and how they vary with the unknowns.

Which members of a family the rows of a table speak of.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Protocol, TypeAlias

import numpy as np

from mbm.equations.layout import Entry, Layout, half_turns
from mbm.equations.types import Floats, Indices
from mbm.expression.nodes import LiteralMember, Member
from mbm.expression.rows import RowChoice
from mbm.problem import faults as problem_faults
from mbm.problem.aggregates import Aggregate, AggregateKind
from mbm.problem.rows import Positions, member_cells
from mbm.problem.stand_ins import stand_in
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

MemberPicker: TypeAlias = Callable[[Entry, Member, Table | None, Positions | None, Mapping[str, Table]], Indices | int]
"""Numbers of members as `picked_members` gives them."""


def picked_members(
    entry: Entry, member: Member, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> Indices | int:
    """Numbers (from 0) of the members that ``member`` names, for each row at ``positions``.

    Raises:
        MbmError: a key that is no member's.

    """
    where = f"the family `{entry.unknown.name}`"
    if isinstance(member, LiteralMember):
        literal = entry.index.get(member.key)
        if literal is None:
            raise MbmError(problem_faults.dangling_key(entry.unknown.span, member.key, where, None, None))
        return literal
    cells = member_cells(member, table, positions, tables)
    found = list(map(entry.index.get, cells))
    if None in found:
        row = found.index(None)
        if table is None or positions is None or member.row is not RowChoice.EACH:
            raise MbmError(problem_faults.dangling_key(entry.unknown.span, cells[row], where, None, None))
        place = table.place(int(positions[row]), member.column)
        raise MbmError(problem_faults.dangling_key(place, cells[row], where, None, entry.unknown.span))
    return np.array(found, dtype=np.int64)


class Rows(Protocol):
    """A kernel bound to the rows of an aggregate."""

    @property
    def reached(self) -> Indices:
        """The coordinates that the rows depend on."""
        ...

    def values(self, numbers: Floats) -> Floats:
        """The values (rows, 1) at all numbers (N,)."""
        ...

    def dense_slopes(self, numbers: Floats, columns: Indices, width: int) -> Iterator[tuple[slice, Floats]]:
        """Their derivatives (some, 1, width), a part of the rows at a time: which ones, and theirs."""
        ...


def aggregated(kind: AggregateKind, values: Floats, level: float = 0.5) -> float:
    """What the values (n,) come to; NaN where one is, and of no values (but there are 0 of them)."""
    if kind is AggregateKind.COUNT:
        return float(values.sum())
    if not len(values) or bool(np.isnan(values).any()):
        return float("nan")
    match kind:
        case AggregateKind.MEAN:
            return float(values.mean())
        case AggregateKind.RMS:
            return float(np.sqrt(np.mean(np.square(values))))
        case AggregateKind.MINIMUM:
            return float(values.min())
        case AggregateKind.MAXIMUM:
            return float(values.max())
        case AggregateKind.MEDIAN | AggregateKind.QUANTILE:
            return float(np.quantile(values, level))


def weights(kind: AggregateKind, values: Floats, level: float = 0.5) -> Floats:
    """How the aggregate varies with each of the values (n,); where rows change places, as they stand now.

    An rms of 0 has no derivative, as the length of a vector has none there: NaN.
    """
    count = len(values)
    result = np.zeros(count)
    if kind is AggregateKind.COUNT or not count:
        return result
    match kind:
        case AggregateKind.MEAN:
            result[:] = 1 / count
        case AggregateKind.RMS:
            result[:] = values / (count * aggregated(kind, values))
        case AggregateKind.MINIMUM:
            result[np.argmin(values)] = 1.0
        case AggregateKind.MAXIMUM:
            result[np.argmax(values)] = 1.0
        case AggregateKind.MEDIAN | AggregateKind.QUANTILE:
            order, place = np.argsort(values, kind="stable"), (count - 1) * level
            before = min(int(place), count - 1)
            result[order[before]] += 1.0 - (place - before)
            result[order[min(before + 1, count - 1)]] += place - before
    return result


def aggregate_entry(problem: Problem, layout: Layout, name: str) -> Entry:
    """Where the number of an aggregate stands: behind those of all unknowns."""
    place = next(i for i, each in enumerate(problem.aggregates) if each.name == name)
    unknown = stand_in(problem.aggregates[place])
    offset, first = len(layout.start) + place, len(layout.number) + place
    return Entry(unknown=unknown, offset=offset, first=first, keys=None, index={})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gathered:
    """The aggregates that a kernel takes: their places among ``count`` of them, and the groups of their rows."""

    count: int
    places: tuple[int, ...]
    aggregates: tuple[Aggregate, ...]
    groups: tuple[tuple[Rows, ...], ...] = field(repr=False)

    @property
    def touched(self) -> Indices:
        """The coordinates that the rows depend on."""
        found = [group.reached for groups in self.groups for group in groups]
        return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *found]))

    def extended(self, numbers: Floats) -> Floats:
        """The numbers of all unknowns (N,), and behind them those of the aggregates; NaN for those not taken."""
        behind = np.full(self.count, np.nan)
        for place, aggregate, groups in zip(self.places, self.aggregates, self.groups, strict=True):
            values = np.concatenate(_values(aggregate, groups, numbers))
            behind[place] = aggregated(aggregate.kind, values, aggregate.level)
        return np.concatenate([numbers, behind])

    def chained(self, numbers: Floats, columns: Indices, width: int) -> Callable[[Floats], Floats]:
        """What makes derivatives (…, width + count) by the unknowns and the aggregates those by the unknowns alone."""
        slopes = np.zeros((self.count, width))
        for place, aggregate, groups in zip(self.places, self.aggregates, self.groups, strict=True):
            parts = _values(aggregate, groups, numbers)
            whole = weights(aggregate.kind, np.concatenate(parts), aggregate.level)
            own = np.split(whole, np.cumsum([len(part) for part in parts])[:-1])
            for group, weight in zip(groups, own, strict=True):
                for rows, dense in group.dense_slopes(numbers, columns, width):
                    slopes[place] += weight[rows] @ dense[:, 0]
        taken = np.zeros(self.count, dtype=bool)
        taken[list(self.places)] = True
        return lambda dense: dense[..., :width] + dense[..., width:][..., taken] @ slopes[taken]


def _values(aggregate: Aggregate, groups: Sequence[Rows], numbers: Floats) -> list[Floats]:
    """The values of the rows (n,) of each group."""
    found = [np.empty(0), *(group.values(numbers)[:, 0].copy() for group in groups)]
    return [half_turns(part) if aggregate.angle else part for part in found[1:] or found]
