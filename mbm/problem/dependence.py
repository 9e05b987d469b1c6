"""What the equations of a problem depend on in its tables: their columns, and the values that decided something.

A problem is elaborated for tables. With other tables the equations are the same if these have the same columns and
answer the same wherever elaboration asked for a value (`Consulted`): the elaboration would take the same course.
"""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from typing import TypeAlias

import numpy as np

from mbm.problem.elaborated import Consulted, Grouping
from mbm.problem.joining import unfiltered
from mbm.problem.rows import decided, static_cells
from mbm.problem.tables import Table
from mbm.problem.types import Problem

Facts: TypeAlias = tuple[object, ...]
"""Compared with one another, or printed: equal facts, equal text."""


def columns_of(raw: Mapping[str, Table]) -> Facts:
    """The columns of tables: names, kinds, units, groups, keys, and which of them hold no number: no ``:init``."""
    return tuple(
        (
            name,
            table.key,
            tuple((column.name, column.is_text, column.unit, column.only_gaps) for column in table.columns.values()),
            tuple((name, group.shape, group.columns) for name, group in table.groups.items()),
        )
        for name, table in raw.items()
    )


def decisive(problem: Problem, consulted: Consulted, raw: Mapping[str, Table], tables: Mapping[str, Table]) -> Facts:
    """The answers of the tables to what elaboration asked: ``raw`` as read, ``tables`` as `prepare` makes them.

    Raises:
        MbmError: a condition without a value, a key that no row has.

    """
    found: list[object] = []
    if consulted.everything:
        found.extend((name, _content(table)) for name, table in raw.items())
    whole = _unfiltered(problem, consulted, raw)
    for grouping in consulted.groupings:
        table = (tables if grouping.filtered else whole)[grouping.table]
        found.append((grouping.table, grouping.columns, _combinations(grouping, table, tables)))
    found.extend((name, _keys(tables[name])) for name in consulted.keyed)
    return tuple(found)


def _combinations(grouping: Grouping, table: Table, tables: Mapping[str, Table]) -> Facts:
    """The values that rows have in the columns of a grouping, each combination once, in the order met."""
    cells = zip(*(static_cells(table, column) for column in grouping.columns), strict=True)
    if grouping.when is not None:
        kept = decided(grouping.when, tables)[:, 0].tolist()
        return tuple(dict.fromkeys(row for row, keep in zip(cells, kept, strict=True) if keep))
    return tuple(dict.fromkeys(cells))


def _keys(table: Table) -> Facts:
    return tuple(sorted(set(table.keys(table.key)), key=repr))


def _unfiltered(problem: Problem, consulted: Consulted, raw: Mapping[str, Table]) -> dict[str, Table]:
    """The tables joined to one another, with the rows that ``:where`` will take away; none if nobody asked for them."""
    if all(grouping.filtered for grouping in consulted.groupings):
        return {}
    return unfiltered(problem, raw)


def _content(table: Table) -> Facts:
    """Digests of all cells."""
    found: list[object] = []
    for column in table.columns.values():
        digest = sha256()
        if column.texts is not None:
            digest.update(repr(column.texts).encode("utf-8", errors="surrogatepass"))
        else:
            digest.update(np.ascontiguousarray(column.numbers).tobytes())
        found.append((column.name, digest.hexdigest()))
    return tuple(found)
