"""InlineTable → RawTable: the rows written in a problem. Rows are numbered by their lines in the problem file."""

from __future__ import annotations

import numpy as np

from mbm.data import faults
from mbm.data.cells import mixed_column
from mbm.data.columns import check_names
from mbm.data.types import RawTable
from mbm.problem.tables import InlineTable
from mbm.text.types import MbmError, Span


def table_from_inline(inline: InlineTable, span: Span) -> RawTable:
    """The table that the data clause at ``span`` holds; its path is the problem file's name.

    Raises MbmError with the place in the problem: no-columns, bad-column-name, duplicate-column, and all rows with
    short-row or long-row.
    """
    names = check_names(inline.columns, span)
    found = []
    for number, (row, place) in enumerate(zip(inline.rows, inline.spans, strict=True), start=1):
        if len(row) < len(names):
            found.append(faults.short_row(place, number, len(row), names))
        elif len(row) > len(names):
            found.append(faults.long_row(place, number, len(row), names))
    if found:
        raise MbmError(*found)
    columns = tuple(mixed_column(name, [row[i] for row in inline.rows]) for i, name in enumerate(names))
    lines = np.array([place.line for place in inline.spans], dtype=np.int64)
    lines.setflags(write=False)
    return RawTable(path=span.source.name, sha256=None, columns=columns, file_rows=lines)
