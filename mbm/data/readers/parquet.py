"""Parquet: columns of numbers and of texts, by pyarrow (``pip install "mbm[tables]"``). Records count from 1.

A file of a few kilobytes may hold hundreds of millions of rows: what they take is worked out from the metadata before
any is read. Then some rows are read after the others, texts as numbers of entries in a dictionary.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from mbm.data.cells import check_names, column_from_array, column_from_values, counted_table, unreadable
from mbm.data.content import PER_ROW, check_numbers, check_table, read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.types import RawTable, Reader
from mbm.files.memory import PER_VALUE
from mbm.problem.tables import Column
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, Diagnostic, MbmError

ROWS_AT_ONCE, FEW_ROWS = 65_536, 16
"""Rows that are read together: few where a cell may hold lists, of which the first ends the reading."""

PER_NUMBER = 24
"""Bytes for a number: in its part, in the column, and once more while parts are joined."""


def read(path: Path) -> RawTable:
    """Read a Parquet file.

    Raises MbmError as ``read_bytes`` and ``check_numbers`` do, and missing-extra, malformed-parquet, no-columns,
    too-many-columns, bad-column-name, duplicate-column, too-much-memory.
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
        schema = parquet.read_schema(BytesIO(content))
        names = check_names(schema.names, place)
        kinds = dict(zip(names, schema.types, strict=True))
        texts = [name for name, kind in kinds.items() if _is_text(kind)]
        with parquet.ParquetFile(BytesIO(content), memory_map=False, read_dictionary=texts) as file:
            _check_size(file.metadata, kinds, path, len(content))
            parts = [_Part(name, shown) for name in names]
            at_once = ROWS_AT_ONCE if all(map(_is_flat, schema.types)) else FEW_ROWS
            for batch in file.iter_batches(batch_size=at_once):
                for part, array in zip(parts, batch.columns, strict=True):
                    part.take(array)
    except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is damaged"
        raise MbmError(format_faults.malformed_parquet(place, reason)) from None
    return counted_table(shown, digest, [part.column() for part in parts])


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))


def _is_text(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _is_flat(kind: Any) -> bool:
    """Whether a cell is of bounded size, or a text, which is read as the number of an entry in a dictionary."""
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        return _is_flat(kind.value_type)
    return bool(_is_text(kind) or pa.types.is_null(kind) or pa.types.is_primitive(kind) or pa.types.is_decimal(kind))


def _check_size(metadata: Any, kinds: dict[str, Any], path: Path, packed: int) -> None:
    """Refuse what would not fit the memory, or is too much for so many ``packed`` bytes, as far as the metadata tell.

    Raises:
        MbmError: file-too-large, too-much-memory.

    """
    rows = max(int(metadata.num_rows), 0)
    # Not the sizes of the columns: asking for damaged ones ends the process (ColumnChunkMetaData throws, uncaught).
    unpacked = sum(max(int(metadata.row_group(k).total_byte_size), 0) for k in range(metadata.num_row_groups))
    row = PER_ROW + sum(PER_NUMBER if _is_number(kind) else PER_VALUE for kind in kinds.values())
    check_table(path, rows * len(kinds), rows * row + 2 * unpacked)
    check_numbers(path, packed, rows * len(kinds))


class _Part:
    """One column while it is read."""

    def __init__(self, name: str, path: str) -> None:
        self._name, self._path = name, path
        self._numbers: list[np.ndarray[Any, np.dtype[np.float64]]] = []
        self._values: list[object] = []
        self._fault: Diagnostic | None = None

    def take(self, array: Any) -> None:
        """Some more rows; what is null becomes a gap. Cells that may be as large as tables are not kept."""
        import pyarrow as pa

        if self._fault is not None:
            self._values.extend([None] * len(array))
        elif _is_number(array.type):
            self._numbers.append(np.asarray(array.to_numpy(zero_copy_only=False), dtype=np.float64))
        elif pa.types.is_dictionary(array.type):
            entries = [*array.dictionary.to_pylist(), None]
            places = array.indices.fill_null(len(entries) - 1).to_pylist()
            self._values.extend(entries[place] for place in places)
        else:
            self._values.extend(array.to_pylist())
            if not _is_flat(array.type) and array.null_count < len(array):
                self._fault = column_from_values(self._name, self._values, self._path).fault
                self._values = [None] * len(self._values)

    def column(self) -> Column:
        """All rows."""
        if self._numbers:
            return column_from_array(self._name, np.concatenate(self._numbers), self._path)
        if self._fault is not None:
            return unreadable(self._name, len(self._values), self._fault)
        return column_from_values(self._name, self._values, self._path)


READER = Reader(name="parquet", extensions=(".parquet",), read=read)
