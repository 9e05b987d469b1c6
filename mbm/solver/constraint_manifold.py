"""A point on the surface of the constraints that hold: its multipliers, and Newton's step of the Lagrange function.

The null-space method (Nocedal and Wright 2006, 16.2 and 18.1): a step in scaled coordinates is ``Q (y, z)`` with
``C Q = [L 0]``; y brings the constraints to zero, z lowers ``‖r‖²/2 + Σ λ c`` along the surface. The multipliers are
those of least squares, ``Lᵀ λ = -Yᵀ Jᵀ r``. The rows of the residuals stand in their triangle, never squared.
"""

from __future__ import annotations

from math import fabs, sqrt

from mbm.machine.words import Integer
from mbm.solver.covariance import REPEATED, from_null_space, reflect_constraints, set_reduced, set_scales, to_null_space
from mbm.solver.decisions import rounding_of_norm
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import (
    add_multiple,
    cholesky,
    copied,
    corner,
    dot,
    filled,
    gradient_of,
    solve_lower,
    solve_lower_transposed,
    solve_transposed,
    solve_upper,
    transposed,
)
from mbm.solver.step_control import relative_offset
from mbm.solver.steps import INDEPENDENT, without_dependent
from mbm.solver.trust_region import constraint_count
from mbm.solver.workspace import Linearisation, Work

SCALE = 11
LINE = 12
ALONG = 13
"""Vectors of scratch: of the coordinates that may move, one after the other."""


def choose_free(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """The coordinates that no bound holds, and how many they are."""
    count = 0
    for j in range(problem.n):
        if place.free[j] != 0.0:
            work.chosen[count] = j
            count += 1
    return count


def set_null_space(
    problem: Problem,
    place: Linearisation,
    count: Integer,
    work: Work,
) -> Integer:
    """Scales, reflections and L at a place; how many constraints turn. Of those that repeat others `held` becomes 0.

    Then y in `along`, and the multipliers in `forces`.
    """
    n = problem.n
    chosen = work.chosen
    triangle = place.triangle
    held = work.held
    slopes = work.slopes
    scale = work.scale
    line = work.line
    gradient = work.gradient
    reflections = work.reflections
    lower = work.lower
    holding = constraint_count(problem, work.rows.data)
    set_scales(problem, count, chosen, triangle, holding, held, slopes, scale)
    reflected = reflect_constraints(n, count, chosen, scale, holding, held, slopes, reflections)
    found = 0
    for c in range(holding):
        work.forces[c] = 0.0
        if held[c] != 0.0:
            for k in range(count):
                line[k] = slopes[c * n + chosen[k]] / scale[k]
            length = sqrt(dot(count, line, line))
            to_null_space(count, reflected, reflections, line)
            if found < reflected and fabs(line[found]) > REPEATED * length:
                work.along[found] = (-work.values[c] - dot(found, line, work.along)) / line[found]
                copied(reflected, line, lower[found * n :])
                found += 1
            else:
                held[c] = 0.0
    for k in range(count):
        gradient[k] = gradient_of(n, chosen[k], triangle) / scale[k]
    to_null_space(count, reflected, reflections, gradient)
    set_forces(n, holding, found, work)
    return found


def set_forces(n: Integer, holding: Integer, found: Integer, work: Work) -> None:
    """The multipliers of what is `held`, ``Lᵀ λ = -Yᵀ g``, for a turned gradient g in `gradient`."""
    line = work.line
    last = found
    for back in range(holding):
        c = holding - 1 - back
        if work.held[c] != 0.0:
            last -= 1
            total = -work.gradient[last]
            for k in range(last + 1, found):
                total -= work.lower[k * n + last] * line[k]
            line[last] = total / work.lower[last * n + last]
            work.forces[c] = line[last]


def kkt_step(
    problem: Problem,
    count: Integer,
    reflected: Integer,
    curved: Integer,
    place: Linearisation,
    work: Work,
) -> Integer:
    """The step of a place that `set_null_space` has seen, its length and offset; 0 where it is not determined.

    ``curved`` 1: with the second-order term.
    """
    n = problem.n
    width = count - reflected
    line = work.line
    along = work.along
    there = work.right
    factor = work.part
    small = work.small
    for i in range(n):
        there[i] = place.triangle[i * (n + 1) + n]
    set_reduced(n, count, reflected, place.triangle, work)
    corner(width, width + 1, small, factor)
    for i in range(width):
        line[i] = -small[i * (width + 1) + width]
    if without_dependent(width, INDEPENDENT, factor, line) > 0:
        return 0
    if curved == 1 and corrected_right(problem, count, reflected, work) == 0:
        return 0
    solve_upper(width, factor, line)
    copied(width, line, along[reflected:])
    from_null_space(count, reflected, work.reflections, along)
    set_step(problem, count, width, place, work)
    return 1


def corrected_right(problem: Problem, count: Integer, reflected: Integer, work: Work) -> Integer:
    """The right side in `line` with the second-order term S: ``(I + T⁻ᵀ Zᵀ S Z T⁻¹)⁻¹ (-t - T⁻ᵀ Zᵀ S Y y)``.

    0 where the Hessian on the surface is not positive definite.
    """
    n = problem.n
    width = count - reflected
    line = work.line
    gradient = work.gradient
    factor = work.part
    inner = work.inner
    for i in range(count):
        for k in range(count):
            inner[i * count + k] = work.curvature[work.chosen[i] * n + work.chosen[k]] / (work.scale[i] * work.scale[k])
        to_null_space(count, reflected, work.reflections, inner[i * count :])
    transposed(count, inner)
    for i in range(count):
        to_null_space(count, reflected, work.reflections, inner[i * count :])
    for i in range(width):
        gradient[i] = dot(reflected, inner[(reflected + i) * count :], work.along)
    for i in range(width):
        for k in range(width):
            inner[i * width + k] = inner[(reflected + i) * count + reflected + k]
    for i in range(width):
        solve_transposed(width, factor, inner[i * width :])
    transposed(width, inner)
    for i in range(width):
        solve_transposed(width, factor, inner[i * width :])
        inner[i * width + i] += 1.0
    solve_transposed(width, factor, gradient)
    if cholesky(width, inner) == 0:
        return 0
    add_multiple(width, -1.0, gradient, line)
    solve_lower(width, inner, line)
    solve_lower_transposed(width, inner, line)
    return 1


def set_step(
    problem: Problem,
    count: Integer,
    width: Integer,
    place: Linearisation,
    work: Work,
) -> None:
    """The scaled step in `along` as that of the place: in all coordinates, its length, offset and rounding."""
    n = problem.n
    chosen = work.chosen
    full = place.full
    scale = work.scale
    along = work.along
    filled(n, 0.0, full)
    terms = 0.0
    for k in range(count):
        full[chosen[k]] = along[k] / scale[k]
        size = fabs(place.x[chosen[k]]) if problem.number_of[chosen[k]] >= 0 else 1.0
        terms += scale[k] * size * scale[k] * size
    inside = 0.0
    for i in range(n):
        moved = dot(n - i, place.triangle[i * (n + 1) + i :], full[i:])
        inside += moved * moved
    outside = place.cost - inside
    place.length = sqrt(dot(count, along, along))
    place.predicted = inside
    place.offset = relative_offset(inside, outside if outside > 0.0 else 0.0, width, work.rows.data.count - width)
    place.rounding = rounding_of_norm(terms, place.cost)
