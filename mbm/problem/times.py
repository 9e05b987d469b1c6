"""The times at which a table is sampled."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Sampling
from mbm.problem import faults
from mbm.problem.tables import Numbers, Table
from mbm.text.types import MbmError, Span


def numbers_of(table: Table, name: str, span: Span) -> str:
    """The name of a column of numbers; one of texts is no column of times."""
    column = table.columns[name]
    if column.numbers is None:
        position = column.first_text() or 0
        raise MbmError(faults.bad_time(table.place(position, name), name, str(column.cell(position)), span))
    return name


def time_nodes(sampling: Sampling, table: Table) -> tuple[Numbers, np.ndarray]:
    """The times of a sampled table in ascending order, shape (n,), and the positions of their rows.

    Raises:
        MbmError: fewer than two rows, a time that is missing or no number, or two rows at one time.

    """
    times = table.numbers(numbers_of(table, sampling.by, sampling.span))
    wrong = np.flatnonzero(~np.isfinite(times))
    if wrong.size:
        place, value = table.place(int(wrong[0]), sampling.by), float(times[wrong[0]])
        raise MbmError(faults.not_finite_cell(place, sampling.by, value, sampling.span))
    if len(table) < 2:  # nothing lies between fewer
        raise MbmError(faults.too_few_times(sampling.span, table.name, len(table)))
    order = np.argsort(times, kind="stable")
    ordered = times[order]
    repeated = np.flatnonzero(np.diff(ordered) == 0)
    if repeated.size:
        here, there = (table.place(int(order[repeated[0] + i]), sampling.by) for i in (1, 0))
        raise MbmError(faults.repeated_time(here, there, sampling.by, float(ordered[repeated[0]]), sampling.span))
    return ordered, order
