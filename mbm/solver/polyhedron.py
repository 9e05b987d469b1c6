"""The point of a polyhedron that is nearest to the origin: the core of every quadratic subproblem.

The dual method of Goldfarb and Idnani (1983) with the Hessian made the identity: one inequality after the other is
added, and those whose multiplier would change its sign leave. It needs no feasible start, says where there is no
feasible point, and takes no harm from normals that depend on others.
"""

from __future__ import annotations

from math import inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.linear_algebra import add_multiple, copied, dot, filled
from mbm.solver.workspace import Work

DEPENDENT = 1e-10
"""A unit normal of which less than this part is left beside the active ones depends on them."""


def outside_of(width: Integer, active: Integer, normal: ConstantReals, work: Work, along: Reals, rest: Reals) -> Real:
    """The length of what the ``active`` normals leave of a vector (width,), which is ``rest``; ``along`` what not."""
    copied(width, normal, rest)
    filled(active, 0.0, along)
    for _ in range(2):
        for k in range(active):
            share = dot(width, work.face_basis[k * width :], rest)
            along[k] += share
            add_multiple(width, -share, work.face_basis[k * width :], rest)
    return sqrt(dot(width, rest, rest))


def span(width: Integer, first: Integer, active: Integer, work: Work) -> None:
    """Basis and triangle of the active normals from the number ``first`` on; those before are as they were."""
    for k in range(first, active):
        basis = work.face_basis[k * width :]
        length = outside_of(width, k, work.normals[k * width :], work, work.face_changes, basis)
        for i in range(k):
            work.face_triangle[i * width + k] = work.face_changes[i]
        work.face_triangle[k * width + k] = length
        for i in range(width):
            basis[i] /= length if length > 0.0 else 1.0


def back_substituted(width: Integer, active: Integer, work: Work, x: Reals) -> None:
    """``x`` (active,) becomes ``R⁻¹ x`` with the triangle of the active normals."""
    for back in range(active):
        i = active - 1 - back
        total = x[i]
        for k in range(i + 1, active):
            total -= work.face_triangle[i * width + k] * x[k]
        x[i] = total / work.face_triangle[i * width + i]


def leave(width: Integer, leaving: Integer, work: Work) -> None:
    """The active inequality ``leaving`` is active no more."""
    work.active -= 1
    for k in range(leaving, work.active):
        work.faces[k] = work.faces[k + 1]
        work.face_limits[k] = work.face_limits[k + 1]
        work.face_sizes[k] = work.face_sizes[k + 1]
        work.face_forces[k] = work.face_forces[k + 1]
        copied(width, work.normals[(k + 1) * width :], work.normals[k * width :])
    span(width, leaving, work.active, work)


def join(width: Integer, face: Integer, limit: Real, size: Real, work: Work) -> Integer:
    """`nearest` where ``normal · w <= limit`` as well; 0 where that and the active inequalities have no common point.

    `normal` (width,) is of unit length; ``size`` was its length.
    """
    normal = work.normal
    change = work.face_changes
    force = 0.0
    violation = dot(width, normal, work.nearest) - limit
    while True:
        room = outside_of(width, work.active, normal, work, change, work.onward)
        back_substituted(width, work.active, work, change)
        free = room > DEPENDENT and work.active < width
        length = violation / (room * room) if free else inf
        leaving = -1
        for k in range(work.active):
            if change[k] > DEPENDENT and work.face_forces[k] < length * change[k]:
                length = work.face_forces[k] / change[k]
                leaving = k
        if not isfinite(length):
            return 0
        if free:
            add_multiple(width, -length, work.onward, work.nearest)
            violation -= length * room * room
        for k in range(work.active):
            work.face_forces[k] -= length * change[k]
        force += length
        if leaving < 0:
            last = work.active
            work.faces[last] = face
            work.face_limits[last] = limit
            work.face_sizes[last] = size
            work.face_forces[last] = force
            copied(width, normal, work.normals[last * width :])
            work.active += 1
            span(width, last, work.active, work)
            return 1
        leave(width, leaving, work)


def settle_nearest(width: Integer, work: Work) -> None:
    """The point once more from its active inequalities, and their multipliers: no error of the way there stays."""
    point = work.nearest
    share = work.face_changes
    filled(width, 0.0, point)
    for k in range(work.active):
        total = work.face_limits[k]
        for i in range(k):
            total -= work.face_triangle[i * width + k] * share[i]
        share[k] = total / work.face_triangle[k * width + k]
        add_multiple(width, share[k], work.face_basis[k * width :], point)
    for k in range(work.active):
        share[k] = -share[k]
    back_substituted(width, work.active, work, share)
    for k in range(work.active):
        work.face_forces[k] = share[k] if share[k] > 0.0 else 0.0
