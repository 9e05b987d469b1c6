"""``for-each``: one problem for each combination of key values that occurs, with the rows that belong to it.

Rows of a table that share the cells of some columns, all groups found at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations import faults
from mbm.equations.types import Indices
from mbm.problem.requests import Window
from mbm.problem.rows import Positions
from mbm.problem.tables import CellKey, Column, Table
from mbm.problem.types import Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.windows import Windows

MAXIMUM_SOLVES = 1_000_000
"""Combinations of keys from different tables that are tried; rows of one table that has all columns are not limited."""

MAXIMUM_WINDOWS = 100_000
"""Windows that are tried: more than anybody looks at, and a slip in the step shows at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selection:
    """The tables of one solve, and the key values that picked them; ``rows`` counts those of a window, None without."""

    key: Mapping[str, CellKey]
    tables: Mapping[str, Table]
    rows: int | None = None


def selections(problem: Problem, tables: Mapping[str, Table]) -> tuple[int, Iterator[Selection]]:
    """How many solves there are, and their tables one after the other, in the order in which the keys first occur.

    Tables without any of the columns enter whole, and so do grids. A combination occurs if some table that has all the
    columns holds it; where no table has all of them, every combination of the values that occur is tried. Each
    combination has windows of its own, from its first row to its last.

    Raises:
        MbmError: more solves than can be meant, or a window's column without a number in some row.

    """
    columns, window = problem.request.for_each, problem.request.window
    if not columns and window is None:
        return 1, iter((Selection(key={}, tables=tables),))
    # Loaded by problems with many solves only, so that the others start at once.
    from mbm.equations.selected import SelectedTables, column_families
    from mbm.equations.windows import windows

    families = column_families(problem)
    sequence = problem.sequence
    base = {name: table for name, table in tables.items() if name not in families}
    if sequence is not None:
        base.pop(sequence.reached)
    grids = {derived.grid.table for derived in problem.derived if derived.grid is not None}
    keyed = {name: table for name, table in base.items() if name not in grids}
    chosen = list(_chosen(columns, keyed))
    if window is None:
        made = (Selection(key=key, tables=SelectedTables(base, rows, families, sequence)) for key, rows in chosen)
        return len(chosen), made
    slid = [(key, windows(problem, window, keyed, rows)) for key, rows in chosen]
    count = too_many(window, sum(each.count for _, each in slid))
    return count, (selection for key, each in slid for selection in _slid(key, each, base, problem))


def too_many(window: Window, count: int) -> int:
    """The number of windows.

    Raises:
        MbmError: they are more than can be meant.

    """
    if count > MAXIMUM_WINDOWS:
        raise MbmError(faults.too_many_windows(window.span, count, MAXIMUM_WINDOWS))
    return count


def _slid(
    key: Mapping[str, CellKey], slid: Windows, base: Mapping[str, Table], problem: Problem
) -> Iterator[Selection]:
    from mbm.equations.selected import SelectedTables, column_families

    families = column_families(problem)
    for end, positions, rows in slid.each():
        tables = SelectedTables(base, positions, families, problem.sequence)
        yield Selection(key={**key, slid.column: end}, tables=tables, rows=rows)


