"""``for-each``: one problem for each combination of key values that occurs, with the rows that belong to it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from mbm.problem.joining import with_families
from mbm.problem.tables import CellKey, Table
from mbm.problem.types import Problem
from mbm.solution import faults
from mbm.text.types import MbmError

MAXIMUM_SOLVES = 1_000_000
"""Combinations of keys from different tables that are tried; rows of one table that has all columns are not limited."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selection:
    """The tables of one solve, and the key values that picked them."""

    key: Mapping[str, CellKey]
    tables: Mapping[str, Table]


def selections(problem: Problem, tables: Mapping[str, Table]) -> tuple[int, Iterator[Selection]]:
    """How many solves there are, and their tables one after the other, in the order in which the keys first occur.

    Tables without any of the columns enter whole. A combination occurs if some table that has all the columns holds it;
    where no table has all of them, every combination of the values that occur is tried.
    """
    columns = problem.request.for_each
    if not columns:
        return 1, iter((Selection(key={}, tables=tables),))
    base = {name: table for name, table in tables.items() if not _is_derived(problem, name)}
    combinations = _combinations(columns, base)
    return len(combinations), _select(problem, columns, combinations, base)


def _is_derived(problem: Problem, name: str) -> bool:
    return any(u.family is not None and u.family.column is not None and u.family.rows == name for u in problem.unknowns)


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


def _select(
    problem: Problem,
    columns: tuple[str, ...],
    combinations: list[tuple[CellKey, ...]],
    tables: Mapping[str, Table],
) -> Iterator[Selection]:
    rows: dict[str, tuple[tuple[int, ...], dict[tuple[CellKey, ...], list[int]]]] = {}
    for name, table in tables.items():
        own = tuple(i for i, column in enumerate(columns) if column in table.columns)
        if own:
            groups: dict[tuple[CellKey, ...], list[int]] = {}
            for position, cells in enumerate(zip(*(table.keys(columns[i]) for i in own), strict=True)):
                groups.setdefault(cells, []).append(position)
            rows[name] = (own, groups)
    families = tuple(u.family for u in problem.unknowns if u.family is not None)
    for combination in combinations:
        selected = dict(tables)
        for name, (own, groups) in rows.items():
            positions = groups.get(tuple(combination[i] for i in own), [])
            selected[name] = tables[name].take(np.asarray(positions, dtype=np.int64))
        yield Selection(key=dict(zip(columns, combination, strict=True)), tables=with_families(selected, families))
