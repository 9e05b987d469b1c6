"""The times at which a table is sampled."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Sampling
from mbm.expression.rows import Row, RowChoice
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


def interval_of(times: Numbers, at: Numbers) -> np.ndarray:
    """The places among ascending ``times`` (n,) of the rows before times ``at``, beyond the ends those next to them."""
    return np.clip(np.searchsorted(times, at, side="right") - 1, 0, max(len(times) - 2, 0))


def places_around(times: Numbers, at: Numbers) -> dict[Row, np.ndarray]:
    """The places among ascending ``times`` (n,) of the rows around times ``at`` (m,).

    Beyond the ends they are those of the last interval. Three points make a parabola in any order, so that the third
    row from an end stands in where there is none two before or after.
    """
    last = len(times) - 1
    before = interval_of(times, at)
    return {
        RowChoice.TWO_BEFORE: np.where(before > 0, before - 1, min(2, last)),
        RowChoice.BEFORE: before,
        RowChoice.AFTER: before + 1,
        RowChoice.TWO_AFTER: np.where(before + 2 <= last, before + 2, max(last - 2, 0)),
    }
