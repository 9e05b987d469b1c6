"""Columns that are sampled at a time which unknowns decide: the two rows around it are found before each evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Component, Constant, Leaf, Number, Sampling, leaves
from mbm.expression.rows import Row
from mbm.kernels.types import Kernel
from mbm.problem.rows import Positions, TimedRows, column_numbers, interval_of, lookup, places_around, timed_for
from mbm.problem.tables import Table
from mbm.symbolic.types import ColumnInput
from mbm.values import dataclass

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
