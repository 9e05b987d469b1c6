"""Which of many solves are alike: as many members in each family, the same of them mentioned, the same limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.layout import stated_start, stated_values
from mbm.equations.layouts import columns_of, limits
from mbm.equations.types import Indices, Mask
from mbm.estimation.batches.arranged import Arranged
from mbm.estimation.batches.stack import Stack
from mbm.problem.rows import decided, row_values
from mbm.problem.types import Problem, RowValues, Unknown, UnknownKind


def shapes(problem: Problem, tables: Arranged, solves: int) -> tuple[list[Indices], Indices]:
    """The numbers (from 0, ascending) of solves whose layouts are alike but for names and starts, and of those apart.

    The latter have members whose start is none, of which the general path speaks.
    """
    sizes = [np.diff(each.first) for each in tables.families.values()]
    marks = np.column_stack([np.zeros(solves, dtype=np.int64), *sizes])
    good = np.ones(solves, dtype=bool)
    for unknown in problem.unknowns:
        if unknown.family is None or unknown.family.rows not in tables.families:
            continue
        owner = tables.owners[unknown.family.rows]
        for option in _limits(unknown):
            cells = [cell.tobytes() for cell in option_cells(option, tables, fixed=option is unknown.fixed)]
            marks = np.column_stack([marks, _together(cells, owner, solves)])
        stated = stated_values(unknown)
        if stated is not None and columns_of(stated):
            values, known = stated_start(unknown, stated, tables.tables)
            wrong = np.isnan(values) & known
            if unknown.kind is UnknownKind.POSITIVE:
                wrong |= (values <= 0) & known
            good[owner[wrong.any(axis=1)]] = False
    return [part[good[part]] for part in _alike(marks)], np.flatnonzero(~good)


def by_use(bound: Stack) -> list[Indices]:
    """The numbers (from 0, ascending) of solves in which the same members are mentioned."""
    used = mentioned(bound)
    return _alike(used) if used.shape[1] else [np.arange(bound.solves)]


def mentioned(bound: Stack) -> Mask:
    """Which coordinates of families (T, k) some equation of each solve depends on."""
    layout = bound.equations.layout
    family = np.zeros(len(layout.number), dtype=bool)
    for entry in layout.entries:
        family[entry.coordinates] = entry.keys is not None
    used = np.zeros((bound.solves, len(family)), dtype=bool)
    if not family.any():
        return used[:, :0]
    for number, group in enumerate((*bound.equations.groups, *bound.equations.constraints)):
        solve, lines = bound.lines(number, range(bound.solves))
        for tangent in np.unique(group.kernel.jacobian_columns).tolist():
            used[solve, group.columns[lines, tangent]] = True
    return used[:, family]


def option_cells(option: RowValues, tables: Arranged, *, fixed: bool) -> np.ndarray:
    """The numbers (rows, components) of an option, row by row, of all solves."""
    return np.ascontiguousarray(decided(option, tables.tables) if fixed else row_values(option, tables.tables))


def _limits(unknown: Unknown) -> Iterator[RowValues]:
    """The options that solves which are made together have in common, where they may vary."""
    return (option for option in limits(unknown) if columns_of(option))


def _together(cells: list[bytes], owner: Indices, solves: int) -> Indices:
    """One number for each solve (T,), equal where all its rows' cells are."""
    lines: list[list[bytes]] = [[] for _ in range(solves)]
    for cell, solve in zip(cells, owner.tolist(), strict=True):
        lines[solve].append(cell)
    known: dict[bytes, int] = {}
    return np.array([known.setdefault(b"".join(line), len(known)) for line in lines], dtype=np.int64)


def _alike(marks: np.ndarray) -> list[Indices]:
    """The lines of a table that are the same, in the order in which they first occur."""
    _, first, which = np.unique(marks, axis=0, return_index=True, return_inverse=True)
    parts = np.split(np.argsort(which.ravel(), kind="stable"), np.cumsum(np.bincount(which.ravel()))[:-1])
    return [parts[place] for place in np.argsort(first).tolist()]
