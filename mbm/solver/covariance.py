"""Covariance of the estimates from the triangle: ``(JᵀJ)⁻¹`` on the surface of the bounds and constraints that hold.

JᵀJ is never formed. Only movements along the surface count: `tangent` turns the constraints that hold away.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.decisions import ROUNDED_ROTATION, decided_rank
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import append_rows, column_product, copied, corner, divided, dot, filled, inverted_upper
from mbm.solver.null_space import from_null_space, reflect_constraints, to_null_space
from mbm.solver.rank_deficient import set_determined, singular_values
from mbm.solver.workspace import Work

SURE = 1e9
"""A condition up to which there is nothing to decide: no singular value is below 1e-9 of the largest."""


def set_covariance(
    problem: Problem,
    triangle: ConstantReals,
    sides: ConstantIntegers,
    holding: Integer,
    held: ConstantReals,
    work: Work,
    covariance: Reals,
) -> Real:
    """The covariance (n, n), and the condition of the column-scaled triangle; infinite where it is deficient.

    The covariance is then that in the directions which are determined; `mask_undetermined` says for which coordinates
    that is nothing. `rank` is how many directions along the surface are determined, `loose` how many are not.

    ``triangle`` (n + 1, n + 1) of ``[J r]``; ``sides`` (n,) not 0 where a bound holds a coordinate. Of
    the first constraints, as many as ``holding`` says, hold where ``held[k]`` is their unit; 0: it does not.
    """
    n = problem.n
    scale = work.scale
    part = work.part
    reflections = work.reflections
    inverse = work.inverse
    small = work.small
    chosen = work.chosen
    count = 0
    for j in range(n):
        if sides[j] == 0:
            chosen[count] = j
            count += 1
    filled(n * n, 0.0, covariance)
    set_scales(problem, count, chosen, triangle, holding, held, work.slopes, scale)
    reflected = reflect_constraints(n, count, chosen, scale, holding, held, work.slopes, reflections)
    width = count - reflected
    if width == n:
        for i in range(n):
            divided(n - i, triangle[i * (n + 1) + i :], scale[i:], small[i * (n + 1) + i :])
    else:
        filled(n, 0.0, work.along)
        filled(n, 0.0, work.right)
        set_reduced(n, count, reflected, triangle, work)
    filled(n, 0.0, work.touched)
    work.rank = width
    work.loose = 0
    condition = condition_of(count, width, small, part, inverse)
    if condition > SURE:
        singular = work.singular
        singular_values(width, small, part, inverse, singular)
        rank = decided_rank(width, singular)
        if rank < width:
            set_determined(problem, count, reflected, rank, scale, singular, work, covariance)
            return inf
        condition_of(count, width, small, part, inverse)
    if reflected > 0:
        back_from_null_space(count, reflected, reflections, work.line, part, inverse)
    for i in range(count):
        for k in range(i + 1):
            first = i if reflected == 0 else 0
            value = dot(width - first, inverse[i * width + first :], inverse[k * width + first :])
            value /= scale[i] * scale[k]
            covariance[chosen[i] * n + chosen[k]] = value
            covariance[chosen[k] * n + chosen[i]] = value
    return condition


def back_from_null_space(
    count: Integer, reflected: Integer, reflections: ConstantReals, line: Reals, spare: Reals, inverse: Reals
) -> None:
    """The inverse triangle (width, width) along the surface as lines (count, width) of the chosen coordinates."""
    width = count - reflected
    for k in range(width):
        filled(count, 0.0, line)
        for i in range(k + 1):
            line[reflected + i] = inverse[i * width + k]
        from_null_space(count, reflected, reflections, line)
        for i in range(count):
            spare[i * width + k] = line[i]
    copied(count * width, spare, inverse)


def set_scales(
    problem: Problem,
    count: Integer,
    chosen: ConstantIntegers,
    triangle: ConstantReals,
    holding: Integer,
    held: ConstantReals,
    slopes: ConstantReals,
    scale: Reals,
) -> None:
    """The lengths (count,) of the chosen columns; of those that no residual feels what constraints make of them.

    A column of a rotation that is only rounding stays so: it is scaled as the longest of them.
    """
    n = problem.n
    turned = 0.0
    for k in range(count):
        column = triangle[chosen[k] :]
        square = column_product(chosen[k] + 1, n + 1, column, column)
        if problem.number_of[chosen[k]] < 0 and sqrt(square) > turned:
            turned = sqrt(square)
        scale[k] = sqrt(square)
        for c in range(holding):
            if held[c] != 0.0 and square == 0.0:
                value = slopes[c * n + chosen[k]] / held[c]
                scale[k] = sqrt(scale[k] * scale[k] + value * value)
        if scale[k] == 0.0:
            scale[k] = 1.0
    for k in range(count):
        if problem.number_of[chosen[k]] < 0 and scale[k] < ROUNDED_ROTATION * turned:
            scale[k] = turned


def set_reduced(n: Integer, count: Integer, reflected: Integer, triangle: ConstantReals, work: Work) -> None:
    """`small` (w + 1, w + 1), w = count - reflected: the triangle of the chosen columns, scaled, along the surface.

    Its last column stands for `right` (n,) after the movement `along` (reflected,) towards the surface.
    """
    width = count - reflected
    line = work.line
    rows = work.small_rows
    for i in range(n):
        for k in range(count):
            j = work.chosen[k]
            line[k] = triangle[i * (n + 1) + j] / work.scale[k] if i <= j else 0.0
        to_null_space(count, reflected, work.reflections, line)
        for k in range(width):
            rows[k * n + i] = line[reflected + k]
        rows[width * n + i] = work.right[i] + dot(reflected, line, work.along)
    filled((width + 1) * (width + 1), 0.0, work.small)
    append_rows(width + 1, n, n, rows, work.small)


def condition_of(count: Integer, width: Integer, small: ConstantReals, part: Reals, inverse: Reals) -> Real:
    """Upper estimate of the condition of ``small`` (w + 1, w + 1), and its ``inverse`` (w, w); infinite: there is none.

    ``part`` (w, w) is scratch.
    """
    for i in range(width):
        if small[i * (width + 1) + i] == 0.0:
            return inf
    corner(width, width + 1, small, part)
    inverted_upper(width, part, inverse)
    found = sqrt(float(count) * dot(width * width, inverse, inverse))
    return found if found < inf else inf


def undetermined(n: Integer, sides: ConstantIntegers, covariance: Reals) -> Real:
    """No covariance: NaN for all that no bound holds."""
    for i in range(n):
        for k in range(n):
            if sides[i] == 0 and sides[k] == 0:
                covariance[i * n + k] = inf - inf
    return inf
