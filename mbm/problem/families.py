"""One row for each member of a family: the values of a column, or of several that are put one below the other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.problem import faults
from mbm.problem.rows import MAXIMUM_REPORTED
from mbm.problem.tables import CellKey, Column, Part, Provenance, Table
from mbm.problem.types import Family
from mbm.text.types import MbmError

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
        return Column(name=name, texts=tuple(text for c in columns for text in c.texts or ()))
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
