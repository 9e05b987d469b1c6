"""Parquet: columns of numbers and of texts, by pyarrow (``pip install "mbm[tables]"``). Records count from 1."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np

from mbm.data.cells import column_from_array, column_from_values
from mbm.data.columns import check_names, counted_table
from mbm.data.content import read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable, Reader
from mbm.problem.tables import Column
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError


def read(path: Path) -> RawTable:
    """Read a Parquet file.

    Raises MbmError as ``read_bytes`` does, and missing-extra, malformed-parquet, no-columns, bad-column-name,
    duplicate-column, bad-cell.
    """
    content, digest = read_bytes(path)
    shown = path.as_posix()
    place = DataPlace(file=shown)
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MbmError(missing_extra("the format `parquet`", "tables", place)) from None
    try:
        found = parquet.read_table(BytesIO(content), memory_map=False)
        arrays = found.columns
    except (pa.ArrowException, OSError, ValueError) as error:
        raise MbmError(format_faults.malformed_parquet(place, str(error).splitlines()[0])) from None
    names = check_names(found.column_names, place)
    columns = tuple(_column(name, array, shown) for name, array in zip(names, arrays, strict=True))
    return counted_table(shown, digest, columns)


def _column(name: str, array: object, path: str) -> Column:
    """The column of a chunked array; what is null becomes a gap."""
    import pyarrow as pa

    if not isinstance(array, pa.ChunkedArray):
        raise TypeError(array)
    kind = array.type
    if pa.types.is_floating(kind) or (pa.types.is_integer(kind) and array.null_count == 0):
        return column_from_array(name, np.asarray(array.to_numpy(), dtype=np.float64), path)
    return column_from_values(name, array.to_pylist(), path)


READER = Reader(name="parquet", extensions=(".parquet",), read=read)
