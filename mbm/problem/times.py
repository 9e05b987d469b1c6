"""The times at which a table is sampled."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Sampling
from mbm.expression.rows import Row, RowChoice
from mbm.problem import faults
from mbm.problem.self_pairing import Positions, by_key, starts_anew
from mbm.problem.tables import CellKey, Numbers, Table
from mbm.text.types import MbmError, Span
from mbm.values import dataclass


def numbers_of(table: Table, name: str, span: Span) -> str:
    """The name of a column of numbers; one of texts is no column of times."""
    column = table.columns[name]
    if column.numbers is None:
        position = column.first_text() or 0
        raise MbmError(faults.bad_time(table.place(position, name), name, str(column.cell(position)), span))
    return name


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedRows:
    """Rows of a sampled table with the same keys: ``times`` (n,) ascend, ``positions`` (n,) are those in the table."""

    times: Numbers
    positions: Positions


def timed_rows(sampling: Sampling, table: Table) -> dict[tuple[CellKey, ...], TimedRows]:
    """The rows of a sampled table by the values of `dividing` columns.

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
    return {
        cells: _in_order(sampling, table, rows, times[rows])
        for cells, rows in by_key(table, dividing(sampling, table)).items()
    }


def dividing(sampling: Sampling, table: Table) -> tuple[str, ...]:
    """The columns across whose values a sampled table has nothing between two rows."""
    anew = (c for c in sampling.passing if c in table.columns and starts_anew(table, sampling.by, c))
    return (*(key for key in sampling.keys if key in table.columns), *anew)


def _in_order(sampling: Sampling, table: Table, rows: Positions, times: Numbers) -> TimedRows:
    order = np.argsort(times, kind="stable")
    ordered = times[order]
    repeated = np.flatnonzero(np.diff(ordered) == 0)
    if repeated.size:
        here, there = (table.place(int(rows[order[repeated[0] + i]]), sampling.by) for i in (1, 0))
        raise MbmError(faults.repeated_time(here, there, sampling.by, float(ordered[repeated[0]]), sampling.span))
    return TimedRows(times=ordered, positions=rows[order])


def timed_for(
    sampling: Sampling, owner: Table, table: Table | None, positions: Positions | None, count: int
) -> tuple[tuple[TimedRows, ...], Positions]:
    """The rows of a sampled table by keys, and for each of ``count`` rows at hand which of these it has; -1: none.

    A table at hand without the keys has the first.
    """
    found = timed_rows(sampling, owner)
    if len(found) == 1:
        return tuple(found.values()), np.zeros(count, dtype=np.int64)
    keys = dividing(sampling, owner)
    common = [key for key in keys if table is not None and key in table.columns]
    numbers: dict[tuple[CellKey, ...], int] = {}
    for number, cells in enumerate(found):
        numbers.setdefault(tuple(cells[keys.index(key)] for key in common), number)
    if table is None or not common:
        return tuple(found.values()), np.zeros(count, dtype=np.int64)
    cells_of = list(zip(*(table.keys(key) for key in common), strict=True))
    rows = range(len(table)) if positions is None else positions.tolist()
    return tuple(found.values()), np.array([numbers.get(cells_of[row], -1) for row in rows], dtype=np.int64)


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
