"""TSV: cells separated by tabulators."""

from __future__ import annotations

from pathlib import Path

from mbm.data.readers.delimited import read_delimited
from mbm.data.types import RawTable, Reader


def read(path: Path) -> RawTable:
    """Read a TSV file; faults as ``read_delimited`` has them."""
    return read_delimited(path, "\t")


READER = Reader(name="tsv", extensions=(".tsv", ".tab"), read=read)
