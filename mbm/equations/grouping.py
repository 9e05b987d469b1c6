"""Rows of a table that share the cells of some columns, all groups found at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.types import Indices
from mbm.problem.rows import Positions
from mbm.problem.tables import CellKey, Column, Table
from mbm.values import dataclass


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
