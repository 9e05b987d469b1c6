"""Newton's last steps where Gauss-Newton's converge slowly: the part of the Hessian that ``JᵀJ`` leaves out.

As `solution.solvers.curvature` (Dennis, Gay and Welsch 1981): the term ``Σ r_i ∇²r_i`` per unit of ``‖r‖`` is taken
once from differences of the gradient, and kept. The Hessian is never formed: with the triangle A it is
``Aᵀ (I + C) A`` with C small.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import DIFFERENCE, LEAST_DIFFERENCE
from mbm.target.solver.description import BOXED, COORDINATES
from mbm.target.solver.linear_algebra import cholesky, dot, filled, solve_transposed, solve_upper
from mbm.target.solver.manifolds import retract
from mbm.target.solver.steps import chosen_columns, down_of, norm_of, up_of
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_POINT,
    AT_PREDICTED,
    FLAGS,
    FREE,
    FREEDOM_OF,
    FULL,
    HERE,
    IMAGE,
    METRIC,
    PENALISED,
    RESIDUALS_HERE,
    SLOT,
    X,
    curvature_at,
    factor_at,
    matrix_at,
    place_at,
    residuals_at,
    small_rows_at,
    small_triangle_at,
    step_at,
    trial_at,
    triangle_at,
    vector_at,
)
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Real, Reals


def newton_step(
    system: ConstantIntegers, constants: ConstantReals, place: Reals, work: Reals, flags: Integers
) -> Integer:
    """Newton's step as the undamped one of the place; 0 where the Hessian is indefinite or the step leaves the box."""
    n = system[COORDINATES]
    free = place[vector_at(system, FREE) :]
    scale = place[vector_at(system, METRIC) :]
    full = place[vector_at(system, FULL) :]
    x = place[vector_at(system, X) :]
    factor = work[matrix_at(system, 1) :]
    image = work[step_at(system, 9) :]
    chosen = flags[FLAGS:]
    count = 0
    for j in range(n):
        full[j] = 0.0
        if free[j] != 0.0:
            chosen[count] = j
            count += 1
    if count == 0:
        return 0
    rows = work[small_rows_at(system) :]
    triangle = work[small_triangle_at(system) :]
    whole = place[factor_at(system) :]
    chosen_columns(n, whole, place[vector_at(system, IMAGE) :], count, chosen, rows, triangle, factor, image)
    for j in range(count):
        if factor[j * count + j] == 0.0:
            return 0
    inner = work[matrix_at(system, 2) :]
    set_inner(system, count, chosen, sqrt(place[AT_COST]), scale, factor, work, inner)
    if cholesky(count, inner) == 0:
        return 0
    for i in range(count):
        image[i] = (image[i] - dot(i, inner[i * count :], image)) / inner[i * count + i]
    gain = dot(count, image, image)
    for back in range(count):
        i = count - 1 - back
        total = image[i]
        for k in range(i + 1, count):
            total -= inner[k * count + i] * image[k]
        image[i] = total / inner[i * count + i]
    solve_upper(count, factor, image)
    length = norm_of(count, image)
    if not isfinite(length) or not isfinite(gain):
        return 0
    for k in range(count):
        at = chosen[k]
        full[at] = -image[k] / scale[at]
        beyond = full[at] < down_of(system, constants, x, at) or full[at] > up_of(system, constants, x, at)
        if system[BOXED] == 1 and beyond:
            return 0
    place[AT_PREDICTED] = gain
    place[AT_LENGTH] = length
    return 1


def set_inner(
    system: ConstantIntegers,
    count: Integer,
    chosen: ConstantIntegers,
    weight: Real,
    scale: ConstantReals,
    factor: ConstantReals,
    work: Reals,
    inner: Reals,
) -> None:
    """``I + A⁻ᵀ C A⁻¹`` (count, count) with the second-order term C in scaled coordinates."""
    n = system[COORDINATES]
    curvature = work[curvature_at(system) :]
    for i in range(count):
        for k in range(count):
            value = curvature[chosen[i] * n + chosen[k]]
            inner[i * count + k] = weight / (scale[chosen[i]] * scale[chosen[k]]) * value
        solve_transposed(count, factor, inner[i * count :])
    for i in range(count):
        for k in range(i):
            value = inner[i * count + k]
            inner[i * count + k] = inner[k * count + i]
            inner[k * count + i] = value
    for i in range(count):
        solve_transposed(count, factor, inner[i * count :])
        inner[i * count + i] += 1.0


def set_curvature(
    system: ConstantIntegers,
    constants: ConstantReals,
    data: ConstantIntegers,
    index: ConstantIntegers,
    columns: ConstantIntegers,
    work: Reals,
    flags: Integers,
) -> Integer:
    """The second-order term at the place of the iteration, by forward differences; 0 where it is not finite."""
    n = system[COORDINATES]
    place = work[place_at(system, flags[HERE]) :]
    triangle = place[triangle_at(system) :]
    scale = place[vector_at(system, METRIC) :]
    x = place[vector_at(system, X) :]
    curvature = work[curvature_at(system) :]
    step = work[step_at(system, 14) :]
    there = work[step_at(system, 13) :]
    point = work[trial_at(system, 0) :]
    residuals = work[residuals_at(system, flags[RESIDUALS_HERE]) :]
    freedom = float(flags[SLOT * flags[HERE] + FREEDOM_OF])
    spread = sqrt(place[AT_COST] / (freedom if freedom > 1.0 else 1.0))
    total = 0.0
    for j in range(n):
        filled(n, 0.0, step)
        step[j] = DIFFERENCE * spread / scale[j]
        if LEAST_DIFFERENCE * fabs(x[j]) > step[j]:
            step[j] = LEAST_DIFFERENCE * fabs(x[j])
        retract(system, place[AT_POINT:], step, point)
        sweep(system, constants, data, index, columns, point, 1, flags[PENALISED], work, residuals, there)
        for k in range(n):
            gradient = 0.0
            for i in range(k + 1):
                gradient += triangle[i * (n + 1) + k] * triangle[i * (n + 1) + n]
            curvature[j * n + k] = (there[k] - gradient) / step[j]
            total += curvature[j * n + k]
    if not isfinite(total):
        return 0
    share = 0.5 / sqrt(place[AT_COST])
    for j in range(n):
        for k in range(j + 1):
            value = share * (curvature[j * n + k] + curvature[k * n + j])
            curvature[j * n + k] = value
            curvature[k * n + j] = value
    return 1
