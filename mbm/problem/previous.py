"""``(previous FORM)``: the row before, in the order of the unfiltered table, as columns of the row at hand.

Column ``previous(x)`` of a table holds the ``x`` of the row before; the first row of a key has none. ``previous()``
holds that row's number.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mbm.expression.nodes import Column, ColumnMember, Component, Expression, leaves
from mbm.problem.provenance import Origin
from mbm.problem.tables import SOURCE, CellKey, Column as TableColumn, Table

_BEFORE = "previous("
_ROW = f"{_BEFORE})"
_PLACE, _CHAIN = f"{_BEFORE}:place)", f"{_BEFORE}:chain)"


def name_before(column: str) -> str:
    """What the column is called that holds ``column`` of the row before; no user's column is, for its bracket."""
    return f"{_BEFORE}{column})"


def row_before() -> str:
    """What the column of the row's number is called."""
    return _ROW


def column_before(name: str) -> str | None:
    """The column of which ``name`` holds the row before; None if it is none of these."""
    return name.removeprefix(_BEFORE).removesuffix(")") if name.startswith(_BEFORE) else None


def mentions_before(names: Iterable[str]) -> bool:
    """Whether one of some columns is of the row before."""
    return any(name.startswith(_BEFORE) for name in names)


def looks_back(nodes: Iterable[Expression], statics: Iterable[tuple[tuple[str, CellKey], ...]] = ()) -> bool:
    """Whether expressions take something of the row before, or a member of a family that it names.

    ``statics`` are the values of static columns that tell the expressions of some rows from those of others.
    """
    names = [name for static in statics for name, _ in static]
    for leaf in leaves(tuple(nodes)):
        names += [leaf.name] if isinstance(leaf, Column) else []
        if isinstance(leaf, Column | Component) and isinstance(leaf.member, ColumnMember):
            names.append(leaf.member.column)
    return mentions_before(names)


def has_before(table: Table) -> np.ndarray:
    """Mask of the rows (n,) that have one before them; all, where nobody asked for it."""
    column = table.columns.get(_ROW)
    return np.isfinite(table.numbers(_ROW)) if column is not None else np.ones(len(table), dtype=bool)


def with_rows_before(table: Table, keys: tuple[str, ...]) -> Table:
    """A table as it is before any row is left out, with the columns of the row before; ``keys`` divide it.

    Columns of files that happen to be called like these cannot be meant, and are left out.
    """
    if _ROW in table.provenance.origins:
        return table
    divided = tuple(key for key in (*keys, SOURCE) if key in table.columns)
    before = _positions(_cells(table, divided))
    there = before >= 0
    own = {name: column for name, column in table.columns.items() if column_before(name) is None}
    columns, origins = dict(own), dict(table.provenance.origins)
    columns[_ROW] = TableColumn(name=_ROW, numbers=np.where(there, table.rows[before], np.nan))
    place, chain = _places_in_chains(table, divided)
    columns[_PLACE] = TableColumn(name=_PLACE, numbers=place)
    columns[_CHAIN] = TableColumn(name=_CHAIN, numbers=chain)
    rows = np.zeros(int(table.rows.max(initial=0)), dtype=np.int64)  # also of rows that are not there, as gaps
    rows[table.rows - 1] = table.rows[before]
    origins[_ROW] = Origin(provenance=table.provenance, rows=rows, column="row")
    for name, column in own.items():
        taken, called = column.take(before), name_before(name)
        if taken.numbers is not None:
            taken = replace(taken, numbers=np.where(there, taken.numbers, np.nan))
        elif taken.texts is not None:
            texts = (text if known else "" for text, known in zip(taken.texts, there.tolist(), strict=True))
            taken = replace(taken, texts=tuple(texts))
        columns[called] = replace(taken, name=called)
        origins[called] = Origin(provenance=table.provenance, rows=rows, column=name)
    return replace(table, columns=columns, provenance=replace(table.provenance, origins=origins))


def chains(table: Table) -> tuple[np.ndarray, np.ndarray]:
    """The key (n,) that each row belongs to, as a number, and the row's place in it before any row was left out."""
    return table.numbers(_CHAIN), table.numbers(_PLACE)


def _places_in_chains(table: Table, keys: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Of each row (n,) the place in its key and the key's number; rows that were left out for a gap count as places."""
    gaps = table.gaps if table.gaps is not None and all(key in table.gaps.columns for key in keys) else None
    cells, order = _cells(table, keys), np.arange(len(table))
    if gaps is not None:
        order = np.argsort(np.concatenate([table.rows, gaps.rows]))
        both = cells + _cells(gaps, keys)
        cells = [both[i] for i in order.tolist()]
    place, chain, count = np.zeros(len(cells)), np.zeros(len(cells)), 0
    for row, last in enumerate(_positions(cells).tolist()):
        if last < 0:
            chain[row], count = count, count + 1
        else:
            place[row], chain[row] = place[last] + 1, chain[last]
    own = np.argsort(order)[: len(table)]
    return place[own], chain[own]


def _cells(table: Table, keys: tuple[str, ...]) -> list[tuple[CellKey, ...]]:
    """What each row has in the columns that divide the table."""
    return list(zip(*(table.keys(key) for key in keys), strict=True)) if keys else [()] * len(table)


def _positions(cells: list[tuple[CellKey, ...]]) -> np.ndarray:
    """The position (n,) of the row before each with the same cells, -1 for the first."""
    found = np.full(len(cells), -1, dtype=np.int64)
    last: dict[tuple[CellKey, ...], int] = {}
    for position, own in enumerate(cells):
        found[position] = last.get(own, -1)
        last[own] = position
    return found
