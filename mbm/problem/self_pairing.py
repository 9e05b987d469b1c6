"""``(pair NAME ((from A) (to A)) :by … :step …)``: rows of a table with later rows of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.problem.tables import CellKey, Numbers, StepKind, Steps, Table

Positions = NDArray[np.int64]


def later_rows(
    table: Table, steps: Steps, keys: tuple[str, ...], scale: Numbers | None, tolerance: float | None
) -> tuple[Positions, Positions]:
    """Positions (from 0) of rows that start a pair, ascending, and of the rows that they are paired with.

    ``scale`` (n,) are the times, or what the path is made of lies in the table. Every row starts a pair that has, among
    the later rows with its ``keys``, one ``step`` rows on, or one nearest to its time or path and the step, within the
    tolerance: half the median step between neighbours where none is stated. Of two equally near the earlier is taken.
    """
    first, second = [], []
    for rows in by_key(table, keys).values():
        if steps.kind is StepKind.ROWS:
            count = max(len(rows) - int(steps.step), 0)
            first.append(rows[:count])
            second.append(rows[len(rows) - count :])
            continue
        if steps.kind is StepKind.DISTANCE:
            at = travelled(np.column_stack([table.numbers(name)[rows] for name in steps.along]))
        else:
            times = np.empty(0) if scale is None else scale[rows]
            rows = rows[np.argsort(times, kind="stable")]
            at = np.sort(times)
        begin, end = nearest_later(at, steps.step, tolerance)
        first.append(rows[begin])
        second.append(rows[end])
    here, there = (np.concatenate([np.empty(0, dtype=np.int64), *each]) for each in (first, second))
    order = np.argsort(here, kind="stable")
    return here[order], there[order]


def travelled(points: Numbers) -> Numbers:
    """The length of the path (n,) to each of the points (n, d)."""
    lengths = np.sqrt(np.square(np.diff(points, axis=0)).sum(axis=1))
    return np.concatenate([np.zeros(min(len(points), 1)), np.cumsum(lengths)])


def by_key(table: Table, keys: tuple[str, ...]) -> dict[tuple[CellKey, ...], Positions]:
    """The positions of the rows with each combination of keys, in their order."""
    if not keys:
        return {(): np.arange(len(table))}
    found: dict[tuple[CellKey, ...], list[int]] = {}
    for position, cells in enumerate(zip(*(table.keys(key) for key in keys), strict=True)):
        found.setdefault(cells, []).append(position)
    return {cells: np.array(rows, dtype=np.int64) for cells, rows in found.items()}


def starts_anew(table: Table, by: str, column: str) -> bool:
    """Whether the times, the column ``by``, go on within each value of a column, and back where the next begins."""
    times, values = (table.columns[name].numbers for name in (by, column))
    if times is None or values is None:
        return False
    back, same = np.diff(times) < 0, np.diff(values) == 0
    return bool(back.any() and same.any() and not (back & same).any())


def nearest_later(at: Numbers, step: float, tolerance: float | None) -> tuple[Positions, Positions]:
    """Places of ascending numbers (n,), and of the later ones nearest to those plus the step.

    None farther from that than ``tolerance``, by default half the median step between neighbours.
    """
    none = np.empty(0, dtype=np.int64)
    if len(at) < 2:
        return none, none
    if tolerance is None:
        apart = np.diff(np.unique(at))
        tolerance = float(np.median(apart)) / 2 if apart.size else 0.0
    begin = np.arange(len(at) - 1)
    wanted = at[begin] + step
    after = np.clip(np.searchsorted(at, wanted), begin + 1, len(at) - 1)
    before = np.maximum(after - 1, begin + 1)
    end = np.where(np.abs(at[before] - wanted) <= np.abs(at[after] - wanted), before, after)
    slack = 4 * np.finfo(np.float64).eps * float(np.abs(at).max())
    kept = np.abs(at[end] - wanted) <= tolerance + slack
    return begin[kept], end[kept]
