"""Stated rotations → the numbers that hold them, and angles within their bounds."""

from __future__ import annotations

from math import atan2, floor, isfinite, pi, sqrt

from mbm.target.words import ConstantReals, Real, Reals


def quaternion_of_matrix(matrix: ConstantReals, quaternion: Reals) -> None:
    """The unit quaternion (w, x, y, z) of a rotation matrix row by row (Shepperd 1978: the largest of four)."""
    trace = matrix[0] + matrix[4] + matrix[8]
    best = 0
    largest = trace
    for i in range(3):
        if matrix[4 * i] > largest:
            largest = matrix[4 * i]
            best = i + 1
    if best == 0:
        quaternion[0] = 1.0 + trace
        quaternion[1] = matrix[7] - matrix[5]
        quaternion[2] = matrix[2] - matrix[6]
        quaternion[3] = matrix[3] - matrix[1]
    else:
        i = best - 1
        j = (i + 1) % 3
        k = (i + 2) % 3
        quaternion[0] = matrix[3 * k + j] - matrix[3 * j + k]
        quaternion[1 + i] = 1.0 + matrix[4 * i] - matrix[4 * j] - matrix[4 * k]
        quaternion[1 + j] = matrix[3 * j + i] + matrix[3 * i + j]
        quaternion[1 + k] = matrix[3 * k + i] + matrix[3 * i + k]
    length = sqrt(
        quaternion[0] * quaternion[0]
        + quaternion[1] * quaternion[1]
        + quaternion[2] * quaternion[2]
        + quaternion[3] * quaternion[3]
    )
    if quaternion[0] < 0.0:
        length = -length
    for i in range(4):
        quaternion[i] = quaternion[i] / length


def angle_of_matrix(matrix: ConstantReals) -> Real:
    """The angle of a rotation of the plane, row by row."""
    return atan2(matrix[2], matrix[0])


def unit_vector(stated: ConstantReals, direction: Reals) -> None:
    """A vector of any length as a direction."""
    length = sqrt(stated[0] * stated[0] + stated[1] * stated[1] + stated[2] * stated[2])
    for i in range(3):
        direction[i] = stated[i] / length


def within_turn(angle: Real, lower: Real, upper: Real) -> Real:
    """An angle by whole turns nearest to the middle of its bounds; as it is where there are none."""
    found = angle
    if isfinite(lower) and isfinite(upper):
        middle = (lower + upper) / 2.0
        turned = angle - middle + pi
        found = middle + turned - 2.0 * pi * floor(turned / (2.0 * pi)) - pi
    return found


def begun(stated: Real, least: Real, greatest: Real, lower: Real, upper: Real) -> Real:
    """Where a number begins: as stated, else in the middle of the range of starts, else in that of its bounds."""
    found = stated
    if not isfinite(found) and isfinite(least) and isfinite(greatest):
        found = (least + greatest) / 2.0
    if not isfinite(found) and isfinite(lower) and isfinite(upper):
        found = (lower + upper) / 2.0
    return found


ROUTINES = (quaternion_of_matrix, angle_of_matrix, unit_vector, within_turn, begun)
