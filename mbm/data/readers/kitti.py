"""KITTI trajectories (the odometry benchmark's format): one pose a line, the upper 3×4 of its matrix row by row.

The format has no times: ``t`` counts the poses from 0, as the benchmark counts its frames. Rows are the lines of the
file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbm.data.content import BLANKS, read_text
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import MOST_LINES_REPORTED, line_numbers, lines_of, number_columns, number_table
from mbm.data.readers.tum import POSE_COLUMNS
from mbm.data.types import RawTable, Reader
from mbm.problem.tables import Numbers
from mbm.text.types import DataPlace, MbmError

MATRIX_COLUMNS = ("r11", "r12", "r13", "t1", "r21", "r22", "r23", "t2", "r31", "r32", "r33", "t3")
LARGEST_DEVIATION = 1e-2
"""How far RᵀR may be from the identity: files carry six digits or more, so what is beyond is no rotation."""


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
    wrong = ~_are_rotations(rotations)
    if wrong.any():
        found = [DataPlace(file=shown, row=int(row)) for row in rows[wrong][:MOST_LINES_REPORTED]]
        reason = "its first three columns are no rotation matrix"
        raise MbmError(*(format_faults.malformed_record(place, reason) for place in found))
    times = np.arange(len(lines), dtype=np.float64)
    numbers = np.column_stack([times, matrices[:, :, 3], quaternions(rotations)])
    return RawTable(path=shown, sha256=digest, columns=number_columns(POSE_COLUMNS, numbers), file_rows=rows)


def _are_rotations(matrices: Numbers) -> np.ndarray:
    """Which matrices (n, 3, 3) are rotations as far as the digits of a file tell."""
    with np.errstate(all="ignore"):
        products = np.einsum("nji,njk->nik", matrices, matrices) - np.eye(3)
        near = np.abs(products).max(axis=(1, 2), initial=0.0) < LARGEST_DEVIATION
        return np.asarray(near & (np.linalg.det(np.nan_to_num(matrices)) > 0))


def quaternions(matrices: Numbers) -> Numbers:
    """Unit quaternions (n, 4), real part last and not negative, of rotation matrices (n, 3, 3).

    The largest of the four components is found first, so that none is divided by a small number (Shepperd 1978).
    """
    m = matrices
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    squares = np.column_stack([1 - trace + 2 * m[:, i, i] for i in range(3)] + [1 + trace])
    # four times the products of the components, one row for each component x, y, z, w
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    xw, yw, zw = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    products = np.stack(
        [
            np.column_stack([squares[:, 0], xy, xz, xw]),
            np.column_stack([xy, squares[:, 1], yz, yw]),
            np.column_stack([xz, yz, squares[:, 2], zw]),
            np.column_stack([xw, yw, zw, squares[:, 3]]),
        ],
        axis=1,
    )
    chosen = products[np.arange(len(m)), squares.argmax(axis=1)]
    found = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    return np.asarray(np.where(found[:, 3:] < 0, -found, found))


READER = Reader(name="kitti", extensions=(), read=read)
