"""The table that is made of a problem's transitions: one row for each step that is reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.problem import faults
from mbm.problem.naming import key_text
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, Sequence
from mbm.problem.tables import Column, ColumnGroup, Numbers, Origin, Table
from mbm.text.types import MbmError, Span


def transitions_table(sequence: Sequence, tables: Mapping[str, Table]) -> Table:
    """The rows of `Sequence.reached` for ``tables``, among which is that of the steps.

    Raises:
        MbmError: a table whose columns are used has no row, or several, for a step that is reached.

    """
    steps = tables[sequence.steps]
    keys = steps.numbers(sequence.column)
    count = max(len(keys) - 1, 0)
    columns = {
        sequence.column: Column(name=sequence.column, numbers=keys[1:], unit=steps.columns[sequence.column].unit),
        PREVIOUS: Column(name=PREVIOUS, numbers=keys[:count]),
        INTERVAL: Column(name=INTERVAL, numbers=np.diff(keys)),
    }
    groups: dict[str, ColumnGroup] = {}
    origins: dict[str, Origin] = {}
    for name in dict.fromkeys(table for table, _ in sequence.joined):
        table = tables[name]
        rows = _rows(table, sequence.column, keys[1:], sequence.span)
        groups.update(table.groups_called(name))
        for _, column in (each for each in sequence.joined if each[0] == name):
            called = f"{name}.{column}"
            columns[called] = replace(table.columns[column].take(rows), name=called)
            origins[called] = Origin(provenance=table.provenance, rows=table.rows[rows], column=column)
    kept = {name: group for name, group in groups.items() if all(column in columns for column in group.columns)}
    provenance = replace(steps.provenance.taking(np.arange(2, count + 2)), origins=origins)
    return Table(
        name=sequence.reached,
        columns=columns,
        rows=np.arange(1, count + 1),
        provenance=provenance,
        key=sequence.column,
        groups=kept,
    )


def _rows(table: Table, column: str, keys: Numbers, span: Span) -> np.ndarray:
    """The position of the one row of ``table`` that each of the ``keys`` has."""
    values = table.numbers(column)
    order = np.argsort(values, kind="stable")
    first = np.searchsorted(values[order], keys, side="left")
    last = np.searchsorted(values[order], keys, side="right")
    wrong = np.flatnonzero(last - first != 1)
    if wrong.size:
        k = int(wrong[0])
        places = tuple(table.place(int(row), column) for row in order[first[k] : last[k]])
        raise MbmError(faults.step_without_row(span, table.name, column, key_text(float(keys[k])), places))
    return np.asarray(order[first])
