"""Steps between points, and how coordinates about one point change into those about another (see `manifolds`).

A factor of a covariance is moved with the point: a step at ``retract(x, step)`` varies with ``step`` by the right
Jacobian of Exp for rotations (Solà, Deray and Atchuthan 2018, eq. 143), and by its like on the sphere.
"""

from __future__ import annotations

from math import atan2, cos, log, sin, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.description import QUATERNION, SCALE, Component, Problem
from mbm.solver.manifolds import part_of_step, side_of_seam

SMALL_ANGLE = 1e-3
"""Below it slopes are taken from two terms of their series: the third is below 1e-14."""


def versine_share(angle: Real) -> Real:
    """``(1 − cos a) / a²``."""
    if angle < SMALL_ANGLE:
        return 0.5 - angle * angle / 24.0
    return (1.0 - cos(angle)) / (angle * angle)


def sine_rest(angle: Real) -> Real:
    """``(a − sin a) / a³``."""
    if angle < SMALL_ANGLE:
        return 1.0 / 6.0 - angle * angle / 120.0
    return (angle - sin(angle)) / (angle * angle * angle)


def sine_share(angle: Real) -> Real:
    """``sin a / a``."""
    return sin(angle) / angle if angle > 0.0 else 1.0


def set_rotation_slopes(x: Real, y: Real, z: Real, slopes: Reals) -> None:
    """The right Jacobian (3, 3) of Exp at a rotation vector."""
    angle = sqrt(x * x + y * y + z * z)
    a = versine_share(angle)
    b = sine_rest(angle)
    square = angle * angle
    slopes[0] = 1.0 + b * (x * x - square)
    slopes[1] = a * z + b * x * y
    slopes[2] = b * x * z - a * y
    slopes[3] = b * x * y - a * z
    slopes[4] = 1.0 + b * (y * y - square)
    slopes[5] = a * x + b * y * z
    slopes[6] = a * y + b * x * z
    slopes[7] = b * y * z - a * x
    slopes[8] = 1.0 + b * (z * z - square)


