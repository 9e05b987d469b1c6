"""RawTable → Table: what a data clause says of a table's columns, gaps and key is done to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import frozen
from mbm.data.columns import row_numbers
from mbm.data.types import RawTable
from mbm.problem.tables import Column, ColumnDeclaration, Table, TableDeclaration
from mbm.text.types import Diagnostic, Label, MbmError


def shape(raw: RawTable, declaration: TableDeclaration) -> Table:
    """The table of a data clause: columns renamed, units turned into SI, rows with gaps left out, keys checked.

    Raises MbmError: missing-column, duplicate-column, not-a-number, empty-column, missing-key, duplicate-key.
    """
    columns = _renamed(raw, declaration)
    names = {declared.source: declared.name for declared in declaration.columns}
    key = declaration.key
    if key is None and raw.key is not None:
        key = names.get(raw.key, raw.key)
    provenance = raw.provenance({declared.name: declared.source for declared in declaration.columns})
    table = Table(
        name=declaration.name,
        columns=columns,
        rows=row_numbers(1, len(raw.file_rows)),
        provenance=provenance,
        key=key,
        groups={name: group.renamed(names) for name, group in raw.groups.items()},
    )
    if declaration.skip_missing:
        table = _without_gaps(table)
    if key is not None:
        _check_key(table, key, declaration)
    return table


def _renamed(raw: RawTable, declaration: TableDeclaration) -> dict[str, Column]:
    """The declared columns under their new names and in SI, then the other columns as they are."""
    found: list[Diagnostic] = []
    present = {column.name: column for column in raw.columns}
    columns: dict[str, Column] = {}
    for declared in declaration.columns:
        source = present.get(declared.source)
        if source is None:
            found.append(faults.missing_column(declared.span, declared.source, raw.path, present))
        elif declared.name in columns:
            found.append(faults.duplicate_column(declared.span, declared.name))
        elif declared.unit is not None and source.is_text:
            found.append(_text_cell(source, declared, declared.unit, raw))
        else:
            columns[declared.name] = _in_si(source, declared)
    used = {declared.source for declared in declaration.columns}
    for name, column in present.items():
        if name in used:
            continue
        if name in columns:
            renamed = next(declared for declared in declaration.columns if declared.name == name)
            found.append(faults.duplicate_column(renamed.span, name))
        else:
            columns[name] = column
    if found:
        raise MbmError(*found)
    return columns


def _in_si(column: Column, declared: ColumnDeclaration) -> Column:
    """The column with its new name, its numbers in SI."""
    numbers = column.numbers
    if numbers is not None and not declared.scale.is_si:
        numbers = frozen(declared.scale.to_si(numbers))
    return replace(column, name=declared.name, numbers=numbers, unit=declared.unit or column.unit)


def _text_cell(column: Column, declared: ColumnDeclaration, unit: str, raw: RawTable) -> Diagnostic:
    position = column.first_text() or 0
    cell = "" if column.texts is None else column.texts[position]
    place = raw.provenance().place(position + 1, column.name)
    return faults.not_a_number(place, cell, unit, declared.span)


def _without_gaps(table: Table) -> Table:
    """The rows in which every column of numbers has one. A column without any value would take all rows with it."""
    kept = np.ones(len(table), dtype=bool)
    for column in table.columns.values():
        if column.numbers is None:
            continue
        gaps = np.isnan(column.numbers)
        if len(table) > 0 and gaps.all():
            place = replace(table.provenance.place(1, column.name), row=None)
            raise MbmError(faults.empty_column(place))
        kept &= ~gaps
    return table if kept.all() else table.take(np.flatnonzero(kept).astype(np.int64))


def _check_key(table: Table, key: str, declaration: TableDeclaration) -> None:
    """Check that the key column is there, and that each row has a key that no other row has."""
    column = table.columns.get(key)
    if column is None:
        path = table.provenance.path
        raise MbmError(faults.missing_column(declaration.span, key, path, table.columns))
    label = Label(declaration.span, f"`{key}` is the key of `{declaration.name}` here")
    found = [faults.missing_key(table.place(int(i), key)) for i in _gaps(column)[: faults.MOST_ROWS_REPORTED]]
    if not found:
        found = _duplicates(table, column)
    if found:
        raise MbmError(*(replace(fault, labels=(*fault.labels, label)) for fault in found))


def _gaps(column: Column) -> NDArray[np.int64]:
    """The positions of the gaps in a column."""
    if column.numbers is not None:
        return np.flatnonzero(np.isnan(column.numbers)).astype(np.int64)
    return np.array([i for i, text in enumerate(column.texts or ()) if not text], dtype=np.int64)


def _duplicates(table: Table, column: Column) -> list[Diagnostic]:
    """A fault for each of the first few rows whose key an earlier row has."""
    keys = table.keys(column.name)
    if len(set(keys)) == len(keys):
        return []
    first: dict[str | float, int] = {}
    found: list[Diagnostic] = []
    for position, key in enumerate(keys):
        earlier = first.setdefault(key, position)
        if earlier != position:
            places = table.place(position, column.name), table.place(earlier, column.name)
            found.append(faults.duplicate_key(*places, key))
            if len(found) == faults.MOST_ROWS_REPORTED:
                break
    return found
