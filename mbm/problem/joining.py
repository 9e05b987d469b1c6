"""Tables as the equations see them: joined to one another, filtered, with one row for each member of a family."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.problem import faults
from mbm.problem.pairing import with_pairs
from mbm.problem.rows import MAXIMUM_REPORTED, decided
from mbm.problem.tables import CellKey, Column, Provenance, Table
from mbm.problem.types import Family, Join, Problem, RowValues, TablePlan
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, MbmError


def prepare(problem: Problem, raw: Mapping[str, Table]) -> dict[str, Table]:
    """The tables of a problem from those that were read: joins, filters, pairs, families.

    Raises:
        MbmError: a key that is in no row of the joined table.

    """
    tables: dict[str, Table] = {}
    for plan in problem.plans:
        tables[plan.name] = joined(raw[plan.name], plan.joins, {**raw, **tables})
    for plan in problem.plans:
        tables[plan.name] = filtered(plan, tables, plan.where)
    tables = with_pairs(tables, problem.pairs)
    return with_families(tables, tuple(u.family for u in problem.unknowns if u.family is not None))


def joined(table: Table, joins: tuple[Join, ...], tables: Mapping[str, Table]) -> Table:
    """``table`` with the columns of the tables whose keys it holds, called ``alias.column``."""
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
    index: dict[CellKey, int] = {key: i for i, key in enumerate(other.keys())}
    cells = column.texts if column.texts is not None else tuple(np.asarray(column.numbers).tolist())
    positions = np.empty(len(cells), dtype=np.int64)
    wrong: list[Diagnostic] = []
    for i, cell in enumerate(cells):
        position = index.get(cell)
        if position is None:
            near = closest(str(cell), [str(k) for k in index]) if isinstance(cell, str) else None
            place = table.place(i, column.name)
            wrong.append(faults.dangling_key(place, cell, f"the table `{other.name}`", near, join.span))
            if len(wrong) == MAXIMUM_REPORTED:
                break
        else:
            positions[i] = position
    if wrong:
        raise MbmError(*wrong)
    return positions


def filtered(plan: TablePlan, tables: Mapping[str, Table], where: RowValues | None) -> Table:
    """The rows of a table that its ``:where`` keeps."""
    table = tables[plan.name]
    if where is None:
        return table
    return table.take(np.flatnonzero(decided(where, tables)[:, 0]))


def with_families(tables: Mapping[str, Table], families: tuple[Family, ...]) -> dict[str, Table]:
    """``tables`` with, for each family over a column, a table of its distinct values in the order met."""
    result = dict(tables)
    for family in families:
        if family.column is not None and family.rows not in result:
            result[family.rows] = distinct(tables[family.table], family.column, family.rows)
    return result


def distinct(table: Table, column: str, name: str) -> Table:
    """One row for each distinct value of a column: the first that has it, with that column alone."""
    first: dict[CellKey, int] = {}
    for i, key in enumerate(table.keys(column)):
        first.setdefault(key, i)
    positions = np.fromiter(first.values(), dtype=np.int64, count=len(first))
    taken = table.columns[column].take(positions)
    rows = np.arange(1, len(positions) + 1)
    source = table.provenance
    file_rows = np.array([source.place(int(table.rows[p])).row or 0 for p in positions], dtype=np.int64)
    provenance = Provenance(
        path=source.path,
        sha256=source.sha256,
        rows=len(positions),
        file_rows=file_rows,
        source_columns=source.source_columns,
    )
    return Table(name=name, columns={column: taken}, rows=rows, provenance=provenance, key=column)


def depends_on_values(problem: Problem) -> bool:
    """Whether some equation was compiled for the value of a data cell, so that other data may need other equations."""
    cases = [case.static for block in problem.blocks for case in block.cases]
    cases += [case.static for each in problem.derived for case in each.cases]
    options = [block.when for block in problem.blocks] + [plan.where for plan in problem.plans]
    options += [column.sigma for block in problem.blocks for column in block.errors]
    for unknown in problem.unknowns:
        options += [unknown.start, unknown.lower, unknown.upper, unknown.fixed]
        options += [unknown.start_lower, unknown.start_upper]
    cases += [case.static for values in options if values is not None for case in values.cases]
    return any(cases) or any(not block.cases for block in problem.blocks)


def same_columns(old: Mapping[str, Table], new: Mapping[str, Table]) -> bool:
    """Whether the tables have columns of the same names and kinds."""

    def kinds(table: Table) -> dict[str, bool]:
        return {name: column.is_text for name, column in table.columns.items()}

    return all(kinds(old[name]) == kinds(new[name]) for name in old)
