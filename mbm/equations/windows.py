"""``window``: one problem for each sliding window of the rows (LANGUAGE §4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.problem import faults as problem_faults
from mbm.problem.checks import used_rows
from mbm.problem.requests import ROUNDING, Window
from mbm.problem.rows import Positions
from mbm.problem.tables import Table
from mbm.problem.types import BlockRole, Problem
from mbm.text.types import MbmError
from mbm.values import dataclass

BEYOND = 1e18
"""More windows than anybody can mean; their number has to be finite to be reported."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Timed:
    """The rows of a table in the order of their times: positions (n,) in the table, and times (n,).

    ``used`` (n + 1,) counts the rows before each that an observation uses.
    """

    positions: Positions
    times: Floats
    used: Positions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """The rows of all T windows in one table: window k has those at ``order[first[k] : last[k]]``.

    ``used`` (T,) are those of them that an observation uses.
    """

    order: Positions
    first: Indices
    last: Indices
    used: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Windows:
    """The windows over one selection of rows; ``others`` are positions in tables without the column."""

    column: str
    length: float
    first: float
    step: float
    count: int
    slack: float
    timed: Mapping[str, _Timed]
    others: Mapping[str, Positions]

    @property
    def ends(self) -> list[float]:
        """The end of each window, as the data write it."""
        return [self._written(end) for end in self._ends().tolist()]

    def each(self) -> Iterator[tuple[float, Mapping[str, Positions], int]]:
        """End of each window, the positions of its rows by table, and how many rows observations use."""
        stretches = {name: self.stretch(name) for name in self.timed}
        for number, end in enumerate(self._ends().tolist()):
            positions = dict(self.others)
            for name, each in stretches.items():
                positions[name] = np.sort(each.order[int(each.first[number]) : int(each.last[number])])
            yield self._written(end), positions, sum(int(each.used[number]) for each in stretches.values())

    def stretch(self, name: str) -> Stretch:
        """The rows of all windows in one table."""
        timed = self.timed.get(name)
        if timed is None:
            order = self.others[name]
            whole = np.full(self.count, len(order), dtype=np.int64)
            return Stretch(order=order, first=np.zeros_like(whole), last=whole, used=np.zeros_like(whole))
        ends = self._ends()
        first = np.searchsorted(timed.times, ends - self.length + self.slack, side="right")
        last = np.maximum(np.searchsorted(timed.times, ends + self.slack, side="right"), first)
        return Stretch(order=timed.positions, first=first, last=last, used=timed.used[last] - timed.used[first])

    def _ends(self) -> Floats:
        return np.asarray(self.first + np.arange(self.count, dtype=np.float64) * self.step)

    def _written(self, end: float) -> float:
        """The end as the data write it, where a row stands at it: 0.3, not 0.30000000000000004."""
        for timed in self.timed.values():
            nearest = int(np.searchsorted(timed.times, end - self.slack))
            if nearest < len(timed.times) and abs(timed.times[nearest] - end) <= self.slack:
                return float(timed.times[nearest])
        return end


def windows(problem: Problem, window: Window, tables: Mapping[str, Table], chosen: Mapping[str, Positions]) -> Windows:
    """The windows over the rows at the ``chosen`` positions (all rows of tables not named).

    Ends go from the first row to the last of the tables that observations use, or of all that have the column if none
    does; rows that ``:when`` leaves out do not count towards ``:min-rows``. Rows without a finite number
    belong to none.

    Raises:
        MbmError: a text in the column.

    """
    having = {name: table for name, table in tables.items() if window.column in table.columns}
    observed = _observed(problem, having)
    timed = {name: _timed(table, window, chosen.get(name), observed.get(name)) for name, table in having.items()}
    spans = [timed[name].times for name in (observed or timed) if len(timed[name].times)]
    count, first, slack = 0, 0.0, 0.0
    if spans:
        first, last = min(t[0] for t in spans), max(t[-1] for t in spans)
        eps = float(np.finfo(np.float64).eps)
        slack = ROUNDING * window.step + 4 * eps * max(abs(float(first)), abs(float(last)))
        count = int(min(np.floor((last - first + slack) / window.step), BEYOND)) + 1
    others = {name: positions for name, positions in chosen.items() if name not in having}
    return Windows(
        column=window.column,
        length=window.length,
        first=float(first),
        step=window.step,
        count=count,
        slack=slack,
        timed=timed,
        others=others,
    )


def _observed(problem: Problem, tables: Mapping[str, Table]) -> dict[str, Mask]:
    """The tables that observations use, with a mask of the rows that one of them uses."""
    found: dict[str, Mask] = {}
    for block in problem.blocks:
        if block.role is BlockRole.OBSERVATION and block.table is not None and block.table in tables:
            mask = used_rows(block, tables)
            if mask is not None:
                found[block.table] = mask | found.get(block.table, np.zeros(len(mask), dtype=bool))
    return found


def _timed(table: Table, window: Window, chosen: Positions | None, used: Mask | None) -> _Timed:
    column = table.columns[window.column]
    if column.numbers is None:
        position = column.first_text() or 0
        place = table.place(position, window.column)
        raise MbmError(problem_faults.bad_time(place, window.column, str(column.cell(position)), window.span))
    positions = np.arange(len(table), dtype=np.int64) if chosen is None else chosen
    positions = positions[np.isfinite(column.numbers[positions])]
    times = column.numbers[positions]
    order = np.argsort(times, kind="stable")
    mask = np.zeros(len(positions), dtype=np.int64) if used is None else used[positions][order].astype(np.int64)
    before = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(mask)])
    return _Timed(positions=positions[order], times=times[order], used=before)
