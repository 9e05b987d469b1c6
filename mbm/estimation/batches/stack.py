"""The equations of all solves, bound at once: rows stand solve by solve, and each solve knows where its own begin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.layout import Layout
from mbm.equations.types import Indices
from mbm.estimation.batches.arranged import Arranged
from mbm.estimation.batches.types import Errors, Which
from mbm.kernels.types import KernelSet
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.values import dataclass

ROWS_AT_ONCE = 30_000
"""Rows of a slice: what is worked on stays in the processor's cache, and there are enough slices for all threads."""

FEW_COORDINATES = 8
"""Coordinates up to which that many rows are worked on at once: their Jacobians are dense."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stack:
    """The equations of T solves.

    ``equations`` hold the rows of all of them; ``first`` and ``rows`` (groups, T) say where the rows of each solve
    begin in a group, and how many there are, in groups of residuals, then of constraints; windows share rows. A group
    without a table has one row for all solves. ``derived`` are the groups of the derived quantities, ``errors`` those
    in measured columns, which ``equations`` eliminate (None: there are none).
    """

    equations: Assembled
    first: Indices
    rows: Indices
    derived: tuple[tuple[Group, ...], ...]
    arranged: Arranged
    errors: Errors | None = None

    @property
    def tables(self) -> Mapping[str, Table]:
        """The tables, those that are divided in the order of the solves."""
        return self.arranged.tables

    def exactly(self) -> Stack:
        """The same with measured values taken as exact and weighted as they are, to find starts with."""
        if self.equations.likely:
            return replace(self, equations=self.equations.uncorrected())
        return self if self.errors is None else replace(self, equations=self.errors.exact, errors=None)

    @property
    def solves(self) -> int:
        """T."""
        return int(self.rows.shape[1])

    def lines(self, group: int, which: Which) -> tuple[Indices, Indices | slice]:
        """Solve (R,), from 0, and row (R,) in a group of each row of some solves, a slice where that is one."""
        first, rows = self.first[group, places_of(which)], self.rows[group, places_of(which)]
        solve = np.repeat(np.arange(len(rows)), rows)
        if len(rows) and bool((first[1:] == first[:-1] + rows[:-1]).all()):
            return solve, slice(int(first[0]), int(first[-1] + rows[-1]))
        return solve, first[solve] + np.arange(len(solve)) - (np.cumsum(rows) - rows)[solve]

    def units(self, which: Which, acting: Sequence[bool]) -> tuple[Indices, Indices, Indices]:
        """Solve (U,), ascending, group (U,) and number (U,) of the units of some solves, of the ``acting`` groups."""
        solves, groups, units = [], [], []
        for number, group in enumerate(self.equations.groups):
            if acting[number]:
                solve, lines = self.lines(number, which)
                rows = np.arange(lines.start, lines.stop) if isinstance(lines, slice) else lines
                each = len(group.whiteners)
                solves.append(np.repeat(solve, each))
                groups.append(np.full(len(rows) * each, number))
                units.append((group.first_unit + rows[:, None] * each + np.arange(each)).ravel())
        if len(solves) == 1:
            return solves[0], groups[0], units[0]
        solve = np.concatenate(solves)
        order = np.argsort(solve, kind="stable")
        return solve[order], np.concatenate(groups)[order], np.concatenate(units)[order]

    def slices(self, which: Which) -> list[slice]:
        """Stretches of some solves with about as many rows each, fewer where there are many unknowns."""
        most = max(ROWS_AT_ONCE * FEW_COORDINATES // max(self.equations.dimension, FEW_COORDINATES), 1)
        number = np.cumsum(self.rows[:, places_of(which)].sum(axis=0)) // most
        cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(which)]
        return [slice(begin, end) for begin, end in pairwise(cuts) if end > begin]

    def ranges(self) -> list[range]:
        """All solves in slices."""
        return [range(part.start, part.stop) for part in self.slices(range(self.solves))]

    @property
    def residuals(self) -> Indices:
        """Scalar residuals of each solve (T,)."""
        return _scalars(self.equations.groups, self.rows)

    @property
    def limits(self) -> Indices:
        """Scalar constraints of each solve (T,)."""
        return _scalars(self.equations.constraints, self.rows[len(self.equations.groups) :])


def _scalars(groups: Sequence[Group], rows: Indices) -> Indices:
    """Scalars (T,) that the groups have in each solve, of ``rows``, those of further groups behind them."""
    outputs = np.array([group.kernel.outputs for group in groups], dtype=np.int64)
    return np.asarray(outputs @ rows[: len(groups)])


def stack(
    problem: Problem, kernels: KernelSet, solves: int, tables: Arranged, layout: Layout, cache: EvaluationCache
) -> Stack:
    """The equations of all ``solves``, with one layout for all; measured values are taken as exact.

    Raises:
        MbmError: weights that are none, or keys that are no members, in some row.

    """
    binder = Binder(problem=problem, layout=layout, tables=tables.tables, cache=cache, pick=tables.pick)
    equations = blank(binder, kernels, corrected=False)
    groups = (*equations.groups, *equations.constraints)
    first = np.zeros((len(groups), solves), dtype=np.int64)
    rows = np.ones((len(groups), solves), dtype=np.int64)
    for number, group in enumerate(groups):
        table_name = problem.blocks[group.kernel.owner].table
        span = None if table_name is None else tables.spans.get(table_name)
        if span is None or group.positions is None:
            rows[number] = group.rows
        else:
            first[number] = np.searchsorted(group.positions, span.first)
            rows[number] = np.searchsorted(group.positions, span.last) - first[number]
    derived = tuple(binder.derived(kernels, owner) for owner in range(len(problem.derived)))
    beside = (*equations.informing().groups, *equations.uncorrected().groups) if equations.likely else ()
    for group in (*groups, *beside, *chain.from_iterable(derived)):
        cache.stream(group.number, group.kernel)  # made here, so that threads find it there
    return Stack(equations=equations, first=first, rows=rows, derived=derived, arranged=tables)


def places_of(which: Which) -> Indices | slice:
    """What picks some solves from arrays over all."""
    return slice(which.start, which.stop) if isinstance(which, range) else which
