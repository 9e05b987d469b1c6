"""Points and steps: how numbers that hold rotations, directions and scales move along a step of the tangent space.

Conventions as `mbm.equations.manifolds`: ``R Exp(ω)`` with unit quaternions (w, x, y, z), great circles, ``c exp(s)``.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.description import QUATERNION, SCALE, Component, Problem
from mbm.solver.linear_algebra import copied


def part_of_step(column: Integer, step: ConstantReals) -> Real:
    """The step of a coordinate, 0 where it is not free."""
    found = 0.0
    if column >= 0:
        found = step[column]
    return found


@distinct_arrays
def reflected(piece: Component, point: ConstantReals, step: ConstantReals, target: Reals) -> None:
    """A unit quaternion after a rotation vector: ``q Exp(ω)``, of length 1 afterwards."""
    x = part_of_step(piece.column_0, step)
    y = part_of_step(piece.column_1, step)
    z = part_of_step(piece.column_2, step)
    angle = sqrt(x * x + y * y + z * z)
    w = cos(0.5 * angle)
    share = 0.5
    if angle > 0.0:
        share = sin(0.5 * angle) / angle
    x *= share
    y *= share
    z *= share
    a = point[piece.number_0]
    b = point[piece.number_1]
    c = point[piece.number_2]
    d = point[piece.number_3]
    p = a * w - b * x - c * y - d * z
    q = a * x + b * w + c * z - d * y
    r = a * y - b * z + c * w + d * x
    s = a * z + b * y - c * x + d * w
    length = sqrt(p * p + q * q + r * r + s * s)
    target[piece.number_0] = p / length
    target[piece.number_1] = q / length
    target[piece.number_2] = r / length
    target[piece.number_3] = s / length


SEAM = -0.875
"""Tangent axes jump where the third number of a direction passes it: far from those along axes, planes and diagonals,
at which a rounding error would decide of them, and from -1, near which they cancel."""


def side_of_seam(z: Real) -> Real:
    """1, and -1 for directions beyond the seam."""
    if z < SEAM:
        return -1.0
    return 1.0


@distinct_arrays
def swung(piece: Component, point: ConstantReals, step: ConstantReals, target: Reals) -> None:
    """A unit vector after a step along a great circle; axes of the tangent plane as in Duff et al. (2017)."""
    s = part_of_step(piece.column_0, step)
    t = part_of_step(piece.column_1, step)
    x = point[piece.number_0]
    y = point[piece.number_1]
    z = point[piece.number_2]
    sign = side_of_seam(z)
    a = -1.0 / (sign + z)
    b = x * y * a
    along_x = s * (1.0 + sign * x * x * a) + t * b
    along_y = s * (sign * b) + t * (sign + y * y * a)
    along_z = s * (-sign * x) - t * y
    angle = sqrt(s * s + t * t)
    share = 1.0
    if angle > 0.0:
        share = sin(angle) / angle
    cosine = cos(angle)
    x = cosine * x + share * along_x
    y = cosine * y + share * along_y
    z = cosine * z + share * along_z
    length = sqrt(x * x + y * y + z * z)
    target[piece.number_0] = x / length
    target[piece.number_1] = y / length
    target[piece.number_2] = z / length


@distinct_arrays
def retract(problem: Problem, point: ConstantReals, step: ConstantReals, target: Reals) -> None:
    """The point (N,) after a step (n,) of the free coordinates."""
    copied(problem.numbers, point, target)
    for j in range(problem.n):
        place = problem.number_of[j]
        if place >= 0:
            target[place] = point[place] + step[j]
    for k in range(problem.component_count):
        piece = problem.components[k]
        if piece.kind == SCALE:
            place = piece.number_0
            target[place] = point[place] * exp(part_of_step(piece.column_0, step))
        elif piece.kind == QUATERNION:
            reflected(piece, point, step, target)
        else:
            swung(piece, point, step, target)


@distinct_arrays
def coordinates_of(problem: Problem, point: ConstantReals, target: Reals) -> None:
    """The numbers that steps add to (n,), 0 for rotations, directions and scales."""
    for j in range(problem.n):
        place = problem.number_of[j]
        target[j] = 0.0
        if place >= 0:
            target[j] = point[place]


@distinct_arrays
def place_coordinates(problem: Problem, coordinates: ConstantReals, point: Reals) -> None:
    """Put coordinates (n,) into the point; rotations, directions and scales stay."""
    for j in range(problem.n):
        place = problem.number_of[j]
        if place >= 0:
            point[place] = coordinates[j]


def quaternion_of_matrix(R: ConstantReals, quaternion: Reals) -> None:
    """The unit quaternion (w, x, y, z), w ≥ 0, of a rotation matrix (9,), row by row (Shepperd 1978)."""
    trace = R[0] + R[4] + R[8]
    if trace >= R[0] and trace >= R[4] and trace >= R[8]:
        w = 1.0 + trace
        x = R[7] - R[5]
        y = R[2] - R[6]
        z = R[3] - R[1]
    elif R[0] >= R[4] and R[0] >= R[8]:
        w = R[7] - R[5]
        x = 1.0 + R[0] - R[4] - R[8]
        y = R[1] + R[3]
        z = R[2] + R[6]
    elif R[4] >= R[8]:
        w = R[2] - R[6]
        x = R[1] + R[3]
        y = 1.0 - R[0] + R[4] - R[8]
        z = R[5] + R[7]
    else:
        w = R[3] - R[1]
        x = R[2] + R[6]
        y = R[5] + R[7]
        z = 1.0 - R[0] - R[4] + R[8]
    length = sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        length = -length
    quaternion[0] = w / length
    quaternion[1] = x / length
    quaternion[2] = y / length
    quaternion[3] = z / length
