"""Tables as the equations see them: joined to one another, filtered, with those of families, grids and pairs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import repeat

import numpy as np

from mbm.problem import faults
from mbm.problem.grids import Grid
from mbm.problem.previous import with_rows_before
from mbm.problem.provenance import Part, Provenance
from mbm.problem.rows import MAXIMUM_REPORTED, decided
from mbm.problem.tables import CellKey, Column, Table, first_fault
from mbm.problem.types import Derived, Family, Join, Problem, RowValues, TablePlan
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, MbmError

Source = tuple[str, str]
"""A table and its column."""


def stacked(tables: Mapping[str, Table], sources: tuple[Source, ...], name: str) -> Table:
    """The rows of all sources, those of the first above; the values stand under each of the sources' names for them.

    Other columns stay if every source has them, with cells of one kind: those of ``for-each`` divide the rows as they
    divide the tables. The sources' columns have cells of one kind.
    """
    pieces = [tables[table] for table, _ in sources]
    named = dict.fromkeys(column for _, column in sources)
    columns = {each: _joined(each, [t.columns[c] for t, (_, c) in zip(pieces, sources, strict=True)]) for each in named}
    for each in pieces[0].columns:
        found = [table.columns[each] for table in pieces if each in table.columns]
        if each not in columns and len(found) == len(pieces) and len({c.texts is None for c in found}) == 1:
            columns[each] = _joined(each, found)
    count = sum(map(len, pieces))
    provenance = Provenance(
        path=pieces[0].provenance.path,
        sha256=None,
        rows=count,
        file_rows=np.arange(1, count + 1),
        parts=tuple(Part(provenance=table.provenance, rows=table.rows) for table in pieces),
    )
    return Table(name=name, columns=columns, rows=np.arange(1, count + 1), provenance=provenance)


def _joined(name: str, columns: list[Column]) -> Column:
    if any(c.texts is not None for c in columns):
        texts = tuple(text for c in columns for text in c.texts or ())
        return Column(name=name, texts=texts, fault=first_fault(columns))
    return Column(name=name, numbers=np.concatenate([c.numbers for c in columns if c.numbers is not None]))


def with_families(tables: Mapping[str, Table], families: tuple[Family, ...]) -> dict[str, Table]:
    """``tables`` with, for each family over columns, a table of their distinct values in the order met."""
    result = dict(tables)
    for family in families:
        if family.sources and family.table not in result:
            result[family.table] = stacked(tables, family.sources, family.table)
        if family.column is not None and family.rows not in result:
            result[family.rows] = distinct(result[family.table], family, family.rows)
    return result


def distinct(table: Table, family: Family, name: str) -> Table:
    """One row for each distinct value of a family's column: the first that has it, with that column alone.

    A stacked column keeps its other names.

    Raises:
        MbmError: the family is ordered, and a cell is no number.

    """
    column = str(family.column)
    if family.ordered:
        positions = _ascending(table, column)
    else:
        first: dict[CellKey, int] = {}
        for i, key in enumerate(table.keys(column)):
            if key == key:  # a cell without a number is no member
                first.setdefault(key, i)
        positions = np.fromiter(first.values(), dtype=np.int64, count=len(first))
    taken = {each: table.columns[each].take(positions) for each in family.names}
    rows = np.arange(1, len(positions) + 1)
    provenance = table.provenance.taking(table.rows[positions])
    return Table(name=name, columns=taken, rows=rows, provenance=provenance, key=column)


def _ascending(table: Table, column: str) -> np.ndarray:
    """The positions of the first row with each value of a column of numbers, by value."""
    values = table.numbers(column)
    wrong = np.flatnonzero(~np.isfinite(values))[:MAXIMUM_REPORTED].tolist()
    if wrong:
        raise MbmError(*(faults.not_finite_cell(table.place(i, column), column, float(values[i]), None) for i in wrong))
    return np.unique(values, return_index=True)[1]


def prepare(problem: Problem, raw: Mapping[str, Table]) -> dict[str, Table]:
    """The tables of a problem from those that were read: joins, filters, pairs, families.

    Raises:
        MbmError: a key that is in no row of the joined table.

    """
    tables = unfiltered(problem, raw)
    for plan in problem.plans:
        tables[plan.name] = filtered(plan, tables, plan.where)
    if problem.pairs:
        # Loaded by problems with pairs only, so that the others start at once.
        from mbm.problem.pairing import with_pairs

        tables = with_pairs(tables, problem.pairs)
        for name in {pair.name for pair in problem.pairs} & set(problem.earlier):
            tables[name] = with_rows_before(tables[name], problem.request.for_each)
    tables = with_families(tables, tuple(u.family for u in problem.unknowns if u.family is not None))
    tables |= grid_tables(problem.derived)
    if problem.sequence is not None:
        from mbm.problem.sequence.tables import transitions_table

        tables[problem.sequence.reached] = transitions_table(problem.sequence, tables)
    return tables


def grid_rows(grid: Grid) -> Table:
    """The table that a grid makes, its values in SI."""
    symbol = grid.unit.symbol if grid.unit is not None else None
    column = Column(name=grid.variable, numbers=grid.scale.to_si(grid.shown()), unit=symbol)
    rows = np.arange(1, grid.count + 1)
    provenance = Provenance(path=grid.table, sha256=None, rows=grid.count, file_rows=rows, inline=True)
    return Table(name=grid.table, columns={grid.variable: column}, rows=rows, provenance=provenance, key=grid.variable)


def grid_tables(derived: Iterable[Derived]) -> dict[str, Table]:
    """The tables that the grids of derived quantities make."""
    grids = {each.grid.table: each.grid for each in derived if each.grid is not None}
    return {name: grid_rows(grid) for name, grid in grids.items()}


def unfiltered(problem: Problem, raw: Mapping[str, Table]) -> dict[str, Table]:
    """The tables that were read, joined to one another, with the rows that ``:where`` will take away."""
    tables: dict[str, Table] = {}
    for plan in problem.plans:
        tables[plan.name] = joined(raw[plan.name], plan.joins, {**raw, **tables})
    for name in problem.earlier:
        if name in tables:
            tables[name] = with_rows_before(tables[name], problem.request.for_each)
    return tables


def joined(table: Table, joins: tuple[Join, ...], tables: Mapping[str, Table]) -> Table:
    """``table`` with the columns of the tables whose keys it holds, called ``alias.column``."""
    if not joins:
        return table
    columns = dict(table.columns)
    groups = dict(table.groups)
    names = dict(table.provenance.source_columns)
    for join in joins:
        other = tables.get(join.table)
        if other is None:
            raise MbmError(faults.unknown_table(join.span, join.table, tuple(tables)))
        if other.key is None:
            raise MbmError(faults.table_without_key(join.span, other.name))
        if join.column not in columns:
            raise MbmError(faults.unknown_column(join.span, join.column, table.name, tuple(columns)))
        positions = _positions(table, columns[join.column], other, join)
        for column in other.columns.values():
            name = f"{join.alias}.{column.name}"
            columns[name] = replace(column.take(positions), name=name)
            names[name] = names.get(join.column, join.column)
        groups.update(other.groups_called(join.alias))
    provenance = replace(table.provenance, source_columns=names)
    return replace(table, columns=columns, provenance=provenance, groups=groups)


def _positions(table: Table, column: Column, other: Table, join: Join) -> np.ndarray:
    """The position in the ``other`` table of the row that each cell of the column names."""
    column.check()
    keys = other.columns[other.key].numbers if other.key is not None else None
    if keys is not None and column.numbers is not None and len(keys):
        order = np.argsort(keys, kind="stable")
        at = np.minimum(np.searchsorted(keys, column.numbers, sorter=order), len(keys) - 1)
        positions = np.where(keys[order[at]] == column.numbers, order[at], -1)
    else:
        index: dict[CellKey, int] = {key: i for i, key in enumerate(other.keys())}
        cells = column.texts if column.texts is not None else np.asarray(column.numbers).tolist()
        positions = np.fromiter(map(index.get, cells, repeat(-1)), dtype=np.int64, count=len(cells))
    wrong = np.flatnonzero(positions < 0)[:MAXIMUM_REPORTED].tolist()
    if wrong:
        raise MbmError(*(_dangling(table, column, int(i), other, join) for i in wrong))
    return positions


def _dangling(table: Table, column: Column, row: int, other: Table, join: Join) -> Diagnostic:
    """A key that no row of the ``other`` table has."""
    cell = column.cell(row)
    keys = other.keys()
    near = closest(cell, [str(key) for key in keys]) if isinstance(cell, str) else None
    where = f"the table `{other.name}`"
    return faults.dangling_key(table.place(row, column.name), cell, where, near, join.span, joined=True)


def filtered(plan: TablePlan, tables: Mapping[str, Table], where: RowValues | None) -> Table:
    """The rows of a table that its ``:where`` keeps."""
    table = tables[plan.name]
    if where is None:
        return table
    return table.take(np.flatnonzero(decided(where, tables)[:, 0]))
