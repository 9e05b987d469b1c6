"""Numbers for the rows of a table: which rows a case holds, and what data-only forms are worth there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from mbm.expression.evaluate import Lookup, Values, evaluate
from mbm.expression.nodes import Column, ColumnMember, Constant, Leaf, LiteralMember, Sampling, leaves
from mbm.expression.rows import RowChoice, chosen_place
from mbm.problem import faults
from mbm.problem.aggregates import WrittenOut
from mbm.problem.kinds import AggregateKind
from mbm.problem.previous import has_before, looks_back
from mbm.problem.tables import ROW, CellKey, Numbers, Table
from mbm.problem.times import places_around, timed_for
from mbm.problem.types import RowValues, Static
from mbm.text.types import Diagnostic, MbmError, Place

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
        cells = _member_cells(member, table, positions, tables)
    found = np.array([place.get(cell, -1) for cell in cells], dtype=np.int64)
    if bool((found < 0).any()):
        row = int(np.argmax(found < 0))
        where: Place | None = leaf.span
        if table is not None and isinstance(member, ColumnMember) and member.row is RowChoice.EACH:
            where = table.place(int(positions[row]) if positions is not None else row, member.column)
        raise MbmError(faults.dangling_key(where, cells[row], f"the table `{owner.name}`", None, leaf.span))
    return found


def _member_cells(
    member: ColumnMember | None, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> list[CellKey]:
    if member is None or (member.row is RowChoice.EACH and table is None):
        message = "a key is wanted where there is no row"
        raise TypeError(message)
    if member.row is RowChoice.EACH and table is not None:
        if member.column == ROW and ROW not in table.columns:
            keys: list[CellKey] = [float(r) for r in table.rows]
        else:
            keys = list(table.keys(member.column))
        return keys if positions is None else [keys[i] for i in positions]
    other = tables[member.table].keys(member.column)
    return [other[chosen_place(member.row, len(other))]]


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
                    return faults.not_finite_cell(owner.place(position, leaf.name), leaf.name, number, leaf.span)
    return faults.undecided(values.span)