@distinct_arrays
def set_axes(x: Real, y: Real, z: Real, axes: Reals) -> None:
    """Two orthonormal tangents (2, 3) at a unit vector (Duff et al. 2017)."""
    sign = side_of_seam(z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes[0] = 1.0 + sign * x * x * a
    axes[1] = sign * b
    axes[2] = -sign * x
    axes[3] = b
    axes[4] = sign + y * y * a
    axes[5] = -y


@distinct_arrays
def set_sphere_slopes(piece: Component, point: ConstantReals, s: Real, t: Real, slopes: Reals) -> None:
    """The same (2, 2) for a step along a great circle; ``slopes`` holds 18 numbers, of which the first 4 count."""
    axes = slopes[4:]
    there = slopes[10:]
    x = point[piece.number_0]
    y = point[piece.number_1]
    z = point[piece.number_2]
    set_axes(x, y, z, axes)
    angle = sqrt(s * s + t * t)
    share = sine_share(angle)
    bend = sine_rest(angle) - versine_share(angle)
    cosine = cos(angle)
    along_x = s * axes[0] + t * axes[3]
    along_y = s * axes[1] + t * axes[4]
    along_z = s * axes[2] + t * axes[5]
    set_axes(cosine * x + share * along_x, cosine * y + share * along_y, cosine * z + share * along_z, there)
    for i in range(2):
        turned = there[3 * i] * (bend * along_x - share * x)
        turned += there[3 * i + 1] * (bend * along_y - share * y)
        turned += there[3 * i + 2] * (bend * along_z - share * z)
        for j in range(2):
            straight = there[3 * i] * axes[3 * j]
            straight += there[3 * i + 1] * axes[3 * j + 1] + there[3 * i + 2] * axes[3 * j + 2]
            step = s if j == 0 else t
            slopes[2 * i + j] = turned * step + share * straight


def longest_turn(problem: Problem, step: ConstantReals) -> Real:
    """The largest angle by which a step turns one of the rotations and directions."""
    found = 0.0
    for k in range(problem.component_count):
        piece = problem.components[k]
        if piece.kind != SCALE:
            x = part_of_step(piece.column_0, step)
            y = part_of_step(piece.column_1, step)
            z = part_of_step(piece.column_2, step) if piece.kind == QUATERNION else 0.0
            found = max(found, sqrt(x * x + y * y + z * z))
    return found


@distinct_arrays
def transport(
    problem: Problem, point: ConstantReals, step: ConstantReals, count: Integer, slopes: Reals, lines: Reals
) -> None:
    """Vectors (count, n) of coordinates about a point → about ``retract(point, step)``; ``slopes`` (18,) is scratch."""
    n = problem.n
    for k in range(problem.component_count):
        piece = problem.components[k]
        if piece.kind != SCALE:
            s = part_of_step(piece.column_0, step)
            t = part_of_step(piece.column_1, step)
            size = 2
            if piece.kind == QUATERNION:
                size = 3
                set_rotation_slopes(s, t, part_of_step(piece.column_2, step), slopes)
            else:
                set_sphere_slopes(piece, point, s, t, slopes)
            for i in range(count):
                own = lines[i * n :]
                x = part_of_step(piece.column_0, own)
                y = part_of_step(piece.column_1, own)
                z = part_of_step(piece.column_2, own) if size == 3 else 0.0
                for j in range(size):
                    value = slopes[size * j] * x + slopes[size * j + 1] * y
                    if size == 3:
                        value += slopes[size * j + 2] * z
                    column = piece.column_0
                    if j == 1:
                        column = piece.column_1
                    if j == 2:
                        column = piece.column_2
                    put_part(column, value, own)


def put_part(column: Integer, value: Real, step: Reals) -> None:
    """The part of a step in a coordinate, if that is free."""
    if column >= 0:
        step[column] = value


@distinct_arrays
def put_turn(piece: Component, start: ConstantReals, end: ConstantReals, step: Reals) -> None:
    """The rotation vector that leads from one unit quaternion to another."""
    a = start[piece.number_0]
    b = start[piece.number_1]
    c = start[piece.number_2]
    d = start[piece.number_3]
    e = end[piece.number_0]
    f = end[piece.number_1]
    g = end[piece.number_2]
    h = end[piece.number_3]
    w = a * e + b * f + c * g + d * h
    x = a * f - b * e - c * h + d * g
    y = a * g + b * h - c * e - d * f
    z = a * h - b * g + c * f - d * e
    sine = sqrt(x * x + y * y + z * z)
    if w < 0.0:
        w = -w
        x = -x
        y = -y
        z = -z
    share = 2.0
    if sine > 0.0:
        share = 2.0 * atan2(sine, w) / sine
    put_part(piece.column_0, share * x, step)
    put_part(piece.column_1, share * y, step)
    put_part(piece.column_2, share * z, step)


@distinct_arrays
def put_arc(piece: Component, start: ConstantReals, end: ConstantReals, axes: Reals, step: Reals) -> None:
    """The step along the great circle from one unit vector to another."""
    x = start[piece.number_0]
    y = start[piece.number_1]
    z = start[piece.number_2]
    set_axes(x, y, z, axes)
    s = 0.0
    t = 0.0
    cosine = x * end[piece.number_0] + y * end[piece.number_1] + z * end[piece.number_2]
    s += axes[0] * end[piece.number_0] + axes[1] * end[piece.number_1] + axes[2] * end[piece.number_2]
    t += axes[3] * end[piece.number_0] + axes[4] * end[piece.number_1] + axes[5] * end[piece.number_2]
    sine = sqrt(s * s + t * t)
    share = 1.0
    if sine > 0.0:
        share = atan2(sine, cosine) / sine
    put_part(piece.column_0, share * s, step)
    put_part(piece.column_1, share * t, step)


@distinct_arrays
def step_between(problem: Problem, start: ConstantReals, end: ConstantReals, scratch: Reals, step: Reals) -> None:
    """The step (n,) of the free coordinates with ``retract(start, step) = end``; ``scratch`` holds 6 numbers."""
    for j in range(problem.n):
        place = problem.number_of[j]
        step[j] = 0.0
        if place >= 0:
            step[j] = end[place] - start[place]
    for k in range(problem.component_count):
        piece = problem.components[k]
        if piece.kind == SCALE:
            put_part(piece.column_0, log(end[piece.number_0] / start[piece.number_0]), step)
        elif piece.kind == QUATERNION:
            put_turn(piece, start, end, step)
        else:
            put_arc(piece, start, end, scratch, step)
