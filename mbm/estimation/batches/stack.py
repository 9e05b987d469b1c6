"""The equations of all solves, bound at once: rows stand solve by solve, and each solve knows where its own begin.

The tables of many solves, one below the other, with the members of families numbered within each solve.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, pairwise, repeat

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache, Group
from mbm.equations.gathering import picked_members
from mbm.equations.layout import Entry, Layout
from mbm.equations.types import Indices
from mbm.estimation.batches.sets import Sets, Span
from mbm.estimation.batches.types import Errors, Which, places_of
from mbm.expression.nodes import ColumnMember, Member
from mbm.kernels.types import KernelSet
from mbm.problem import faults as problem_faults
from mbm.problem.joining import distinct
from mbm.problem.rows import Positions, member_cells
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Family, Problem
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Numbered:
    """The members of a family in T solves that each have their own.

    ``keys`` are those of all members, solve by solve; solve k has those from ``first[k]`` (T + 1,) on. ``code`` numbers
    the distinct keys. ``pairs`` are ``solve · codes + code`` of all members, ascending, and ``local`` the number of
    each within its solve.
    """

    keys: Sequence[CellKey]
    first: Indices
    code: Mapping[CellKey, int]
    pairs: Indices
    local: Indices

    def codes(self, cells: Sequence[CellKey]) -> Indices:
        """The codes (R,) of keys, -1 for those that are no member's anywhere."""
        return np.fromiter(map(self.code.get, cells, repeat(-1)), np.int64, len(cells))

    def numbers(self, solve: Indices, codes: Indices) -> Indices:
        """The numbers (R,) within solves (R,) of the members with some codes (R,); -1 where a solve has none."""
        if not len(self.pairs):
            return np.full(len(codes), -1, dtype=np.int64)
        wanted = solve * len(self.code) + codes
        at = np.maximum(np.searchsorted(self.pairs, wanted, side="right") - 1, 0)
        return np.where((codes >= 0) & (self.pairs[at] == wanted), self.local[at], -1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Arranged:
    """The tables of T solves.

    ``tables`` that are divided have their rows solve by solve: ``spans`` says which; windows share rows, unless members
    are numbered. ``families`` has the families, by the table with a row for each member, whose members differ by
    solve; ``owners`` (rows,) is then the solve of each row of a divided table.
    """

    tables: Mapping[str, Table]
    spans: Mapping[str, Span]
    families: Mapping[str, Numbered]
    owners: Mapping[str, Indices]

    def rows(self, table: str) -> Indices | int:
        """Rows of a table in each solve: (T,), or a number where all have the same ones."""
        span = self.spans.get(table)
        return len(self.tables[table]) if span is None else span.sizes

    def pick(
        self,
        entry: Entry,
        member: Member,
        table: Table | None,
        positions: Positions | None,
        tables: Mapping[str, Table],
    ) -> Indices | int:
        """The members that rows speak of, by their numbers within the solve of the row (`members.picked_members`).

        Raises:
            MbmError: a key that is no member's in that solve.

        """
        family = entry.unknown.family
        found = None if family is None else self.families.get(family.rows)
        if found is None or table is None or positions is None or not isinstance(member, ColumnMember):
            return picked_members(entry, member, table, positions, tables)
        cells = member_cells(member, table, positions, tables)
        numbers = found.numbers(self.owners[table.name][positions], found.codes(cells))
        if bool((numbers < 0).any()):
            row = int(np.argmax(numbers < 0))
            where = f"the family `{entry.unknown.name}`"
            place = table.place(int(positions[row]), member.column)
            raise MbmError(problem_faults.dangling_key(place, cells[row], where, None, entry.unknown.span))
        return numbers


def arranged(problem: Problem, sets: Sets) -> Arranged:
    """The tables of all solves of ``sets``."""
    families = {u.family.rows: u.family for u in problem.unknowns if u.family is not None}
    own = {rows: family for rows, family in families.items() if family.table in sets.spans}
    tables, spans = dict(sets.tables), {}
    for name, span in sets.spans.items():
        spans[name] = mine = _apart(span) if own else span
        table, order = sets.tables[name], mine.order
        in_place = len(order) == len(table) and bool((order == np.arange(len(order))).all())
        tables[name] = table if in_place else table.take(order)
    owners = {}
    if own:
        owners = {name: np.repeat(np.arange(sets.count), span.sizes) for name, span in spans.items()}
    for rows, family in families.items():
        if rows in own and family.column is not None:
            tables[rows], spans[rows], owners[rows] = _distinct(family, tables[family.table], owners, sets.count)
        elif family.column is not None:
            tables[rows] = distinct(tables[family.table], family, rows)
    return Arranged(
        tables=tables,
        spans=spans,
        families={rows: _numbered(tables[rows], owners[rows], sets.count) for rows in own},
        owners=owners,
    )


def _apart(span: Span) -> Span:
    """The same rows, ascending in each solve, none of them shared by solves."""
    sizes = span.sizes
    last = np.cumsum(sizes)
    solve = np.repeat(np.arange(len(sizes)), sizes)
    order = span.order[np.arange(len(solve)) + np.repeat(span.first - (last - sizes), sizes)]
    return Span(order=order[np.lexsort((order, solve))], first=last - sizes, last=last)


def _distinct(family: Family, table: Table, owners: Mapping[str, Indices], solves: int) -> tuple[Table, Span, Indices]:
    """`joining.distinct` of each solve, one below the other, and the solve of each row."""
    column = str(family.column)
    cells = table.keys(column)
    code = {cell: number for number, cell in enumerate(dict.fromkeys(cells))}
    pairs = owners[family.table] * len(code) + np.fromiter(map(code.__getitem__, cells), np.int64, len(cells))
    positions = np.sort(np.unique(pairs, return_index=True)[1])
    solve = owners[family.table][positions]
    last = np.cumsum(np.bincount(solve, minlength=solves))
    first = np.concatenate([np.zeros(1, dtype=np.int64), last[:-1]])
    made = replace(
        table.take(positions),
        name=family.rows,
        columns={each: table.columns[each].take(positions) for each in family.names},
        rows=np.arange(len(positions)) - first[solve] + 1,
        key=column,
        groups={},
    )
    return made, Span(order=np.arange(len(positions)), first=first, last=last), solve


def _numbered(table: Table, solve: Indices, solves: int) -> Numbered:
    """The members for the rows of a table, which belong to solves (rows,), ascending."""
    keys = table.keys()
    code = {cell: number for number, cell in enumerate(dict.fromkeys(keys))}
    first = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(np.bincount(solve, minlength=solves))])
    pairs = solve * len(code) + np.fromiter(map(code.__getitem__, keys), np.int64, len(keys))
    order = np.argsort(pairs, kind="stable")
    local = np.arange(len(keys)) - first[solve]
    return Numbered(keys=keys, first=first, code=code, pairs=pairs[order], local=local[order])


ROWS_AT_ONCE = 60_000
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
