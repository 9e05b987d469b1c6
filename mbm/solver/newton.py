"""Newton's last steps where Gauss-Newton's converge slowly: the part of the Hessian that ``JᵀJ`` leaves out.

With large residuals the term ``Σ r_i ∇²r_i`` makes Gauss-Newton converge linearly, or not at all (Dennis, Gay and
Welsch 1981). Per unit of ``‖r‖``, so that it fades where the residuals do, it is taken once from differences of the
gradient, and kept. The Hessian is never formed: with the triangle A it is ``Aᵀ (I + C) A`` with C small.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals
from mbm.solver.decisions import DIFFERENCE, LEAST_DIFFERENCE
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import (
    cholesky,
    column_product,
    dot,
    filled,
    gradient_of,
    solve_lower,
    solve_lower_transposed,
    solve_transposed,
    solve_upper,
    symmetrised,
    transposed,
)
from mbm.solver.manifolds import retract
from mbm.solver.steps import chosen_columns, dependent_share, down_of, norm_of, up_of, without_dependent
from mbm.solver.sweeps import sweep
from mbm.solver.workspace import Linearisation, Work


def newton_step(problem: Problem, place: Linearisation, work: Work) -> Integer:
    """Newton's step as the undamped one of the place; 0 where the Hessian is indefinite or the step leaves the box.

    Coordinates whose columns are dependent on others are held as if a row of length 1 did.
    """
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
    if without_dependent(count, dependent_share(problem, work.count), factor, projected) > 0:
        if problem.strict == 1:
            return 0
        for j in range(count):
            if factor[j * count + j] == 0.0:
                factor[j * count + j] = 1.0
                projected[j] = 0.0
    inner = work.inner
    set_inner(problem, count, chosen, sqrt(place.cost), place.scale, factor, work, inner)
    if cholesky(count, inner) == 0:
        return 0
    solve_lower(count, inner, projected)
    gain = dot(count, projected, projected)
    solve_lower_transposed(count, inner, projected)
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
    transposed(count, inner)
    for i in range(count):
        solve_transposed(count, factor, inner[i * count :])
        inner[i * count + i] += 1.0


def set_curvature(
    problem: Problem,
    work: Work,
) -> Integer:
    """The second-order term at the place of the iteration, by differences of the gradient; 0 where it is not finite."""
    total = profiled_curvature(problem, work) if problem.profiled == 1 else plain_curvature(problem, work)
    if not isfinite(total):
        return 0
    symmetrised(problem.n, 1.0 / sqrt(work.here.cost), work.curvature)
    return 1


def difference_of(j: Integer, work: Work) -> Real:
    """How far to move coordinate ``j`` for a difference at the place of the iteration."""
    place = work.here
    freedom = float(place.freedom)
    spread = sqrt(place.cost / (freedom if freedom > 1.0 else 1.0))
    found = DIFFERENCE * spread / place.scale[j]
    least = LEAST_DIFFERENCE * fabs(place.x[j])
    return found if found > least else least


def profiled_curvature(problem: Problem, work: Work) -> Real:
    """Hessian less ``JᵀJ`` into `curvature`, by central differences of the gradient; their sum, to see it is finite."""
    n = problem.n
    place = work.here
    step = work.shift
    point = work.trial
    there = work.small
    curvature = work.curvature
    total = 0.0
    for j in range(n):
        length = difference_of(j, work)
        filled(n, 0.0, curvature[j * n :])
        for side in range(2):
            filled(n, 0.0, step)
            step[j] = length if side == 0 else -length
            retract(problem, place.point, step, point)
            sweep(problem, point, 0, work.penalised, work.rows, work.rows.constants, there)
            for k in range(n):
                curvature[j * n + k] += gradient_of(n, k, there) / (2.0 * step[j])
        for k in range(n):
            rows = j + 1 if j < k else k + 1
            curvature[j * n + k] -= column_product(rows, n + 1, place.triangle[j:], place.triangle[k:])
            total += curvature[j * n + k]
    return total


def plain_curvature(problem: Problem, work: Work) -> Real:
    """``Σ r_i ∇²r_i`` into `curvature`, by forward differences of the Jacobian; their sum, to see that it is finite."""
    n = problem.n
    place = work.here
    curvature = work.curvature
    step = work.shift
    there = work.gradient_shifted
    point = work.trial
    residuals = work.rows.residuals[work.residuals_here * problem.most_residuals :]
    total = 0.0
    for j in range(n):
        filled(n, 0.0, step)
        step[j] = difference_of(j, work)
        retract(problem, place.point, step, point)
        sweep(problem, point, 1, work.penalised, work.rows, residuals, there)
        for k in range(n):
            curvature[j * n + k] = (there[k] - gradient_of(n, k, place.triangle)) / step[j]
            total += curvature[j * n + k]
    return total
