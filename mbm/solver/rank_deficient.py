"""What a normal matrix that is not of full rank determines: singular values, the rank, and the covariance of the rest.

The rule of rank is that of `solution.observability`. Singular values come from one-sided rotations (Hestenes 1958),
which find small ones to their own relative accuracy as far as the triangle has it.
"""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.machine.words import ConstantReals, Integer, Reals
from mbm.solver.decisions import EPSILON, SHARE
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import copied, dot, filled, rotate, sum_of_products
from mbm.solver.null_space import from_null_space
from mbm.solver.workspace import Work

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
