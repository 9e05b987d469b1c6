"""``:per (A.c B.d)``: the values of several columns, one below the other, so that a family may go over all of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.problem.tables import Column, Part, Provenance, Table

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
