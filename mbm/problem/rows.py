"""Numbers for the rows of a table: which rows a case holds, and what data-only forms are worth there.

Which rows lie around a time of a sampled table, and which are paired with later ones of their table.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from mbm.expression.evaluate import Lookup, Values, evaluate
from mbm.expression.nodes import Column, ColumnMember, Constant, Leaf, LiteralMember, Sampling, leaves
from mbm.expression.rows import Row, RowChoice, chosen_place
from mbm.problem import faults
from mbm.problem.aggregates import AggregateKind, WrittenOut
from mbm.problem.previous import has_before, looks_back
from mbm.problem.tables import ROW, CellKey, Numbers, StepKind, Steps, Table
from mbm.problem.types import RowValues, Static
from mbm.text.types import Diagnostic, MbmError, Place, Span
from mbm.values import dataclass


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


Positions = NDArray[np.int64]

MAXIMUM_REPORTED = 5
"""Faulty cells of one kind in one table that are reported; more would hide the rest."""


def rows_of(static: Static, table: Table) -> Positions:
    """Positions (from 0) of the rows that have the static values of a case."""
    mask = np.ones(len(table), dtype=bool)
    for name, value in static:
        column = table.columns.get(name)
        if column is not None and column.texts is not None:
            mask &= np.fromiter((cell == value for cell in column.texts), dtype=bool, count=len(table))
        else:
            mask &= column_numbers(table, name) == value
    return np.flatnonzero(mask)


def column_numbers(table: Table, name: str) -> Numbers:
    """A column of numbers; ``row`` is the row's number in the unfiltered table unless there is such a column."""
    if name == ROW and ROW not in table.columns:
        return table.rows.astype(np.float64)
    return table.numbers(name)


def static_cells(table: Table, column: str) -> list[CellKey]:
    """The cells of a column as values that may decide an equation; ``row`` is the row's number."""
    if column == ROW and ROW not in table.columns:
        return [float(r) for r in table.rows]
    return list(table.keys(column))


def lookup(table: Table | None, positions: Positions | None, tables: Mapping[str, Table]) -> Lookup:
    """Values of leaves for the rows at ``positions`` of ``table``; unknowns have none."""

    def value(leaf: Leaf) -> Values:
        if isinstance(leaf, Constant):
            return leaf.value
        if not isinstance(leaf, Column):
            raise TypeError(leaf)
        if leaf.sampling is not None:
            return sampled_column(leaf, leaf.sampling, value, tables, (table, positions))
        if leaf.row is RowChoice.KEYED:
            return column_numbers(tables[leaf.table], leaf.name)[keyed_rows(leaf, table, positions, tables)]
        if leaf.row is RowChoice.EACH and table is not None and leaf.table == table.name:
            numbers = column_numbers(table, leaf.name)
            return numbers if positions is None else numbers[positions]
        return chosen_number(leaf, tables)

    return value


def sampled_column(
    leaf: Column,
    sampling: Sampling,
    value: Lookup,
    tables: Mapping[str, Table],
    here: tuple[Table | None, Positions | None],
) -> Numbers:
    """A column in one of the rows around times that ``value`` knows for the rows ``here``; NaN beyond the span."""
    owner, (table, positions) = tables[sampling.table], here
    count = 1 if table is None else len(table) if positions is None else len(positions)
    parts, part = timed_for(sampling, owner, table, positions, count)
    at = np.broadcast_to(np.asarray(evaluate((sampling.at,), value)[0], dtype=np.float64), (count,))
    numbers, found = column_numbers(owner, leaf.name), np.full(count, np.nan)
    for number, each in enumerate(parts):
        chosen = (part == number) & (at >= each.times[0]) & (at <= each.times[-1])
        if chosen.any():
            rows = places_around(each.times, at[chosen])[leaf.row]
            found[chosen] = numbers[each.positions[rows]]
    return found


