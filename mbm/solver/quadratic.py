"""One linearised problem: least squares with linear equations, inequalities and bounds (Lawson and Hanson 1974, LSEI).

The equations take away dimensions first; what is left is turned into the nearest point of a polyhedron.

The point of a polyhedron that is nearest to the origin: the core of every quadratic subproblem.

The dual method of Goldfarb and Idnani (1983) with the Hessian made the identity: one inequality after the other is
added, and those whose multiplier would change its sign leave. It needs no feasible start, says where there is no
feasible point, and takes no harm from normals that depend on others.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.constraint_manifold import set_forces, set_null_space
from mbm.solver.covariance import from_null_space, set_reduced, to_null_space
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import (
    add_multiple,
    copied,
    corner,
    damped_triangle,
    dot,
    filled,
    multiplied,
    solve_transposed,
    solve_upper,
)
from mbm.solver.steps import down_of, up_of
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Linearisation, Work

REDUNDANT = 1e-10
"""The share of a normal along the surface of the equations below which it is none."""

FLOOR = 1e-9
"""Directions that the residuals feel less than this are damped so much that they stay where they are."""

FEASIBLE = 1e-13
"""Violations below this share of the step and of the limit are rounding."""


def solve_quadratic(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """``min ‖J p + r‖² + damping² ‖scale p‖²`` where the linearised constraints and the bounds hold: the step p.

    It becomes `full` of the place, its multipliers `forces`, those of bounds `pushes`. 0 where the inequalities have no
    common point: the step then only serves the equations. `held` and `chosen` say which constraints are equations, and
    that all coordinates may move.
    """
    n = problem.n
    holding = constraint_count(problem, work.rows.data)
    reflected = set_null_space(problem, place, n, work)
    width = n - reflected
    for i in range(n):
        work.right[i] = place.triangle[i * (n + 1) + n]
    set_reduced(n, n, reflected, place.triangle, work)
    corner(width, width + 1, work.small, work.part)
    square = dot(width * width, work.part, work.part)
    for i in range(width):
        work.part_projected[i] = work.small[i * (width + 1) + width]
    damping = work.damping * work.damping
    if damping < FLOOR * FLOOR * square:
        damping = FLOOR * FLOOR * square
    if not damping > 0.0:
        damping = 1e-300
    damped_triangle(width, work.part, work.part_projected, damping, work.damped, work.right, work.row)
    filled(width, 0.0, work.nearest)
    work.active = 0
    feasible = 1
    for _ in range(20 * (holding + 3 * n) + 50):
        set_movement(problem, reflected, place, work)
        face = worst_face(problem, place, work)
        if face < 0:
            break
        feasible = add_face(problem, face, reflected, place, work)
        if feasible == 0:
            work.active = 0
            break
    if feasible == 1:
        settle_nearest(width, work)
        set_movement(problem, reflected, place, work)
    set_multipliers(problem, reflected, place, work)
    return feasible


def set_movement(problem: Problem, reflected: Integer, place: Linearisation, work: Work) -> None:
    """The step (n,) that the nearest point stands for."""
    n = problem.n
    width = n - reflected
    moved = work.moved
    copied(reflected, work.along, moved)
    rest = work.rest
    for k in range(width):
        rest[k] = work.nearest[k] - work.right[k]
    solve_upper(width, work.damped, rest)
    copied(width, rest, moved[reflected:])
    from_null_space(n, reflected, work.reflections, moved)
    for j in range(n):
        place.full[j] = moved[j] / work.scale[j]


def worst_face(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """The inequality or bound that the step oversteps most, beyond rounding; -1: none.

    Constraints by their numbers, then lower bounds, then upper bounds.
    """
    n = problem.n
    holding = constraint_count(problem, work.rows.data)
    found = -1
    most = 0.0
    longest = 1.0 + sqrt(dot(n, work.moved, work.moved))
    for c in range(holding):
        if work.equation[c] == 0:
            size = 0.0
            for j in range(n):
                slope = work.slopes[c * n + j] / work.scale[j]
                size += slope * slope
            size = sqrt(size)
            value = work.values[c] + dot(n, work.slopes[c * n :], place.full)
            beyond = value - FEASIBLE * (size * longest + fabs(work.values[c]))
            if size > 0.0 and beyond > most * size and is_active(c, work) == 0:
                most = beyond / size
                found = c
    if problem.boxed == 1:
        for j in range(n):
            low = down_of(problem, work.rows.constants, place.x, j) * work.scale[j]
            high = up_of(problem, work.rows.constants, place.x, j) * work.scale[j]
            below = low - work.moved[j] - FEASIBLE * (longest + fabs(low))
            above = work.moved[j] - high - FEASIBLE * (longest + fabs(high))
            if isfinite(low) and below > most and is_active(holding + j, work) == 0:
                most = below
                found = holding + j
            if isfinite(high) and above > most and is_active(holding + n + j, work) == 0:
                most = above
                found = holding + n + j
    return found


def is_active(face: Integer, work: Work) -> Integer:
    """1 where an inequality is among the active ones."""
    for k in range(work.active):
        if work.faces[k] == face:
            return 1
    return 0


def set_face(problem: Problem, face: Integer, reflected: Integer, place: Linearisation, work: Work) -> Real:
    """The gradient of an inequality in turned scaled coordinates into `moved` (n,), and its value at step 0."""
    n = problem.n
    holding = constraint_count(problem, work.rows.data)
    moved = work.moved
    filled(n, 0.0, moved)
    if face < holding:
        value = work.values[face]
        for j in range(n):
            moved[j] = work.slopes[face * n + j] / work.scale[j]
    elif face < holding + n:
        j = face - holding
        value = down_of(problem, work.rows.constants, place.x, j) * work.scale[j]
        moved[j] = -1.0
    else:
        j = face - holding - n
        value = -up_of(problem, work.rows.constants, place.x, j) * work.scale[j]
        moved[j] = 1.0
    to_null_space(n, reflected, work.reflections, moved)
    return value


def add_face(problem: Problem, face: Integer, reflected: Integer, place: Linearisation, work: Work) -> Integer:
    """One more inequality is active; 0 where it has no common point with the others."""
    n = problem.n
    width = n - reflected
    normal = work.normal
    value = set_face(problem, face, reflected, place, work)
    length = sqrt(dot(n, work.moved, work.moved))
    copied(width, work.moved[reflected:], normal)
    if not sqrt(dot(width, normal, normal)) > REDUNDANT * length:
        return 0
    solve_transposed(width, work.damped, normal)
    limit = dot(width, normal, work.right) - value - dot(reflected, work.moved, work.along)
    size = sqrt(dot(width, normal, normal))
    multiplied(width, 1.0 / size, normal)
    return join(width, face, limit / size, size, work)


def set_multipliers(problem: Problem, reflected: Integer, place: Linearisation, work: Work) -> None:
    """`forces` of the constraints and `pushes` of the bounds, for the active inequalities and the step."""
    n = problem.n
    holding = constraint_count(problem, work.rows.data)
    gradient = work.gradient
    pulled = work.shift
    filled(holding, 0.0, work.forces)
    filled(n, 0.0, work.pushes)
    filled(n, 0.0, pulled)
    for i in range(n):
        moved = place.triangle[i * (n + 1) + n] + dot(n - i, place.triangle[i * (n + 1) + i :], place.full[i:])
        add_multiple(n - i, moved, place.triangle[i * (n + 1) + i :], pulled[i:])
    for k in range(work.active):
        face = work.faces[k]
        force = work.face_forces[k] / work.face_sizes[k]
        if face < holding:
            work.forces[face] = force
            add_multiple(n, force, work.slopes[face * n :], pulled)
        elif face < holding + n:
            work.pushes[face - holding] -= force * work.scale[face - holding]
        else:
            work.pushes[face - holding - n] += force * work.scale[face - holding - n]
    for j in range(n):
        damped = work.damping * work.damping * work.scale[j] * work.scale[j] * place.full[j]
        gradient[j] = (pulled[j] + work.pushes[j] + damped) / work.scale[j]
    to_null_space(n, reflected, work.reflections, gradient)
    set_forces(n, holding, reflected, work)


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
        add_multiple(work.active, -length, change, work.face_forces)
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
    multiplied(work.active, -1.0, share)
    back_substituted(width, work.active, work, share)
    for k in range(work.active):
        work.face_forces[k] = share[k] if share[k] > 0.0 else 0.0
