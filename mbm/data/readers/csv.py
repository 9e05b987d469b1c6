"""CSV: cells separated by commas."""

from __future__ import annotations

from pathlib import Path

from mbm.data.readers.delimited import read_delimited
from mbm.data.types import RawTable, Reader


def read(path: Path) -> RawTable:
    """Read a CSV file; faults as ``read_delimited`` has them."""
    return read_delimited(path, ",")


READER = Reader(name="csv", extensions=(".csv",), read=read)
