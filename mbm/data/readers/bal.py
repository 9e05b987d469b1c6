"""BAL, bundle adjustment in the large (Agarwal, Snavely, Seitz, Szeliski 2010): cameras, points and observations.

The file is a stream of numbers: how many cameras, points and observations there are; the observations ``camera point u
v``; nine numbers for each camera, a rotation vector ``r1 r2 r3``, a translation ``t1 t2 t3``, focal length ``f`` and
distortion ``k1 k2``; three for each point. Cameras and points count from 0. Rows are the lines where records begin.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import numbers_of, row_numbers
from mbm.data.content import BLANKS, lines_in, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import number_columns
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Numbers, reads_as_number
from mbm.text.types import DataPlace, MbmError

PARTS: Mapping[str, tuple[str, ...]] = {
    "cameras": ("camera", "r1", "r2", "r3", "t1", "t2", "t3", "f", "k1", "k2"),
    "points": ("point", "x", "y", "z"),
    "observations": ("camera", "point", "u", "v"),
}
HEADER = 3


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """Read a BAL file.

    Raises MbmError as ``read_text`` does, and malformed-record.
    """
    text, digest = read_text(path, between=BLANKS)
    shown = path.as_posix()
    fields = text.split()
    numbers = numbers_of(fields)
    if numbers is None:
        position = next((i for i, field in enumerate(fields) if not reads_as_number(field)), 0)
        reason = f"{format_faults.shown(fields[position])} is no number"
        raise MbmError(format_faults.malformed_record(_place(text, shown, position), reason))
    cameras, points, observations = _counts(numbers, text, shown)
    ends = list(accumulate((HEADER, 4 * observations, 9 * cameras, 3 * points)))
    if len(numbers) != ends[-1]:
        reason = f"the file holds {len(numbers)} numbers where its first line announces {ends[-1]}"
        raise MbmError(format_faults.malformed_record(DataPlace(file=shown), reason))
    lines = _lines(text)
    stretches = {
        "observations": numbers[ends[0] : ends[1]].reshape(-1, 4),
        "cameras": _numbered(numbers[ends[1] : ends[2]].reshape(-1, 9)),
        "points": _numbered(numbers[ends[2] :].reshape(-1, 3)),
    }
    _check_references(stretches["observations"], (cameras, points), text, shown)
    firsts = {"observations": (ends[0], 4), "cameras": (ends[1], 9), "points": (ends[2], 3)}
    found: dict[str, RawTable | MbmError] = {}
    for part, names in PARTS.items():
        table = stretches[part]
        first, width = firsts[part]
        rows = lines[first + width * np.arange(len(table))]
        if np.any(np.diff(rows) <= 0):  # records that share a line: the lines cannot name them
            rows = row_numbers(1, len(table))
        rows.setflags(write=False)
        columns = number_columns(names, table)
        key = names[0] if part != "observations" else None
        found[part] = RawTable(path=shown, sha256=digest, columns=columns, file_rows=rows, key=key)
    return found


def _counts(numbers: Numbers, text: str, path: str) -> tuple[int, int, int]:
    header = numbers[:HEADER]
    if len(header) < HEADER or not all(float(n).is_integer() and 0 <= n < 1e12 for n in header):
        reason = "the file begins with the numbers of cameras, points and observations"
        raise MbmError(format_faults.malformed_record(_place(text, path, 0), reason))
    return int(header[0]), int(header[1]), int(header[2])


def _numbered(records: Numbers) -> Numbers:
    """The records with their numbers, from 0, before them."""
    return np.column_stack([np.arange(len(records), dtype=np.float64), records])


def _check_references(observations: Numbers, counts: tuple[int, int], text: str, path: str) -> None:
    """Check that observations name cameras and points that there are."""
    for column, (what, count) in enumerate(zip(("camera", "point"), counts, strict=True)):
        cells = observations[:, column]
        wrong = np.flatnonzero(~((cells >= 0) & (cells < count) & (cells == np.floor(cells))))
        if wrong.size:
            place = _place(text, path, HEADER + 4 * int(wrong[0]) + column, what)
            reason = f"there is no {what} {cells[wrong[0]]:g}: they count from 0 to {count - 1}"
            raise MbmError(format_faults.malformed_record(place, reason))


def _lines(text: str) -> NDArray[np.int64]:
    """For each field the number of its line."""
    counts = [len(line.split()) for line in lines_in(text)]
    return np.repeat(np.arange(1, len(counts) + 1, dtype=np.int64), counts)


def _place(text: str, path: str, position: int, column: str | None = None) -> DataPlace:
    """The place of the field at ``position``."""
    lines = _lines(text)
    return DataPlace(file=path, row=int(lines[position]) if position < len(lines) else 1, column=column)


READER = ManyReader(name="bal", extensions=(".bal",), parts=tuple(PARTS), read=read)
