"""The rows of many solves, all at once: by the keys of ``for-each``, and by the windows that slide over them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.selected import SelectedTables, column_families
from mbm.equations.selection import Divided, Part, Selection, divided, too_many
from mbm.equations.types import Indices
from mbm.equations.windows import Windows, windows
from mbm.problem.rows import Positions
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Family, Problem
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Span:
    """The rows of one table by solve: solve k has those at ``order[first[k] : last[k]]``, which others may have too."""

    order: Positions
    first: Indices
    last: Indices

    @property
    def sizes(self) -> Indices:
        """Rows of each solve (T,)."""
        return np.asarray(self.last - self.first)

    def positions(self, solve: int) -> Positions:
        """The positions (from 0, ascending) of the rows of a solve."""
        return np.sort(self.order[int(self.first[solve]) : int(self.last[solve])])

    def some(self, which: Indices) -> Span:
        """The rows of some solves (K,), those of no other."""
        first, last = self.first[which], self.last[which]
        ends = np.zeros(len(self.order) + 1, dtype=np.int64)
        np.add.at(ends, first, 1)
        np.add.at(ends, last, -1)
        held = np.cumsum(ends)[:-1] > 0
        before = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(held)])
        return Span(order=self.order[held], first=before[first], last=before[last])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sets:
    """The rows of T solves.

    ``names`` are the key columns and ``keys`` their cells in each solve; ``spans`` has the tables that are divided,
    ``families`` are those over columns, by the name of the table that is made of the distinct values.
    ``used`` (T,) counts the rows of each window that observations use (None: these are no windows).
    """

    names: tuple[str, ...]
    keys: Sequence[tuple[CellKey, ...]]
    tables: Mapping[str, Table]
    spans: Mapping[str, Span]
    families: Mapping[str, Family]
    used: Indices | None = None

    @property
    def count(self) -> int:
        """T."""
        return len(self.keys)

    def selection(self, number: int) -> Selection:
        """The key and the tables of one solve."""
        positions = {name: span.positions(number) for name, span in self.spans.items()}
        key = dict(zip(self.names, self.keys[number], strict=True))
        rows = None if self.used is None else int(self.used[number])
        return Selection(key=key, tables=SelectedTables(self.tables, positions, self.families), rows=rows)

    def some(self, which: Indices) -> Sets:
        """The rows of some solves (K,)."""
        spans = {name: span.some(which) for name, span in self.spans.items()}
        keys = [self.keys[number] for number in which.tolist()]
        return replace(self, keys=keys, spans=spans, used=None if self.used is None else self.used[which])


def sets_of(problem: Problem, tables: Mapping[str, Table]) -> Sets | None:
    """The rows of all solves of a problem; None where there is one solve only.

    Raises:
        MbmError: more solves than can be meant, or a window's column without a number in some row.

    """
    columns, window = problem.request.for_each, problem.request.window
    families = column_families(problem)
    base = {name: table for name, table in tables.items() if name not in families}
    keyed = divided(columns, base) if columns else None
    if window is None:
        return None if keyed is None else _by_key(columns, keyed, base, families)
    chosen: list[tuple[tuple[CellKey, ...], Mapping[str, Positions]]] = [((), {})]
    if keyed is not None:
        chosen = list(_chosen(keyed))
    slid = [(cells, windows(problem, window, base, rows)) for cells, rows in chosen]
    too_many(window, sum(each.count for _, each in slid))
    return replace(_by_window((*columns, window.column), slid, base), families=families)


def _chosen(keyed: Divided) -> Iterator[tuple[tuple[CellKey, ...], Mapping[str, Positions]]]:
    for number, cells in enumerate(keyed.combinations):
        yield cells, {name: part.positions(number) for name, part in keyed.parts.items()}


def _by_key(
    columns: tuple[str, ...], keyed: Divided, tables: Mapping[str, Table], families: Mapping[str, Family]
) -> Sets:
    spans = {name: _span(part) for name, part in keyed.parts.items()}
    return Sets(names=columns, keys=keyed.combinations, tables=tables, spans=spans, families=families)


def _span(part: Part) -> Span:
    """The rows solve by solve, each solve with its own."""
    groups, wanted = part.groups, part.group
    sizes = part.sizes
    ends = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(sizes)])
    order = groups.order
    if not np.array_equal(wanted, np.arange(len(groups.cells))):
        starts = np.repeat(groups.first[wanted] - ends[:-1], sizes)
        order = groups.order[np.arange(ends[-1]) + starts]
    return Span(order=order, first=ends[:-1], last=ends[1:])


def _by_window(
    names: tuple[str, ...], slid: Sequence[tuple[tuple[CellKey, ...], Windows]], tables: Mapping[str, Table]
) -> Sets:
    """The rows of all windows: those of each key in the order of their times, and the stretch of each window there."""
    keys = [(*cells, end) for cells, each in slid for end in each.ends]
    used = np.zeros(len(keys), dtype=np.int64)
    spans = {}
    for name in {name: None for _, each in slid for name in (*each.timed, *each.others)}:
        orders: list[Positions] = []
        firsts: list[Indices] = []
        lasts: list[Indices] = []
        before = place = 0
        for _, each in slid:
            stretch = each.stretch(name)
            orders.append(stretch.order)
            firsts.append(before + stretch.first)
            lasts.append(before + stretch.last)
            used[place : place + each.count] += stretch.used
            before += len(stretch.order)
            place += each.count
        none = np.zeros(0, dtype=np.int64)
        spans[name] = Span(
            order=np.concatenate([none, *orders]),
            first=np.concatenate([none, *firsts]),
            last=np.concatenate([none, *lasts]),
        )
    return Sets(names=names, keys=keys, tables=tables, spans=spans, families={}, used=used)
