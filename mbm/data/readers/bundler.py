"""Bundler v0.3 (Snavely, Seitz, Szeliski 2006): ``bundle.out`` with its cameras, poses, points and observations.

The file is a stream of numbers: how many cameras and points there are; of each camera the focal length and distortion
``f k1 k2``, a rotation matrix row by row and a translation, from the world to the camera, which looks along −z; of each
point its coordinates, its colour, and a list of views: camera, key, and where the point is seen, from the middle of the
image, x to the right and y upwards. All count from 0. Cameras with ``f`` 0 were not registered and are left out. Rows
are the lines where records begin.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbm.data.cells import numbers_of, row_numbers
from mbm.data.content import BLANKS, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import are_rotations, line_numbers, lines_of, number_columns
from mbm.data.readers.scenes import PARTS, POSE
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Numbers, reads_as_number
from mbm.rotations import quaternion_of_matrix
from mbm.text.types import DataPlace, MbmError

CAMERA, POINT, VIEW = 15, 6, 4
"""Numbers of a camera, of a point up to its views, and of a view."""


class _Stream:
    """The numbers of a file, with the line of each."""

    def __init__(self, path: Path) -> None:
        text, self.sha256 = read_text(path, between=BLANKS)
        self.path = path.as_posix()
        lines = lines_of(text)
        fields = [field for _, line in lines for field in line]
        self.lines = np.repeat(line_numbers(number for number, _ in lines), [len(line) for _, line in lines])
        numbers = numbers_of(fields)
        if numbers is None:
            at = next(i for i, field in enumerate(fields) if not reads_as_number(field))
            raise self.fault(at, f"{format_faults.shown(fields[at])} is no number")
        self.numbers = numbers

    def fault(self, at: int, reason: str) -> MbmError:
        """What is wrong with the number at a position."""
        row = int(self.lines[at]) if at < len(self.lines) else None
        return MbmError(format_faults.malformed_record(DataPlace(file=self.path, row=row), reason))

    def count(self, at: int, size: int, what: str) -> int:
        """How many ``what`` follow, each of ``size`` numbers at least."""
        number = float(self.numbers[at]) if at < len(self.numbers) else -1.0
        if not number.is_integer() or number < 0:
            raise self.fault(at, f"the number of {what} is missing, or no whole number")
        left = len(self.numbers) - at - 1
        if number * size > left:
            raise self.fault(at, f"it announces {number:,.0f} {what}, more than the {left:,} numbers behind it hold")
        return int(number)

    def table(self, names: tuple[str, ...], numbers: Numbers, rows: NDArray[np.int64], key: str | None) -> RawTable:
        """A table of the file."""
        if np.any(np.diff(rows) <= 0):  # records that share a line: the lines cannot name them
            rows = row_numbers(1, len(rows))
        rows.setflags(write=False)
        columns = number_columns(names, numbers)
        return RawTable(path=self.path, sha256=self.sha256, columns=columns, file_rows=rows, key=key)


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """Read a Bundler file.

    Raises MbmError as ``read_text`` does, and malformed-record.
    """
    stream = _Stream(path)
    cameras = stream.count(0, CAMERA, "cameras")
    points = stream.count(1, POINT + 1, "points") if len(stream.numbers) > 1 else 0
    first = 2
    end = first + CAMERA * cameras
    if end > len(stream.numbers):
        raise stream.fault(0, f"it announces {cameras:,} cameras, and the file ends before")
    records = stream.numbers[first:end].reshape(-1, CAMERA)
    used = np.flatnonzero(records[:, 0] != 0)
    lines = stream.lines[first + CAMERA * used]
    positions, seen, places = _points(stream, end, points)
    _check_views(stream, seen, places, set(used.tolist()))
    ids = used.astype(np.float64)[:, None]
    poses = _poses(stream, records[used], first + CAMERA * used)
    numbered = np.column_stack([np.arange(points, dtype=np.float64), stream.numbers[positions[:, None] + np.arange(3)]])
    return {
        "cameras": stream.table(("camera", "f", "k1", "k2"), np.hstack([ids, records[used, :3]]), lines, "camera"),
        "images": stream.table(("image", "camera", *POSE), np.hstack([ids, ids, poses]), lines.copy(), "image"),
        "points": stream.table(("point", "x", "y", "z"), numbered, stream.lines[positions], "point"),
        "observations": stream.table(("image", "point", "u", "v"), seen, stream.lines[places], None),
    }


def _points(stream: _Stream, at: int, count: int) -> tuple[NDArray[np.int64], Numbers, NDArray[np.int64]]:
    """Where each point begins; image, point, u and v of each view, and where it begins."""
    positions, counts = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    for point in range(count):
        positions[point] = at
        counts[point] = stream.count(at + POINT, VIEW, "views") if at + POINT < len(stream.numbers) else -1
        if counts[point] < 0:
            raise stream.fault(at, f"the file ends within point {point}")
        at += POINT + 1 + VIEW * int(counts[point])
    if at != len(stream.numbers):
        raise stream.fault(at, f"{len(stream.numbers) - at:,} numbers follow the last point")
    owners = np.repeat(np.arange(count), counts)
    within = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    places = positions[owners] + POINT + 1 + VIEW * within
    views = stream.numbers[places[:, None] + np.arange(VIEW)]
    return positions, np.column_stack([views[:, 0], owners, views[:, 2:]]), places


def _check_views(stream: _Stream, seen: Numbers, places: NDArray[np.int64], registered: set[int]) -> None:
    """Each view names a camera that there is."""
    known = np.isin(seen[:, 0], np.array(sorted(registered), dtype=np.float64))
    wrong = np.flatnonzero(~known)
    if wrong.size:
        row = int(wrong[0])
        reason = f"point {seen[row, 1]:.0f} is seen by camera {seen[row, 0]:g}, which there is not, or whose `f` is 0"
        raise stream.fault(int(places[row]), reason)


def _poses(stream: _Stream, records: Numbers, places: NDArray[np.int64]) -> Numbers:
    """Quaternions and translations (n, 7)."""
    rotations = records[:, 3:12].reshape(-1, 3, 3)
    wrong = np.flatnonzero(~are_rotations(rotations))
    if wrong.size:
        raise stream.fault(int(places[wrong[0]]), "the rotation of the camera is no rotation matrix")
    return np.hstack([quaternion_of_matrix(rotations), records[:, 12:]])


READER = ManyReader(name="bundler", extensions=(), parts=PARTS, read=read)
