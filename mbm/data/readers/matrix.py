"""A square matrix of numbers between commas, without a header: column ``j`` of the table is that of the matrix."""

from __future__ import annotations

from pathlib import Path

from mbm.data.content import read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import line_numbers, lines_of, number_columns, number_table
from mbm.data.types import RawTable, Reader
from mbm.text.types import DataPlace, MbmError

MOST_ROWS = 2000
"""Rows of a matrix: 32 MB of numbers, and a second for a decomposition."""


def read(path: Path) -> RawTable:
    """Read a matrix.

    Raises MbmError as ``read_text`` does, and short-row, long-row, malformed-record (also for a matrix that is not
    square, or larger than `MOST_ROWS`).
    """
    text, digest = read_text(path)
    shown = path.as_posix()
    lines = lines_of(text, separator=",")
    if not 0 < len(lines) <= MOST_ROWS:
        what = "it holds no numbers" if not lines else f"it has {len(lines)} rows, more than {MOST_ROWS}"
        raise MbmError(format_faults.malformed_record(DataPlace(file=shown, row=1), what))
    names = tuple(str(number) for number in range(1, len(lines) + 1))
    numbers = number_table(lines, names, shown)
    rows = line_numbers(number for number, _ in lines)
    return RawTable(path=shown, sha256=digest, columns=number_columns(names, numbers), file_rows=rows)


READER = Reader(name="matrix", extensions=(), read=read)
