"""The table that is made of a problem's transitions: one row for each step that is reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.problem import faults
from mbm.problem.naming import key_text
from mbm.problem.provenance import Origin
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, Sequence
from mbm.problem.tables import Column, ColumnGroup, Numbers, Table
from mbm.text.types import MbmError


def transitions_table(sequence: Sequence, tables: Mapping[str, Table]) -> Table:
    """The rows of `Sequence.reached` for ``tables``, among which is that of the steps.

    For those of all sequences together, where there are several, a step has as many rows as it has in the tables whose
    columns are used: that is what decides which equations there are.

    Raises:
        MbmError: a table whose columns are used has no row, or several, for a step that is reached.

    """
    steps = tables[sequence.steps]
    keys = steps.numbers(sequence.column)
    names = tuple(dict.fromkeys(table for table, _ in sequence.joined))
    reached, rows_of = _matched(sequence, keys, {name: tables[name] for name in names})
    columns = {
        sequence.column: Column(name=sequence.column, numbers=keys[reached]),
        PREVIOUS: Column(name=PREVIOUS, numbers=keys[reached - 1]),
        INTERVAL: Column(name=INTERVAL, numbers=keys[reached] - keys[reached - 1]),
    }
    groups: dict[str, ColumnGroup] = {}
    origins: dict[str, Origin] = {}
    for name, rows in rows_of.items():
        table = tables[name]
        groups.update(table.groups_called(name))
        for _, column in (each for each in sequence.joined if each[0] == name):
            called = f"{name}.{column}"
            columns[called] = replace(table.columns[column].take(rows), name=called)
            origins[called] = Origin(provenance=table.provenance, rows=table.rows[rows], column=column)
    kept = {name: group for name, group in groups.items() if all(column in columns for column in group.columns)}
    provenance = replace(steps.provenance.taking(reached + 1), origins=origins)
    return Table(
        name=sequence.reached,
        columns=columns,
        rows=np.arange(1, len(reached) + 1),
        provenance=provenance,
        key=sequence.column,
        groups=kept,
    )


def _matched(
    sequence: Sequence, keys: Numbers, tables: Mapping[str, Table]
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.int64]]]:
    """The places (from 0) of the steps that are reached, and for each the position of its row in every table."""
    reached = np.arange(1, len(keys))
    found: dict[str, NDArray[np.int64]] = {}
    for name, table in tables.items():
        order, first, last = _rows(table, sequence.column, keys[reached])
        counts = last - first
        if not sequence.divided:
            _refuse(table, sequence, keys[reached], (order, first, last))
        found = {other: np.repeat(rows, counts) for other, rows in found.items()}
        reached = np.repeat(reached, counts)
        within = np.arange(len(reached)) - np.repeat(np.cumsum(counts) - counts, counts)
        found[name] = order[np.repeat(first, counts) + within]
    return reached, found


def _rows(table: Table, column: str, keys: Numbers) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The order of the rows by step, and of the rows with each of the ``keys`` the first and the one after the last."""
    values = table.numbers(column)
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    return order, np.searchsorted(ordered, keys, side="left"), np.searchsorted(ordered, keys, side="right")


def _refuse(
    table: Table,
    sequence: Sequence,
    keys: Numbers,
    found: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
) -> None:
    """Each of the ``keys`` has one row."""
    order, first, last = found
    wrong = np.flatnonzero(last - first != 1)
    if wrong.size:
        k = int(wrong[0])
        places = tuple(table.place(int(row), sequence.column) for row in order[first[k] : last[k]])
        step = key_text(float(keys[k]))
        raise MbmError(faults.step_without_row(sequence.span, table.name, sequence.column, step, places))
