"""Poses for the vertices of a graph that has edges only: each is reached over as few edges as possible from the first.

Such a start drifts less than one along the odometry, because loop closures shorten the ways. Poses of the plane are
``x y θ``, of space ``x y z`` and a quaternion ``qx qy qz qw``.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from mbm.problem.tables import Numbers

SPACE = 3
PLANE_NUMBERS = 3
Pose = tuple[float, ...]


def placed(ends: Numbers, measured: Numbers) -> tuple[Numbers, Numbers]:
    """The ids (n,) in the order in which edges name them, and their poses (n, k).

    ``ends`` (m, 2) are the ids ``from`` and ``to`` of each edge, ``measured`` (m, k) the pose of ``to`` as seen there.
    The first vertex, and the first of each part that no edge joins to it, stands at the origin.
    """
    ids = list(dict.fromkeys(ends.ravel().tolist()))
    neighbours: dict[float, list[tuple[float, int, bool]]] = {each: [] for each in ids}
    for edge, (start, end) in enumerate(ends.tolist()):
        neighbours[start].append((end, edge, False))
        neighbours[end].append((start, edge, True))
    poses = [tuple(row) for row in measured.tolist()]
    plane = measured.shape[1] == PLANE_NUMBERS
    then, back = (_then_plane, _inverse_plane) if plane else (_then_space, _inverse_space)
    found: dict[float, Pose] = {}
    for root in ids:
        if root in found:
            continue
        found[root] = (0.0, 0.0, 0.0) if plane else (0.0,) * 6 + (1.0,)
        waiting = deque([root])
        while waiting:
            here = waiting.popleft()
            for there, edge, backwards in neighbours[here]:
                if there not in found:
                    step = back(poses[edge]) if backwards else poses[edge]
                    found[there] = then(found[here], step)
                    waiting.append(there)
    return np.array(ids), np.array([found[each] for each in ids])


def _then_plane(a: Pose, b: Pose) -> Pose:
    cos, sin = np.cos(a[2]), np.sin(a[2])
    turn = a[2] + b[2]
    wrapped = float(np.arctan2(np.sin(turn), np.cos(turn)))
    return (float(a[0] + cos * b[0] - sin * b[1]), float(a[1] + sin * b[0] + cos * b[1]), wrapped)


def _inverse_plane(a: Pose) -> Pose:
    cos, sin = np.cos(a[2]), np.sin(a[2])
    return (float(-cos * a[0] - sin * a[1]), float(sin * a[0] - cos * a[1]), -a[2])


def _then_space(a: Pose, b: Pose) -> Pose:
    x, y, z = _turned(a[3:], b[:3])
    return (a[0] + x, a[1] + y, a[2] + z, *_product(a[3:], b[3:]))


def _inverse_space(a: Pose) -> Pose:
    conjugate = (-a[3], -a[4], -a[5], a[6])
    x, y, z = _turned(conjugate, a[:3])
    return (-x, -y, -z, *conjugate)


def _product(p: Pose, q: Pose) -> Pose:
    """The unit quaternion p ∘ q, real parts last."""
    v, w = np.array(p[:3]), np.array(q[:3])
    vector = p[3] * w + q[3] * v + np.cross(v, w)
    whole = np.array([*vector, p[3] * q[3] - v @ w])
    return tuple((whole / np.linalg.norm(whole)).tolist())


def _turned(q: Pose, vector: Pose) -> Pose:
    """The vector after the rotation of a quaternion."""
    axis, real = np.array(q[:3]), q[3]
    point = np.array(vector)
    cross = 2.0 * np.cross(axis, point) / (axis @ axis + real * real)
    return tuple((point + real * cross + np.cross(axis, cross)).tolist())


def euler_quaternions(angles: Numbers) -> Numbers:
    """Quaternions (n, 4), real part last, of roll, pitch and yaw (n, 3): Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, cp, cy = np.cos(angles / 2).T
    sr, sp, sy = np.sin(angles / 2).T
    return np.column_stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
