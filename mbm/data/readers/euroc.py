"""EuRoC MAV ground truth: commas between timestamp [ns], position [m], quaternion (w x y z), velocity and biases.

The columns are those of every trajectory, ``t`` in seconds and the quaternion's real part last; where the file has
them, ``vx vy vz`` in m/s, ``bwx bwy bwz`` in rad/s and ``bax bay baz`` in m/s². Lines that begin with ``#`` (the header
does) are comments. Rows are the lines of the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbm.data.content import read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import Line, line_numbers, lines_of, number_columns, number_table
from mbm.data.readers.tum import POSE_COLUMNS
from mbm.data.types import RawTable, Reader
from mbm.text.types import DataPlace, MbmError

POSE = ("timestamp", "x", "y", "z", "qw", "qx", "qy", "qz")
MOTION = ("vx", "vy", "vz", "bwx", "bwy", "bwz", "bax", "bay", "baz")
NANOSECONDS = 10**9
LONGEST = 300
"""Digits of a stamp that are read one by one; longer ones are no times."""


def read(path: Path) -> RawTable:
    """Read a EuRoC ground truth file.

    Raises MbmError as ``read_text`` does, and short-row, long-row, malformed-record.
    """
    text, digest = read_text(path)
    shown = path.as_posix()
    lines = lines_of(text, separator=",")
    whole = bool(lines) and len(lines[0][1]) > len(POSE)
    names = (*POSE, *MOTION) if whole else POSE
    numbers = number_table(lines, names, shown)
    numbers[:, 0] = [_seconds(line, shown) for line in lines]
    numbers[:, 4:8] = numbers[:, [5, 6, 7, 4]]
    columns = (*POSE_COLUMNS, *names[len(POSE) :])
    rows = line_numbers(number for number, _ in lines)
    return RawTable(path=shown, sha256=digest, columns=number_columns(columns, numbers), file_rows=rows)


def _seconds(line: Line, path: str) -> float:
    """Nanoseconds as the nearest float to the seconds: all nineteen digits do not fit a float themselves.

    Stamps with a fraction are refused: they are seconds of another format, which would be read a billion times too
    small.
    """
    number, fields = line
    stamp = fields[0].strip()
    value = int(stamp) if stamp.isdigit() and len(stamp) <= LONGEST else float(stamp)
    if isinstance(value, float) and not value.is_integer():
        what = "is not finite" if not np.isfinite(value) else f"is {stamp}, no whole number of nanoseconds"
        raise MbmError(format_faults.malformed_record(DataPlace(file=path, row=number), f"`timestamp` {what}"))
    return value / NANOSECONDS


READER = Reader(name="euroc", extensions=(), read=read)
