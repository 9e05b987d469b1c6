"""``for-each``: one problem for each combination of key values that occurs, with the rows that belong to it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from mbm.problem.rows import Positions
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.solution import faults
from mbm.solution.selected import SelectedTables, column_families
from mbm.solution.windows import Windows, windows
from mbm.text.types import MbmError

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

    Tables without any of the columns enter whole. A combination occurs if some table that has all the columns holds it;
    where no table has all of them, every combination of the values that occur is tried. Each combination has windows of
    its own, from its first row to its last.

    Raises:
        MbmError: more solves than can be meant, or a window's column without a number in some row.

    """
    columns, window = problem.request.for_each, problem.request.window
    if not columns and window is None:
        return 1, iter((Selection(key={}, tables=tables),))
    families = column_families(problem)
    base = {name: table for name, table in tables.items() if name not in families}
    chosen = list(_chosen(columns, base))
    if window is None:
        made = (Selection(key=key, tables=SelectedTables(base, rows, families)) for key, rows in chosen)
        return len(chosen), made
    slid = [(key, windows(problem, window, base, rows)) for key, rows in chosen]
    count = sum(each.count for _, each in slid)
    if count > MAXIMUM_WINDOWS:
        raise MbmError(faults.too_many_windows(window.span, count, MAXIMUM_WINDOWS))
    return count, (selection for key, each in slid for selection in _slid(key, each, base, problem))


def _slid(
    key: Mapping[str, CellKey], slid: Windows, base: Mapping[str, Table], problem: Problem
) -> Iterator[Selection]:
    families = column_families(problem)
    for end, positions, rows in slid.each():
        tables = SelectedTables(base, positions, families)
        yield Selection(key={**key, slid.column: end}, tables=tables, rows=rows)


def _chosen(
    columns: tuple[str, ...], tables: Mapping[str, Table]
) -> Iterator[tuple[Mapping[str, CellKey], Mapping[str, Positions]]]:
    """Each combination of keys with the positions of its rows in the tables that have one of the columns."""
    if not columns:
        yield {}, {}
        return
    rows: dict[str, tuple[tuple[int, ...], dict[tuple[CellKey, ...], list[int]]]] = {}
    for name, table in tables.items():
        own = tuple(i for i, column in enumerate(columns) if column in table.columns)
        if own:
            groups: dict[tuple[CellKey, ...], list[int]] = {}
            for position, cells in enumerate(zip(*(table.keys(columns[i]) for i in own), strict=True)):
                groups.setdefault(cells, []).append(position)
            rows[name] = (own, groups)
    for combination in _combinations(columns, tables):
        positions = {
            name: np.asarray(groups.get(tuple(combination[i] for i in own), []), dtype=np.int64)
            for name, (own, groups) in rows.items()
        }
        yield dict(zip(columns, combination, strict=True)), positions


def _combinations(columns: tuple[str, ...], tables: Mapping[str, Table]) -> list[tuple[CellKey, ...]]:
    whole = [t for t in tables.values() if all(c in t.columns for c in columns)]
    found: dict[tuple[CellKey, ...], None] = {}
    for table in whole:
        found.update(dict.fromkeys(zip(*(table.keys(c) for c in columns), strict=True)))
    if not whole:
        values = []
        for column in columns:
            cells: dict[CellKey, None] = {}
            for table in tables.values():
                if column in table.columns:
                    cells.update(dict.fromkeys(table.keys(column)))
            values.append(list(cells))
        count = math.prod(map(len, values))
        if count > MAXIMUM_SOLVES:
            raise MbmError(faults.too_many_solves(columns, count, MAXIMUM_SOLVES))
        found.update(dict.fromkeys(product(*values)))
    return list(found)