def keyed_rows(
    leaf: Column, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> Positions:
    """Positions, in the column's own table, of the rows that the keys of a KEYED column name; one for each row at hand.

    Raises:
        MbmError: a key that no row has.

    """
    owner = tables[leaf.table]
    place = {key: i for i, key in enumerate(owner.keys(owner.key))}
    member = leaf.member
    if isinstance(member, LiteralMember):
        cells: list[CellKey] = [member.key]
    else:
        cells = member_cells(member, table, positions, tables)
    found = np.array([place.get(cell, -1) for cell in cells], dtype=np.int64)
    if bool((found < 0).any()):
        row = int(np.argmax(found < 0))
        where: Place | None = leaf.span
        if table is not None and isinstance(member, ColumnMember) and member.row is RowChoice.EACH:
            where = table.place(int(positions[row]) if positions is not None else row, member.column)
        raise MbmError(faults.dangling_key(where, cells[row], f"the table `{owner.name}`", None, leaf.span))
    return found


def member_cells(
    member: ColumnMember | None, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> list[CellKey]:
    """The keys that ``member`` names, for each row at ``positions`` of ``table`` (None: for all)."""
    if member is None or (member.row is RowChoice.EACH and table is None):
        message = "a key is wanted where there is no row"
        raise TypeError(message)
    if member.row is RowChoice.EACH and table is not None:
        keys = static_cells(table, member.column)
        return keys if positions is None else [keys[i] for i in positions.tolist()]
    others = tables[member.table].keys(member.column)
    if not others:
        raise MbmError(faults.aggregate_of_nothing(None, member.table))
    return [others[chosen_place(member.row, len(others))]]


def chosen_number(leaf: Column, tables: Mapping[str, Table]) -> float:
    """The number of a row that is chosen, NaN where there are none; or how many there are."""
    if leaf.row is RowChoice.COUNT:
        return float(len(tables[leaf.table]))
    numbers = column_numbers(tables[leaf.table], leaf.name)
    if len(numbers) == 0:
        return float("nan")
    return float(numbers[chosen_place(leaf.row, len(numbers))])


def refuse_empty(written_out: Iterable[WrittenOut], tables: Mapping[str, Table]) -> None:
    """Refuse aggregates in constraints over tables that have no rows in this solve; a count is 0 then."""
    empty = [each for each in written_out if each.kind is not AggregateKind.COUNT and not len(tables[each.table])]
    if empty:
        raise MbmError(*(faults.aggregate_of_nothing(each.span, each.table) for each in empty))


def row_values(values: RowValues, tables: Mapping[str, Table]) -> Numbers:
    """The numbers of a form per row, shape (rows, components); (1, components) where there is no table."""
    table = tables[values.table] if values.table is not None else None
    count = len(table) if table is not None else 1
    width = len(values.cases[0].values) if values.cases else 1
    result = np.full((count, width), np.nan)
    for case in values.cases:
        positions = rows_of(case.static, table) if table is not None else np.arange(1)
        found = evaluate(case.values, lookup(table, positions, tables))
        for j, each in enumerate(found):
            result[positions, j] = each
    return result


def decided(values: RowValues, tables: Mapping[str, Table]) -> NDArray[np.bool_]:
    """Conditions per row, shape (rows, components).

    Raises:
        MbmError: a row whose condition depends on a cell that is missing; `(finite column)` is the way to ask. Where
            it asks for the row before and there is none, it does not hold.
    """
    found = row_values(values, tables)
    undecided = np.flatnonzero(np.isnan(found).any(axis=1))
    if undecided.size and values.table is not None and _looks_back(values):
        undecided = undecided[has_before(tables[values.table])[undecided]]
    if undecided.size:
        raise MbmError(*(_gap(values, tables, int(row)) for row in undecided[:MAXIMUM_REPORTED]))
    return np.asarray(found == 1)


def _looks_back(values: RowValues) -> bool:
    nodes = (node for case in values.cases for node in case.values)
    return looks_back(nodes, (case.static for case in values.cases))


def _gap(values: RowValues, tables: Mapping[str, Table], row: int) -> Diagnostic:
    """The cell that leaves a condition undecided."""
    table = tables[values.table] if values.table is not None else None
    for case in values.cases:
        if table is not None and row not in rows_of(case.static, table):
            continue
        for leaf in leaves(case.values):
            if isinstance(leaf, Column):
                value = lookup(table, None, tables)(leaf)
                position = chosen_place(leaf.row, len(tables[leaf.table]))
                if isinstance(value, np.ndarray):
                    position = row
                    value = value[row]
                owner = table if table is not None and leaf.table == table.name else tables[leaf.table]
                number = float(value)
                if np.isnan(number) and len(owner):
                    where = owner.place(position, leaf.name)
                    return faults.not_finite_cell(where, leaf.name, number, leaf.span, faults.Leave.ASKED)
    return faults.undecided(values.span)
