"""A linearisation point: all that depends on it, the tests that end the iteration there, Newton's last steps."""

from __future__ import annotations

from math import fabs, inf, isfinite, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.decisions import (
    CAP,
    DIFFERENCE,
    FLOOR,
    HUGE,
    LEAST_DIFFERENCE,
    ROUNDED_ROTATION,
    TINY,
    ZERO_COST,
    fits_exactly,
    rounding_of_norm,
)
from mbm.solver.description import BOUNDS_AT, EXACT_FIT, ROUNDING, RUNNING, SMALL_OFFSET, Problem
from mbm.solver.linear_algebra import (
    cholesky,
    column_product,
    divided,
    dot,
    filled,
    gradient_of,
    solve_lower,
    solve_lower_transposed,
    solve_transposed,
    solve_upper,
    symmetrised,
    times_transposed,
    transposed,
)
from mbm.solver.manifolds import coordinates_of, retract
from mbm.solver.step_control import relative_offset
from mbm.solver.steps import (
    boxed_step,
    chosen_columns,
    dependent_share,
    down_of,
    norm_of,
    undamped_step,
    up_of,
    without_dependent,
)
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


@distinct_arrays
def set_metric(problem: Problem, x: ConstantReals, peak: ConstantReals, scale: Reals) -> None:
    """The scale of each coordinate (n,) > 0, from the largest norms that the columns have had."""
    n = problem.n
    most = 0.0
    least = peak[0] * fabs(x[0])
    for j in range(n):
        value = peak[j] * fabs(x[j])
        if value > most:
            most = value
        if value < least:
            least = value
    floor = FLOOR * most
    even = least >= floor and floor > 0.0
    for j in range(n):
        scale[j] = peak[j]
        if not even:
            wanted = floor / fabs(x[j]) if x[j] != 0.0 else 0.0
            if wanted > CAP * peak[j]:
                wanted = CAP * peak[j]
            if wanted > scale[j]:
                scale[j] = wanted
            if not scale[j] > 0.0:
                scale[j] = 1.0
    curved = 0.0
    for j in range(n):
        if problem.number_of[j] < 0 and scale[j] > curved:
            curved = scale[j]
    for j in range(n):
        if problem.number_of[j] < 0 and scale[j] < ROUNDED_ROTATION * curved:
            scale[j] = curved


@distinct_arrays
def set_factor(
    n: Integer, least: Real, triangle: ConstantReals, scale: ConstantReals, factor: Reals, projected: Reals
) -> Integer:
    """The scaled triangle and Qᵀr; how many columns are as good as dependent on those before them (share ``least``)."""
    for i in range(n):
        filled(i, 0.0, factor[i * n :])
        divided(n - i, triangle[i * (n + 1) + i :], scale[i:], factor[i * n + i :])
        projected[i] = triangle[i * (n + 1) + n]
    return without_dependent(n, least, factor, projected)


@distinct_arrays
def set_free(
    problem: Problem, constants: ConstantReals, x: ConstantReals, gradient: ConstantReals, free: Reals
) -> None:
    """Mark coordinates that are not at a bound which the descent direction would leave."""
    n = problem.n
    for j in range(n):
        low = x[j] <= constants[BOUNDS_AT + j] and gradient[j] >= 0.0
        high = x[j] >= constants[BOUNDS_AT + n + j] and gradient[j] <= 0.0
        free[j] = 0.0 if low or high else 1.0


def squares_of_terms(problem: Problem, slopes: ConstantReals, point: ConstantReals) -> Real:
    """``Σ (J_j x_j)²``, 1 for rotations: of the terms at a point (N,) that make residuals with ``slopes`` (n,).

    The norms of columns may stand for the slopes.
    """
    total = 0.0
    for j in range(problem.n):
        if slopes[j] != 0.0:
            place = problem.number_of[j]
            term = slopes[j] * (point[place] if place >= 0 else 1.0)
            total += term * term
    return total


def set_cost_rounding(problem: Problem, place: Linearisation) -> None:
    """The rounding of ``‖r‖`` and of the cost at a place whose norms are known."""
    noise = rounding_of_norm(squares_of_terms(problem, place.norms, place.point), place.cost)
    place.rounding = noise
    place.cost_rounding = 2.0 * noise * sqrt(place.cost) + noise * noise


def arrive(
    problem: Problem,
    place: Linearisation,
    reached: Integer,
    curved: Integer,
    work: Work,
) -> None:
    """Everything at a place whose point, cost and triangle are known; ``reached`` 1: from where the iteration is."""
    n = problem.n
    x = place.x
    norms = place.norms
    peak = place.peak
    triangle = place.triangle
    coordinates_of(problem, place.point, x)
    deficient = 0
    for j in range(n):
        norms[j] = sqrt(column_product(j + 1, n + 1, triangle[j:], triangle[j:]))
        if not (norms[j] > TINY and norms[j] < HUGE):
            deficient += 1
        peak[j] = norms[j]
    if reached == 1:
        old = work.here.peak
        for j in range(n):
            if old[j] > peak[j]:
                peak[j] = old[j]
    set_metric(problem, x, peak, place.scale)
    set_cost_rounding(problem, place)
    least = dependent_share(problem, work.count)
    deficient += set_factor(n, least, triangle, place.scale, place.factor, place.projected)
    place.deficient = deficient
    filled(n, 1.0, place.free)
    if problem.boxed == 1:
        gradient = work.gradient
        times_transposed(n, place.factor, place.projected, gradient)
        set_free(problem, work.rows.constants, x, gradient, place.free)
    judge(problem, place, curved, work)


def judge(problem: Problem, place: Linearisation, curved: Integer, work: Work) -> None:
    """The undamped step at a place (Newton's where ``curved``), its offset, and why the iteration ends there if so."""
    n = problem.n
    set_full_step(problem, place, curved, work)
    norms = place.norms
    moving = 0
    movement = 0.0
    for j in range(n):
        if place.free[j] != 0.0:
            moving += 1
        movement += norms[j] * place.full[j] * norms[j] * place.full[j]
    rank = n - place.deficient
    if rank > moving:
        rank = moving
    freedom = work.count - rank
    place.freedom = freedom
    noise = place.rounding
    outside = place.cost - place.predicted
    if outside < 0.0:
        outside = 0.0
    offset = relative_offset(place.predicted, outside, moving, freedom)
    place.offset = offset
    ending = RUNNING
    if fits_exactly(place.cost, noise) or place.cost <= ZERO_COST:
        ending = EXACT_FIT
    elif offset <= work.tolerance:
        ending = SMALL_OFFSET
    elif sqrt(movement) <= rounding_of_norm(squares_of_terms(problem, norms, place.point), 0.0):
        ending = ROUNDING
    place.ending = ending


def set_full_step(problem: Problem, place: Linearisation, curved: Integer, work: Work) -> None:
    """The undamped step of a place, its promise and length."""
    n = problem.n
    full = place.full
    projected = place.projected
    filled(n, 0.0, place.stopped)
    if curved == 1 and newton_step(problem, place, work) == 1:
        return
    if problem.boxed == 1:
        promised = work.step_predicted
        length = work.step_length
        boxed_step(problem, place, inf, work, full, place.stopped)
        place.predicted = work.step_predicted
        place.length = work.step_length
        work.step_predicted = promised
        work.step_length = length
        return
    undamped_step(n, place.factor, projected, work, full)
    inside = 0.0
    for j in range(n):
        if place.factor[j * n + j] != 0.0:
            inside += projected[j] * projected[j]
    place.predicted = inside
    place.length = norm_of(n, full)
    for j in range(n):
        full[j] /= place.scale[j]
