"""Tables as the equations see them: joined to one another, filtered, with those of grids, pairs and families."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import repeat

import numpy as np

from mbm.problem import faults
from mbm.problem.families import with_families
from mbm.problem.grids import Grid
from mbm.problem.previous import with_rows_before
from mbm.problem.rows import MAXIMUM_REPORTED, decided
from mbm.problem.tables import CellKey, Column, Provenance, Table
from mbm.problem.types import Derived, Join, Problem, RowValues, TablePlan
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, MbmError


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
            taken = column.take(positions)
            columns[name] = Column(name=name, numbers=taken.numbers, texts=taken.texts, unit=taken.unit)
            names[name] = names.get(join.column, join.column)
        groups.update(other.groups_called(join.alias))
    provenance = replace(table.provenance, source_columns=names)
    return replace(table, columns=columns, provenance=provenance, groups=groups)


def _positions(table: Table, column: Column, other: Table, join: Join) -> np.ndarray:
    """The position in the ``other`` table of the row that each cell of the column names."""
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
    return faults.dangling_key(table.place(row, column.name), cell, f"the table `{other.name}`", near, join.span)


def filtered(plan: TablePlan, tables: Mapping[str, Table], where: RowValues | None) -> Table:
    """The rows of a table that its ``:where`` keeps."""
    table = tables[plan.name]
    if where is None:
        return table
    return table.take(np.flatnonzero(decided(where, tables)[:, 0]))
