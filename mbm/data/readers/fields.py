"""Lines of numbers between blanks, as trajectories, graphs and bundles have them: texts → arrays, faults by line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mbm.data import faults
from mbm.data.cells import frozen, numbers_of
from mbm.data.content import lines_in
from mbm.data.readers import faults as format_faults
from mbm.problem.tables import Column, Numbers, reads_as_number
from mbm.text.types import DataPlace, Diagnostic, MbmError

LARGEST_DEVIATION = 1e-2
"""How far RᵀR, or the length of a quaternion, may be from 1: files carry six digits or more, so what is beyond is no
rotation."""

Line = tuple[int, list[str]]
"""The number of a line, from 1, and its fields."""


def are_rotations(matrices: Numbers) -> np.ndarray:
    """Which matrices (n, 3, 3) are rotations as far as the digits of a file tell."""
    with np.errstate(all="ignore"):
        products = np.einsum("nji,njk->nik", matrices, matrices) - np.eye(3)
        near = np.abs(products).max(axis=(1, 2), initial=0.0) < LARGEST_DEVIATION
        return np.asarray(near & (np.linalg.det(np.nan_to_num(matrices)) > 0))


def lines_of(text: str, *, separator: str | None = None) -> list[Line]:
    """The lines that hold something, in fields; what stands behind a ``#`` at the beginning of a line is a comment.

    ``separator`` None: blanks and tabulators, any number of them. No field has blanks around it: what Python's float
    takes for one in ASCII is less than what `str.strip` does.
    """
    found = []
    for number, line in enumerate(lines_in(text), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            fields = stripped.split(separator)
            if separator is not None and len(stripped.split(None, 1)) > 1:
                fields = [field.strip() for field in fields]
            found.append((number, fields))
    return found


def number_table(lines: Sequence[Line], names: tuple[str, ...], path: str) -> Numbers:
    """The fields of ``lines`` as numbers, shape (lines, names).

    Raises MbmError with the first few faults: short-row, long-row, malformed-record (a field that is no number).
    """
    width = len(names)
    wrong = [line for line in lines if len(line[1]) != width]
    if wrong:
        raise MbmError(*(_width_fault(line, names, path) for line in wrong[: faults.MOST_ROWS_REPORTED]))
    numbers = numbers_of([field for _, fields in lines for field in fields])
    if numbers is None:
        raise MbmError(*_not_numbers(lines, names, path))
    return numbers.reshape(len(lines), width)


def number_columns(names: Sequence[str], numbers: NDArray[np.float64]) -> tuple[Column, ...]:
    """The columns of an array of shape (rows, names)."""
    return tuple(Column(name=name, numbers=frozen(numbers[:, i])) for i, name in enumerate(names))


def line_numbers(numbers: Iterable[int]) -> NDArray[np.int64]:
    """Numbers of lines as the rows of a table, read-only."""
    rows = np.fromiter(numbers, dtype=np.int64)
    rows.setflags(write=False)
    return rows


def _width_fault(line: Line, names: tuple[str, ...], path: str) -> Diagnostic:
    number, fields = line
    if len(fields) > len(names):
        return faults.long_row(DataPlace(file=path, row=number), number, len(fields), names)
    place = DataPlace(file=path, row=number, column=names[len(fields)])
    return faults.short_row(place, number, len(fields), names)


def _not_numbers(lines: Sequence[Line], names: tuple[str, ...], path: str) -> list[Diagnostic]:
    found = []
    for number, fields in lines:
        for name, cell in zip(names, fields, strict=True):
            if not reads_as_number(cell):
                place = DataPlace(file=path, row=number, column=name)
                found.append(
                    format_faults.malformed_record(place, f"`{name}` is {format_faults.shown(cell)}, no number")
                )
                break
        if len(found) == faults.MOST_ROWS_REPORTED:
            break
    return found
