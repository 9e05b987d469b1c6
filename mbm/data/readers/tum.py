"""TUM trajectories (the RGB-D benchmark's format): one pose a line, ``t x y z qx qy qz qw`` between blanks.

Times in seconds, positions in metres, the orientation as a quaternion whose real part comes last. Lines that begin
with ``#`` are comments. Rows are the lines of the file.
"""

from __future__ import annotations

from pathlib import Path

from mbm.data.content import BLANKS, read_text
from mbm.data.readers.fields import line_numbers, lines_of, number_columns, number_table
from mbm.data.types import RawTable, Reader

POSE_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""The columns of every trajectory."""


def read(path: Path) -> RawTable:
    """Read a TUM trajectory.

    Raises MbmError as ``read_text`` does, and short-row, long-row, malformed-record.
    """
    text, digest = read_text(path, between=BLANKS)
    shown = path.as_posix()
    lines = lines_of(text)
    numbers = number_table(lines, POSE_COLUMNS, shown)
    rows = line_numbers(number for number, _ in lines)
    return RawTable(path=shown, sha256=digest, columns=number_columns(POSE_COLUMNS, numbers), file_rows=rows)


READER = Reader(name="tum", extensions=(".tum",), read=read)
