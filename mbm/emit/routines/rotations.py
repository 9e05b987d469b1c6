"""Stated rotations → the numbers that hold them, and where numbers begin."""

from __future__ import annotations

from math import atan2, isfinite, sqrt

from mbm.machine.words import ConstantReals, Real, Reals


def angle_of_matrix(matrix: ConstantReals) -> Real:
    """The angle of a rotation of the plane, row by row."""
    return atan2(matrix[2], matrix[0])


def unit_vector(stated: ConstantReals, direction: Reals) -> None:
    """A vector of any length as a direction."""
    length = sqrt(stated[0] * stated[0] + stated[1] * stated[1] + stated[2] * stated[2])
    for i in range(3):
        direction[i] = stated[i] / length


def sign_quaternion(quaternion: Reals) -> None:
    """The sign that is reported, by `mbm.rotations.signed`: the first number (4,) that is not zero is positive."""
    first = 0.0
    for i in range(4):
        if first == 0.0:
            first = quaternion[i]
    for i in range(4):
        quaternion[i] = (-quaternion[i] if first < 0.0 else quaternion[i]) + 0.0


def begun(stated: Real, least: Real, greatest: Real, lower: Real, upper: Real) -> Real:
    """Where a number begins: as stated, else in the middle of the range of starts, else in that of its bounds."""
    found = stated
    if not isfinite(found) and isfinite(least) and isfinite(greatest):
        found = (least + greatest) / 2.0
    if not isfinite(found) and isfinite(lower) and isfinite(upper):
        found = (lower + upper) / 2.0
    return found