def _chosen(
    columns: tuple[str, ...], tables: Mapping[str, Table]
) -> Iterator[tuple[Mapping[str, CellKey], Mapping[str, Positions]]]:
    """Each combination of keys with the positions of its rows in the tables that have one of the columns."""
    if not columns:
        yield {}, {}
        return
    found = divided(columns, tables)
    for number, combination in enumerate(found.combinations):
        positions = {name: part.positions(number) for name, part in found.parts.items()}
        yield dict(zip(columns, combination, strict=True)), positions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """The rows of one table by solve: ``group`` (solves,) of ``groups``, -1 where a solve has none of its rows."""

    groups: Groups
    group: Indices

    @property
    def sizes(self) -> Indices:
        """Rows of each solve (solves,)."""
        every = np.append(np.diff(self.groups.first), 0)
        return np.asarray(every[self.group])

    def positions(self, solve: int) -> Positions:
        """The positions (from 0, ascending) of the rows of a solve."""
        group = int(self.group[solve])
        return self.groups.positions(group) if group >= 0 else np.empty(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Divided:
    """Combinations of key values, one for each solve, and the rows of the tables that have one of the columns."""

    combinations: Sequence[tuple[CellKey, ...]]
    parts: Mapping[str, Part]


def divided(columns: tuple[str, ...], tables: Mapping[str, Table]) -> Divided:
    """The rows of all solves; ``columns`` are those of ``for-each``, at least one. No solve has rows without a number.

    Raises:
        MbmError: more combinations than can be meant.

    """
    own = {name: tuple(i for i, c in enumerate(columns) if c in table.columns) for name, table in tables.items()}
    grouped = {name: groups(tables[name], [columns[i] for i in places]) for name, places in own.items() if places}
    whole = [grouped[name] for name, places in own.items() if len(places) == len(columns)]
    combinations = _combinations(columns, whole, [(own[name], each) for name, each in grouped.items()])
    held = [tables[name].columns[columns[i]].numbers for name, places in own.items() for i in places]
    if not all(numbers is None or np.isfinite(numbers).all() for numbers in held):
        combinations = [c for c in combinations if not any(isinstance(k, float) and not math.isfinite(k) for k in c)]
    parts = {}
    for name, each in grouped.items():
        if len(whole) == 1 and each is whole[0] and len(combinations) == len(each.cells):
            parts[name] = Part(groups=each, group=np.arange(len(combinations)))
            continue
        number = {cells: i for i, cells in enumerate(each.cells)}
        picked = (number.get(tuple(c[i] for i in own[name]), -1) for c in combinations)
        parts[name] = Part(groups=each, group=np.fromiter(picked, np.int64, len(combinations)))
    return Divided(combinations=combinations, parts=parts)


def _combinations(
    columns: tuple[str, ...], whole: Sequence[Groups], parts: Sequence[tuple[tuple[int, ...], Groups]]
) -> Sequence[tuple[CellKey, ...]]:
    """Those that occur in ``whole``, the tables that have all columns; without one, all of the values that occur."""
    if len(whole) == 1:
        return whole[0].cells
    found: dict[tuple[CellKey, ...], None] = {}
    for each in whole:
        found.update(dict.fromkeys(each.cells))
    if not whole:
        values = []
        for column in range(len(columns)):
            cells: dict[CellKey, None] = {}
            for places, each in parts:
                if column in places:
                    cells.update(dict.fromkeys(c[places.index(column)] for c in each.cells))
            values.append(list(cells))
        count = math.prod(map(len, values))
        if count > MAXIMUM_SOLVES:
            raise MbmError(faults.too_many_solves(columns, count, MAXIMUM_SOLVES))
        found.update(dict.fromkeys(product(*values)))
    return list(found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Groups:
    """The groups of a table's rows, in the order in which they first occur.

    ``cells`` has the cells of each group, one for each column. ``order`` (rows,) are the positions of all rows, group
    by group and in their own order within one; group g has those from ``first[g]`` up to ``first[g + 1]``.
    """

    cells: Sequence[tuple[CellKey, ...]]
    order: Positions
    first: Indices

    def positions(self, group: int) -> Positions:
        """The positions (from 0, ascending) of the rows of a group."""
        return self.order[self.first[group] : self.first[group + 1]]


def groups(table: Table, columns: Sequence[str]) -> Groups:
    """The groups of rows with equal cells in ``columns``, at least one; each row without a number is its own."""
    count = len(table)
    labels = np.zeros(count, dtype=np.int64)
    for name in columns:
        own, distinct = _labels(table.columns[name])
        # renumbered after each column, so that the products stay small
        labels = _in_order(labels * distinct + own)[0] if distinct else own
    labels, leaders = _in_order(labels)
    picked = [table.columns[name].take(leaders) for name in columns]
    cells = [list(c.texts) if c.texts is not None else np.asarray(c.numbers).tolist() for c in picked]
    sizes = np.bincount(labels, minlength=len(leaders))
    sorted_already = bool((np.diff(labels) >= 0).all())
    return Groups(
        cells=list(zip(*cells, strict=True)),
        order=np.arange(count) if sorted_already else np.argsort(labels, kind="stable"),
        first=np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes)]),
    )


def _labels(column: Column) -> tuple[Indices, int]:
    """A whole number from 0 for each cell, equal where the cells are, and how many there may be."""
    column.check()
    if column.texts is not None:
        numbers = {text: number for number, text in enumerate(dict.fromkeys(column.texts))}
        return np.fromiter(map(numbers.__getitem__, column.texts), np.int64, len(column.texts)), len(numbers)
    cells = np.asarray(column.numbers)
    if not len(cells):
        return np.zeros(0, dtype=np.int64), 0
    # Equal cells often stand below one another: the runs are fewer than the rows. NaN equals nothing.
    starts = np.concatenate([np.ones(1, dtype=bool), cells[1:] != cells[:-1]])
    values, of_run = np.unique(cells[starts], return_inverse=True, equal_nan=False)
    return of_run.astype(np.int64)[np.cumsum(starts) - 1], len(values)


def _in_order(labels: Indices) -> tuple[Indices, Indices]:
    """The labels renumbered in the order in which they first occur, and where each first does."""
    if not len(labels):
        return labels, labels
    starts = np.concatenate([np.ones(1, dtype=bool), labels[1:] != labels[:-1]])
    runs = np.flatnonzero(starts)
    _, first, of_run = np.unique(labels[starts], return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[of_run][np.cumsum(starts) - 1], runs[first[order]]
