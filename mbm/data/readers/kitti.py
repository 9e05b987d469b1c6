"""KITTI trajectories (the odometry benchmark's format): one pose a line, the upper 3×4 of its matrix row by row.

The format has no times: ``t`` counts the poses from 0, as the benchmark counts its frames. Rows are the lines of the
file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbm.data import faults
from mbm.data.content import BLANKS, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import are_rotations, line_numbers, lines_of, number_columns, number_table
from mbm.data.readers.tum import POSE_COLUMNS
from mbm.data.types import RawTable, Reader
from mbm.rotations import quaternion_of_matrix
from mbm.text.types import DataPlace, MbmError

MATRIX_COLUMNS = ("r11", "r12", "r13", "t1", "r21", "r22", "r23", "t2", "r31", "r32", "r33", "t3")


def read(path: Path) -> RawTable:
    """Read a KITTI trajectory.

    Raises MbmError as ``read_text`` does, and short-row, long-row, malformed-record (also for a matrix that is no
    rotation).
    """
    text, digest = read_text(path, between=BLANKS)
    shown = path.as_posix()
    lines = lines_of(text)
    matrices = number_table(lines, MATRIX_COLUMNS, shown).reshape(-1, 3, 4)
    rows = line_numbers(number for number, _ in lines)
    rotations = matrices[:, :, :3]
    wrong = ~are_rotations(rotations)
    if wrong.any():
        found = [DataPlace(file=shown, row=int(row)) for row in rows[wrong][: faults.MOST_ROWS_REPORTED]]
        reason = "its first three columns are no rotation matrix"
        raise MbmError(*(format_faults.malformed_record(place, reason) for place in found))
    times = np.arange(len(lines), dtype=np.float64)
    numbers = np.column_stack([times, matrices[:, :, 3], np.roll(quaternion_of_matrix(rotations), -1, axis=1)])
    return RawTable(path=shown, sha256=digest, columns=number_columns(POSE_COLUMNS, numbers), file_rows=rows)


READER = Reader(name="kitti", extensions=(), read=read)
