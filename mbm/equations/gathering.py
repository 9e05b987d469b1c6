"""Numbers that rows take from tables: aggregates over rows, and columns sampled at a time which unknowns decide."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from typing import Protocol, TypeAlias

import numpy as np

from mbm.equations.layout import Entry, Layout, half_turns
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Component, Constant, Leaf, LiteralMember, Member, Number, Sampling, leaves
from mbm.expression.rows import Row, RowChoice
from mbm.kernels.types import Kernel
from mbm.problem import faults as problem_faults
from mbm.problem.aggregates import Aggregate, AggregateKind
from mbm.problem.rows import (
    Positions,
    TimedRows,
    column_numbers,
    interval_of,
    lookup,
    member_cells,
    places_around,
    timed_for,
)
from mbm.problem.stand_ins import stand_in
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.symbolic.types import ColumnInput
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
        if literal is None and positions is not None and len(positions) == 0:
            return positions
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


Numbers = Callable[[Indices], Floats]
"""The numbers (…, rows) at places (rows,) in the vector of all numbers, or in several: one for each row."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """Rows of a sampled table with the same keys: ``times`` (n,) ascend; ``nodes`` (n − 1, inputs) are between two."""

    times: Floats
    nodes: Floats

    def outside(self, at: Floats) -> Mask:
        """Which times lie beyond the ends."""
        return np.asarray((at < self.times[0]) | (at > self.times[-1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled:
    """The inputs of a kernel that one ``sample`` fills.

    ``parts`` are rows with the same keys, and ``part`` (rows,) says which of these each row has, -1: none. ``inputs``
    are the places of the parameters. ``places`` gives for each number of an unknown in the time its place (rows,) among
    all, ``data`` the values of its other leaves, ``coordinates`` those that move it. Beyond the span the last interval
    goes on where ``extended``, else there is no value.
    """

    sampling: Sampling
    parts: tuple[Part, ...] = field(repr=False)
    part: Indices = field(repr=False)
    inputs: Indices
    places: Mapping[int, Indices] = field(repr=False)
    data: Mapping[int, Values] = field(repr=False)
    coordinates: Indices = field(repr=False)
    extended: bool

    def at(self, numbers: Numbers, rows: Indices, *, whole: bool) -> Floats:
        """The times (…, rows) at which the table is sampled; ``whole``: ``rows`` are all rows, in order."""

        def value(leaf: Leaf) -> Values:
            place = self.places.get(id(leaf))
            if place is not None:
                return numbers(place if whole else place[rows])
            known = self.data[id(leaf)]
            return known if whole or not isinstance(known, np.ndarray) else known[rows]

        found = np.asarray(evaluate((self.sampling.at,), value)[0], dtype=np.float64)
        return np.broadcast_to(found, (*found.shape[:-1], len(rows)))

    def some(self, rows: Indices) -> Sampled:
        """The inputs of some rows."""
        return replace(
            self,
            part=self.part[rows],
            places={leaf: places[rows] for leaf, places in self.places.items()},
            data={leaf: known[rows] if isinstance(known, np.ndarray) else known for leaf, known in self.data.items()},
        )

    def inside(self, numbers: Numbers, rows: Indices) -> Mask:
        """Which rows are sampled within the span of the table; one without a time yet counts as inside."""
        at = self.at(numbers, rows, whole=True)
        beyond = np.stack([each.outside(at) for each in self.parts])
        return np.asarray(~beyond[self.part, np.arange(len(rows))] & (self.part >= 0))

    def fill(self, target: Floats, numbers: Numbers, rows: Indices, *, whole: bool = True) -> None:
        """Put the values of the rows around the times into ``target`` (…, rows, parameters)."""
        at = self.at(numbers, rows, whole=whole)
        part = self.part if whole else self.part[rows]
        for number, each in enumerate(self.parts):
            chosen = np.flatnonzero(part == number) if len(self.parts) > 1 else np.arange(len(part))
            times = at[..., chosen]
            outside = np.isnan(times) if self.extended else np.isnan(times) | each.outside(times)
            values = each.nodes[interval_of(each.times, times)]
            if outside.any():
                values[outside] = np.nan
            target[..., chosen[:, None], self.inputs] = values
        if len(self.parts) > 1:
            target[..., np.flatnonzero(part < 0)[:, None], self.inputs] = np.nan


def samplings(kernel: Kernel) -> tuple[Sampling, ...]:
    """The samples that a kernel has inputs of."""
    found = [p.sampling for p in kernel.parameters if isinstance(p, ColumnInput) and p.sampling is not None]
    return tuple(dict.fromkeys(found)) if found else ()


def sampled_inputs(
    kernel: Kernel,
    sampling: Sampling,
    given: tuple[Table | None, Positions | None, Mapping[str, Table], Mapping[str, float]],
    places: Callable[[Component], tuple[Indices, Indices]],
    *,
    extended: bool,
) -> Sampled:
    """What fills the inputs of one ``sample``.

    ``given`` are the table and the positions of the rows at hand, all tables, and the constants; ``places`` gives the
    places (rows,) of an unknown's number, and the coordinates that move it.

    Raises:
        MbmError: the table has no two different times.

    """
    table, positions, tables, constants = given
    other = tables[sampling.table]
    parts, part = timed_for(sampling, other, table, positions, 1 if positions is None else len(positions))
    inputs = [(i, p) for i, p in enumerate(kernel.parameters) if isinstance(p, ColumnInput) and p.sampling is sampling]
    found_places: dict[int, Indices] = {}
    data: dict[int, Values] = {}
    coordinates: list[Indices] = []
    known = lookup(table, positions, tables)
    for leaf in leaves((sampling.at,)):
        if isinstance(leaf, Component):
            found_places[id(leaf)], moving = places(leaf)
            coordinates.append(moving)
        elif isinstance(leaf, Constant):
            data[id(leaf)] = constants[leaf.name]
        else:
            data[id(leaf)] = float(leaf.value) if isinstance(leaf, Number) else known(leaf)
    return Sampled(
        sampling=sampling,
        parts=tuple(
            Part(times=each.times, nodes=_between(each, [(column_numbers(other, p.name), p.row) for _, p in inputs]))
            for each in parts
        ),
        part=part,
        inputs=np.array([i for i, _ in inputs], dtype=np.int64),
        places=found_places,
        data=data,
        coordinates=np.unique(np.concatenate(coordinates)) if coordinates else np.empty(0, dtype=np.int64),
        extended=extended,
    )


def _between(rows: TimedRows, inputs: list[tuple[Floats, Row]]) -> Floats:
    """The values (n − 1, inputs) of columns of a table in the rows around what is between two times."""
    around = places_around(rows.times, rows.times[:-1])
    return np.column_stack([values[rows.positions][around[side]] for values, side in inputs])
