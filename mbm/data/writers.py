"""Columns → the bytes of a data file, such that its reader gives the same columns back, to the last bit.

Texts stay as they are for that: a spreadsheet takes a cell that begins with ``= + - @`` for a formula.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO, StringIO
from types import MappingProxyType
from typing import TextIO

import numpy as np

from mbm.problem.tables import Column

Writer = Callable[[Sequence[Column]], bytes]


def _cells(column: Column) -> list[str]:
    """Numbers in the shortest decimals that read back as the same number; gaps are empty."""
    if column.texts is not None:
        return list(column.texts)
    numbers = [] if column.numbers is None else column.numbers.tolist()
    return ["" if math.isnan(n) else _short(n) for n in numbers]


def _short(number: float) -> str:
    return format(number, ".0f") if number.is_integer() and abs(number) < 2**53 else repr(number)


class DelimitedLines:
    """Writes rows of cells to a stream (one opened with ``newline=""``), line by line, each ended by a line feed.

    A cell with a carriage return in it is quoted, which Python's own writer does only where lines end with one.
    """

    def __init__(self, stream: TextIO, separator: str = ",") -> None:
        self._stream = stream
        writer = csv.writer(self, delimiter=separator, lineterminator=_LINE_END)
        self.row, self.rows = writer.writerow, writer.writerows

    def write(self, line: str) -> int:
        """Pass a line on that Python's writer made."""
        return self._stream.write(line.removesuffix(_LINE_END) + "\n")


_LINE_END = "\r\n"


def _delimited(columns: Sequence[Column], separator: str) -> bytes:
    stream = StringIO(newline="")
    lines = DelimitedLines(stream, separator)
    lines.row([column.name for column in columns])
    lines.rows(zip(*map(_cells, columns), strict=True))
    return stream.getvalue().encode("utf-8")


def write_csv(columns: Sequence[Column]) -> bytes:
    """Comma-separated values with a header."""
    return _delimited(columns, ",")


def write_tsv(columns: Sequence[Column]) -> bytes:
    """Tabulator-separated values with a header."""
    return _delimited(columns, "\t")


def write_json(columns: Sequence[Column]) -> bytes:
    """An object of arrays; gaps are null."""
    content = {column.name: _json_cells(column) for column in columns}
    return (json.dumps(content, ensure_ascii=False) + "\n").encode("utf-8")


def _json_cells(column: Column) -> list[object]:
    if column.texts is not None:
        return [text or None for text in column.texts]
    numbers = [] if column.numbers is None else column.numbers.tolist()
    return [None if math.isnan(n) else int(n) if n.is_integer() and abs(n) < 2**53 else n for n in numbers]


def write_npz(columns: Sequence[Column]) -> bytes:
    """An archive of one array for each column, as ``numpy.savez`` writes it, with a fixed date in its entries."""
    from zipfile import ZIP_STORED, ZipFile, ZipInfo

    stream = BytesIO()
    with ZipFile(stream, "w", ZIP_STORED) as archive:
        for column in columns:
            member = BytesIO()
            array = np.array(column.texts) if column.texts is not None else np.asarray(column.numbers)
            np.lib.format.write_array(member, array, allow_pickle=False)
            archive.writestr(ZipInfo(f"{column.name}.npy"), member.getvalue())
    return stream.getvalue()


def write_matrix(columns: Sequence[Column]) -> bytes:
    """Numbers between commas, without a header."""
    lines = zip(*([] if c.numbers is None else c.numbers.tolist() for c in columns), strict=True)
    return "".join(f"{','.join(map(repr, line))}\n" for line in lines).encode("ascii")


WRITERS: Mapping[str, Writer] = MappingProxyType(
    {"csv": write_csv, "tsv": write_tsv, "json": write_json, "npz": write_npz, "matrix": write_matrix}
)
"""The formats that can be written, by the name of their readers."""
