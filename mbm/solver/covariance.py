"""Covariance of the estimates: on the surface of bounds and constraints, and of what a deficient matrix determines."""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.decisions import EPSILON, ROUNDED_ROTATION, SHARE, decided_rank
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import (
    add_multiple,
    append_rows,
    column_product,
    copied,
    corner,
    divided,
    dot,
    filled,
    inverted_upper,
    rotate,
    sum_of_products,
)
from mbm.solver.workspace import Work

STILL = 1e-9
"""What rounding makes of no movement, as a share of one, where columns have length 1."""

REPEATED = 1e-12
"""The share of a constraint's slope that those before it leave, below which it says nothing new."""


def reflect_constraints(
    n: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    scale: ConstantReals,
    holding: Integer,
    held: ConstantReals,
    slopes: ConstantReals,
    reflections: Reals,
) -> Integer:
    """The ``reflections`` (reflected, count) for the constraints that hold, and how many there are.

    ``slopes`` (holding, n); of the coordinates those ``chosen`` (count,) may move, each over its ``scale``. A
    constraint holds where ``held`` is not 0.
    """
    reflected = 0
    for c in range(holding):
        if held[c] != 0.0 and reflected < count:
            row = reflections[reflected * count :]
            for k in range(count):
                row[k] = slopes[c * n + chosen[k]] / scale[k]
            length = sqrt(dot(count, row, row))
            for q in range(reflected):
                reflection = reflections[q * count :]
                add_multiple(count, -dot(count, reflection, row), reflection, row)
            filled(reflected, 0.0, row)
            rest = sqrt(dot(count, row, row))
            if rest > REPEATED * length:
                row[reflected] += rest if row[reflected] >= 0.0 else -rest
                factor = sqrt(2.0 / dot(count, row, row))
                for k in range(reflected, count):
                    row[k] *= factor
                reflected += 1
    return reflected


def to_null_space(count: Integer, reflected: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Qᵀ vector``: after the first ``reflected`` numbers its part along the surface."""
    for q in range(reflected):
        reflection = reflections[q * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)


def from_null_space(count: Integer, reflected: Integer, reflections: ConstantReals, vector: Reals) -> None:
    """``vector`` (count,) becomes ``Q vector``."""
    for back in range(reflected):
        reflection = reflections[(reflected - 1 - back) * count :]
        add_multiple(count, -dot(count, reflection, vector), reflection, vector)


SWEEPS = 40
NEGLIGIBLE = 1e-28
"""A product of two columns below this share of the largest square turns nothing that could be seen."""


def singular_values(width: Integer, small: ConstantReals, lines: Reals, right: Reals, singular: Reals) -> None:
    """The singular values (w,) of a triangle, the largest first, and the right singular vectors, one to a row.

    ``small`` (w + 1, w + 1); ``lines`` (w, w) is scratch.
    """
    largest = 0.0
    for k in range(width):
        for i in range(width):
            lines[k * width + i] = small[i * (width + 1) + k] if i <= k else 0.0
            right[k * width + i] = 1.0 if i == k else 0.0
        square = dot(width, lines[k * width :], lines[k * width :])
        if square > largest:
            largest = square
    turning = 1
    for _ in range(SWEEPS):
        if turning == 0:
            break
        turning = 0
        for k in range(width):
            for i in range(k):
                a = dot(width, lines[i * width :], lines[i * width :])
                b = dot(width, lines[k * width :], lines[k * width :])
                along = dot(width, lines[i * width :], lines[k * width :])
                if fabs(along) > EPSILON * sqrt(a) * sqrt(b) and fabs(along) > NEGLIGIBLE * largest:
                    turning = 1
                    ratio = 0.5 * (b - a) / along
                    tangent = 1.0 / (fabs(ratio) + sqrt(1.0 + ratio * ratio))
                    if ratio < 0.0:
                        tangent = -tangent
                    cosine = 1.0 / sqrt(1.0 + tangent * tangent)
                    rotate(width, cosine, cosine * tangent, lines[i * width :], lines[k * width :])
                    rotate(width, cosine, cosine * tangent, right[i * width :], right[k * width :])
    for k in range(width):
        singular[k] = sqrt(dot(width, lines[k * width :], lines[k * width :]))
    for k in range(width):
        best = k
        for i in range(k + 1, width):
            if singular[i] > singular[best]:
                best = i
        if best != k:
            value = singular[k]
            singular[k] = singular[best]
            singular[best] = value
            rotate(width, 0.0, 1.0, right[k * width :], right[best * width :])


def set_determined(
    problem: Problem,
    count: Integer,
    reflected: Integer,
    rank: Integer,
    scale: ConstantReals,
    singular: ConstantReals,
    work: Work,
    covariance: Reals,
) -> None:
    """The covariance (n, n) in the directions that are determined, and which coordinates the others touch, `touched`.

    `inverse` has the right singular vectors along the surface; `part` becomes a factor of the
    covariance, ``rank`` rows (n,), with the free directions below it, `loose` rows.
    """
    n = problem.n
    width = count - reflected
    chosen = work.chosen
    factor = work.part
    line = work.line
    touched = work.touched
    filled(n * n, 0.0, factor)
    for a in range(width):
        filled(count, 0.0, line)
        copied(width, work.inverse[a * width :], line[reflected:])
        from_null_space(count, reflected, work.reflections, line)
        for k in range(count):
            if a < rank:
                factor[a * n + chosen[k]] = line[k] / (singular[a] * scale[k])
            else:
                factor[a * n + chosen[k]] = line[k] / scale[k]
                touched[chosen[k]] += line[k] * line[k]
    work.rank = rank
    work.loose = width - rank
    filled(n, 0.0, work.sizes)
    for k in range(count):
        work.sizes[chosen[k]] = 1.0 / scale[k]
    for j in range(n):
        touched[j] = 1.0 if touched[j] > SHARE * SHARE else 0.0
    sum_of_products(rank, n, factor, factor, covariance)


def determines(problem: Problem, gradient: ConstantReals, work: Work) -> Integer:
    """1 where a quantity with the ``gradient`` (n,) does not feel the free directions of the last covariance."""
    n = problem.n
    loose = work.part[work.rank * n :]
    length = 0.0
    along = 0.0
    for a in range(work.loose):
        share = dot(n, loose[a * n :], gradient)
        along += share * share
    for j in range(n):
        length += gradient[j] * work.sizes[j] * gradient[j] * work.sizes[j]
    return 1 if along <= SHARE * SHARE * length else 0


def mask_undetermined(problem: Problem, work: Work, covariance: Reals) -> None:
    """NaN for what the free directions of the last covariance touch."""
    n = problem.n
    for i in range(n):
        for k in range(n):
            if work.touched[i] != 0.0 or work.touched[k] != 0.0:
                covariance[i * n + k] = inf - inf


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
    that is nothing. `rank` is how many directions along the surface are determined, `loose` how many are not; `part`
    becomes a factor of the covariance, `rank` rows (n,), with the free directions below it.

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
        rank = decided_rank(width, singular, problem.affine)
        if rank < width:
            set_determined(problem, count, reflected, rank, scale, singular, work, covariance)
            return inf
        condition_of(count, width, small, part, inverse)
    if reflected > 0:
        back_from_null_space(count, reflected, reflections, work.line, part, inverse)
    filled(n * n, 0.0, part)
    for i in range(count):
        for k in range(width):
            part[k * n + chosen[i]] = inverse[i * width + k] / scale[i]
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
