"""Newton's last steps where Gauss-Newton's converge slowly: the part of the Hessian that ``JᵀJ`` leaves out.

As `solution.solvers.curvature` (Dennis, Gay and Welsch 1981): the term ``Σ r_i ∇²r_i`` per unit of ``‖r‖`` is taken
once from differences of the gradient, and kept. The Hessian is never formed: with the triangle A it is
``Aᵀ (I + C) A`` with C small.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.target.decisions import DIFFERENCE, LEAST_DIFFERENCE
from mbm.target.solver.description import Problem
from mbm.target.solver.linear_algebra import cholesky, dot, filled, solve_transposed, solve_upper
from mbm.target.solver.manifolds import retract
from mbm.target.solver.steps import chosen_columns, down_of, norm_of, up_of
from mbm.target.solver.sweeps import sweep
from mbm.target.solver.workspace import Linearisation, Work
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Real, Reals


def newton_step(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """Newton's step as the undamped one of the place; 0 where the Hessian is indefinite or the step leaves the box."""
    n = problem.n
    full = place.full
    factor = work.part
    projected = work.part_projected
    chosen = work.chosen
    count = 0
    for j in range(n):
        full[j] = 0.0
        if place.free[j] != 0.0:
            chosen[count] = j
            count += 1
    if count == 0:
        return 0
    chosen_columns(n, place.factor, place.projected, count, work)
    for j in range(count):
        if factor[j * count + j] == 0.0:
            return 0
    inner = work.inner
    set_inner(problem, count, chosen, sqrt(place.cost), place.scale, factor, work, inner)
    if cholesky(count, inner) == 0:
        return 0
    for i in range(count):
        projected[i] = (projected[i] - dot(i, inner[i * count :], projected)) / inner[i * count + i]
    gain = dot(count, projected, projected)
    for back in range(count):
        i = count - 1 - back
        total = projected[i]
        for k in range(i + 1, count):
            total -= inner[k * count + i] * projected[k]
        projected[i] = total / inner[i * count + i]
    solve_upper(count, factor, projected)
    length = norm_of(count, projected)
    if not isfinite(length) or not isfinite(gain):
        return 0
    for k in range(count):
        at = chosen[k]
        full[at] = -projected[k] / place.scale[at]
        low = down_of(problem, work.rows.constants, place.x, at)
        high = up_of(problem, work.rows.constants, place.x, at)
        beyond = full[at] < low or full[at] > high
        if problem.boxed == 1 and beyond:
            return 0
    place.predicted = gain
    place.length = length
    return 1


def set_inner(
    problem: Problem,
    count: Integer,
    chosen: ConstantIntegers,
    weight: Real,
    scale: ConstantReals,
    factor: ConstantReals,
    work: Work,
    inner: Reals,
) -> None:
    """``I + A⁻ᵀ C A⁻¹`` (count, count) with the second-order term C in scaled coordinates."""
    n = problem.n
    for i in range(count):
        for k in range(count):
            value = work.curvature[chosen[i] * n + chosen[k]]
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
    problem: Problem,
    work: Work,
) -> Integer:
    """The second-order term at the place of the iteration, by forward differences; 0 where it is not finite."""
    n = problem.n
    place = work.here
    curvature = work.curvature
    step = work.shift
    there = work.gradient_shifted
    point = work.trial
    residuals = work.rows.residuals[work.residuals_here * problem.most_residuals :]
    freedom = float(work.here.freedom)
    spread = sqrt(place.cost / (freedom if freedom > 1.0 else 1.0))
    total = 0.0
    for j in range(n):
        filled(n, 0.0, step)
        step[j] = DIFFERENCE * spread / place.scale[j]
        if LEAST_DIFFERENCE * fabs(place.x[j]) > step[j]:
            step[j] = LEAST_DIFFERENCE * fabs(place.x[j])
        retract(problem, place.point, step, point)
        sweep(problem, point, 1, work.penalised, work.rows, residuals, there)
        for k in range(n):
            gradient = 0.0
            for i in range(k + 1):
                gradient += place.triangle[i * (n + 1) + k] * place.triangle[i * (n + 1) + n]
            curvature[j * n + k] = (there[k] - gradient) / step[j]
            total += curvature[j * n + k]
    if not isfinite(total):
        return 0
    share = 0.5 / sqrt(place.cost)
    for j in range(n):
        for k in range(j + 1):
            value = share * (curvature[j * n + k] + curvature[k * n + j])
            curvature[j * n + k] = value
            curvature[k * n + j] = value
    return 1
