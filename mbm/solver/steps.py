"""Steps: undamped, limited to a length (damped, Powell's dogleg, shortened), and inside hard bounds.

They need the scaled triangle A (n, n) and ``projected`` = Qᵀr (n,) alone: ``‖J p + r‖² = ‖A s + projected‖² + c``
for a step ``s = scale · p``. Moré (1978) for the damping; Stark and Parker (1995) for the bounds.
"""

from __future__ import annotations

from math import fabs, isfinite, sqrt

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.decisions import EPSILON, POSITIVE_KEPT, ROUNDING_OF_BOUNDS
from mbm.solver.description import BOUNDS_AT, DOGLEG, GAUSS_NEWTON, Problem
from mbm.solver.linear_algebra import (
    add_multiple,
    append_rows,
    column_product,
    copied,
    corner,
    damped_triangle,
    dot,
    filled,
    multiplied,
    solve_transposed,
    solve_upper,
    times_transposed,
    times_upper,
)
from mbm.solver.workspace import Linearisation, Work

INDEPENDENT = 1e-11
"""A column whose part across those before it is below this share of the largest column is as good as dependent, where
another run is to follow if one is."""

ROUNDED_COLUMN = 8.0 * EPSILON
"""The same for the last run, for each row or column of the Jacobian: what rounding leaves of a dependent column."""


@distinct_arrays
def norm_of(n: Integer, a: ConstantReals) -> Real:
    """``‖a‖``."""
    return sqrt(dot(n, a, a))


@distinct_arrays
def undamped_step(n: Integer, factor: ConstantReals, projected: ConstantReals, work: Work, step: Reals) -> None:
    """The Gauss-Newton step in scaled coordinates (n,); where columns are dependent, the shortest one."""
    for j in range(n):
        if factor[j * n + j] == 0.0:
            shortest_step(n, factor, projected, work, step)
            return
    copied(n, projected, step)
    solve_upper(n, factor, step)
    multiplied(n, -1.0, step)


@distinct_arrays
def shortest_step(n: Integer, factor: ConstantReals, projected: ConstantReals, work: Work, step: Reals) -> None:
    """The Gauss-Newton step of least length where rows of the triangle are zero with their diagonals.

    With the triangle T of the transposed rows R that are left, ``RᵀR`` apart: ``s = -Rᵀ T⁻¹ T⁻ᵀ projected``, and once
    more for what is left of it (corrected seminormal equations, Björck 1987).
    """
    columns = work.small_rows
    triangle = work.damped
    rest = work.right
    rank = 0
    for i in range(n):
        if factor[i * n + i] != 0.0:
            copied(n, factor[i * n :], columns[rank * n :])
            rank += 1
    filled(rank * rank, 0.0, triangle)
    append_rows(rank, n, n, columns, triangle)
    filled(n, 0.0, step)
    for _ in range(2):
        k = 0
        for i in range(n):
            if factor[i * n + i] != 0.0:
                rest[k] = projected[i] + dot(n - i, factor[i * n + i :], step[i:])
                k += 1
        solve_transposed(rank, triangle, rest)
        solve_upper(rank, triangle, rest)
        k = 0
        for i in range(n):
            if factor[i * n + i] != 0.0:
                add_multiple(n - i, -rest[k], factor[i * n + i :], step[i:])
                k += 1


def limited_step(
    problem: Problem,
    n: Integer,
    factor: ConstantReals,
    projected: ConstantReals,
    radius: Real,
    work: Work,
    step: Reals,
) -> None:
    """The undamped step where it is short enough, else the one that the problem's rule has inside ``radius``."""
    undamped_step(n, factor, projected, work, step)
    length = norm_of(n, step)
    if problem.rule == GAUSS_NEWTON:
        if length > radius:
            multiplied(n, radius / length, step)
    elif problem.rule == DOGLEG:
        if length > radius:
            dogleg_step(n, factor, projected, radius, work.right, work.row, step)
    elif length > 1.1 * radius:
        damped_step(n, factor, projected, radius, work, step)


@distinct_arrays
def dogleg_step(
    n: Integer,
    factor: ConstantReals,
    projected: ConstantReals,
    radius: Real,
    cauchy: Reals,
    image: Reals,
    step: Reals,
) -> None:
    """Where Powell's path to the undamped ``step`` leaves the ``radius`` (Powell 1970), in its place."""
    times_transposed(n, factor, projected, cauchy)
    times_upper(n, factor, cauchy, image)
    curvature = dot(n, image, image)
    share = -dot(n, cauchy, cauchy) / curvature if curvature > 0.0 else 0.0
    multiplied(n, share, cauchy)
    length = norm_of(n, cauchy)
    if length >= radius:
        copied(n, cauchy, step)
        multiplied(n, radius / length, step)
        return
    a = 0.0
    b = 0.0
    for j in range(n):
        onward = step[j] - cauchy[j]
        a += onward * onward
        b += cauchy[j] * onward
    c = length * length - radius * radius
    root = b * b - a * c
    part = -c / (b + sqrt(root if root > 0.0 else 0.0))
    for j in range(n):
        step[j] = cauchy[j] + part * (step[j] - cauchy[j])


@distinct_arrays
def damped_step(
    n: Integer, factor: ConstantReals, projected: ConstantReals, radius: Real, work: Work, step: Reals
) -> None:
    """Marquardt's step of length ``radius`` (within 10 %) in place of the undamped one, which is longer (Moré 1978)."""
    triangle = work.damped
    right = work.right
    row = work.row
    length = norm_of(n, step)
    times_transposed(n, factor, projected, right)
    ceiling = norm_of(n, right) / radius
    copied(n, step, row)
    solve_transposed(n, factor, row)
    steepness = dot(n, row, row)
    damping = 1e-3 * ceiling
    if steepness > 0.0 and isfinite(steepness):
        damping = length * (length - radius) / radius * length / steepness
    if damping > ceiling:
        damping = ceiling
    for tries in range(13):
        damped_triangle(n, factor, projected, damping, triangle, right, row)
        copied(n, right, step)
        solve_upper(n, triangle, step)
        length = norm_of(n, step)
        if tries == 12 or fabs(length - radius) <= 0.1 * radius or not isfinite(length):
            break
        copied(n, step, row)
        solve_transposed(n, triangle, row)
        slope = dot(n, row, row) / length
        least = 1e-3 * damping
        damping = damping + (length - radius) / radius * length / slope
        if not damping > least:
            damping = least
    multiplied(n, -1.0, step)


def down_of(problem: Problem, constants: ConstantReals, x: ConstantReals, j: Integer) -> Real:
    """Largest movement down (≤ 0) of a coordinate in one step."""
    found = constants[BOUNDS_AT + j] - x[j]
    if problem.positive[j] != 0 and found < (POSITIVE_KEPT - 1.0) * x[j]:
        found = (POSITIVE_KEPT - 1.0) * x[j]
    return found


def up_of(problem: Problem, constants: ConstantReals, x: ConstantReals, j: Integer) -> Real:
    """Largest movement up (≥ 0) of a coordinate."""
    return constants[BOUNDS_AT + problem.n + j] - x[j]


@distinct_arrays
def project(problem: Problem, constants: ConstantReals, x: Reals) -> None:
    """The nearest point of the box; a `positive` coordinate that is not becomes 1 (or half its upper bound)."""
    n = problem.n
    for j in range(n):
        upper = constants[BOUNDS_AT + n + j]
        if x[j] < constants[BOUNDS_AT + j]:
            x[j] = constants[BOUNDS_AT + j]
        if x[j] > upper:
            x[j] = upper
        if problem.positive[j] != 0 and x[j] <= 0.0:
            x[j] = 0.5 * upper if isfinite(upper) else 1.0


@distinct_arrays
def land(problem: Problem, constants: ConstantReals, vector: ConstantReals, stopped: ConstantReals, x: Reals) -> None:
    """Where a step led, put into the box; a coordinate that it put on a bound stands on it to the last bit."""
    n = problem.n
    project(problem, constants, x)
    for j in range(n):
        if stopped[j] != 0.0:
            bound = constants[BOUNDS_AT + n + j]
            if vector[j] < 0.0:
                bound = constants[BOUNDS_AT + j]
            if isfinite(bound) and fabs(x[j] - bound) <= ROUNDING_OF_BOUNDS * (fabs(bound) + fabs(vector[j])):
                x[j] = bound


@distinct_arrays
def chosen_columns(n: Integer, factor: ConstantReals, projected: ConstantReals, count: Integer, work: Work) -> None:
    """The triangle (count, count) of the chosen columns of A alone and its Qᵀr, as `part` and `part_projected`."""
    width = count + 1
    rows = work.small_rows
    triangle = work.small
    filled(width * width, 0.0, triangle)
    for k in range(count):
        for i in range(n):
            rows[k * n + i] = factor[i * n + work.chosen[k]] if i <= work.chosen[k] else 0.0
    copied(n, projected, rows[count * n :])
    append_rows(width, n, n, rows, triangle)
    corner(count, width, triangle, work.part)
    for i in range(count):
        work.part_projected[i] = triangle[i * width + count]


@distinct_arrays
def turn_into(n: Integer, k: Integer, row: Reals, other: Reals, end: Reals, other_end: Reals) -> None:
    """Turn two rows of a triangle, from column ``k`` on, and their first ends, so that ``row[k]`` becomes 0."""
    if row[k] == 0.0:
        return
    length = sqrt(row[k] * row[k] + other[k] * other[k])
    cosine = other[k] / length
    sine = row[k] / length
    for i in range(k, n):
        above = row[i]
        row[i] = cosine * above - sine * other[i]
        other[i] = cosine * other[i] + sine * above
    above = end[0]
    end[0] = cosine * above - sine * other_end[0]
    other_end[0] = cosine * other_end[0] + sine * above


def dependent_share(problem: Problem, residuals: Integer) -> Real:
    """The share of the largest column below which what others leave of a column counts as none."""
    if problem.strict == 1:
        return INDEPENDENT
    return ROUNDED_COLUMN * float(residuals if residuals > problem.n else problem.n)


@distinct_arrays
def without_dependent(n: Integer, least: Real, factor: Reals, projected: Reals) -> Integer:
    """Columns of a scaled triangle of which others leave a share below ``least`` get the diagonal 0; how many.

    Such a column takes no part in a step. What its row says of the columns behind it is reflected into their own rows
    (Givens), and with it what the row says of the ``projected`` (n,): else it would be lost with the column.
    """
    longest = 0.0
    for j in range(n):
        longest = max(longest, column_product(j + 1, n, factor[j:], factor[j:]))
    found = 0
    for j in range(n):
        if not fabs(factor[j * n + j]) > least * sqrt(longest):
            factor[j * n + j] = 0.0
            found += 1
            for k in range(j + 1, n):
                turn_into(n, k, factor[j * n :], factor[k * n :], projected[j:], projected[k:])
    return found


def step_of_part(problem: Problem, count: Integer, radius: Real, projected: ConstantReals, work: Work) -> None:
    """The step of the columns chosen (`part`) into `part_step`, undamped where the radius is infinite."""
    if isfinite(radius):
        limited_step(problem, count, work.part, projected, radius, work, work.part_step)
    else:
        undamped_step(count, work.part, projected, work, work.part_step)


def boxed_step(
    problem: Problem,
    place: Linearisation,
    radius: Real,
    work: Work,
    vector: Reals,
    stopped: Reals,
) -> None:
    """The step restricted to the box: what leaves it first is put on its bound, until nothing does.

    An infinite ``radius`` does not limit it.
    """
    n = problem.n
    factor = place.factor
    scale = place.scale
    x = place.x
    moving = work.moving
    rest = work.rest
    trial = work.part_step
    chosen = work.chosen
    copied(n, place.free, moving)
    copied(n, place.projected, rest)
    filled(n, 0.0, vector)
    filled(n, 0.0, stopped)
    remaining = radius
    for _ in range(n + 1):
        count = 0
        for j in range(n):
            if moving[j] != 0.0:
                chosen[count] = j
                count += 1
        if count == 0 or not remaining > 0.0:
            break
        part = work.part
        part_projected = work.part_projected
        if count == n:
            copied(n * n, factor, part)
            copied(n, rest, part_projected)
        else:
            chosen_columns(n, factor, rest, count, work)
            without_dependent(count, dependent_share(problem, work.count), part, part_projected)
        step_of_part(problem, count, remaining, part_projected, work)
        first = first_to_leave(problem, work.rows.constants, x, scale, count, chosen, trial)
        if first < 0:
            for k in range(count):
                vector[chosen[k]] = trial[k] / scale[chosen[k]]
            break
        at = chosen[first]
        vector[at] = (
            down_of(problem, work.rows.constants, x, at)
            if trial[first] < 0.0
            else up_of(problem, work.rows.constants, x, at)
        )
        stopped[at] = 1.0
        moving[at] = 0.0
        for i in range(at + 1):
            rest[i] += factor[i * n + at] * scale[at] * vector[at]
        if isfinite(radius):
            taken = 0.0
            for j in range(n):
                if stopped[j] != 0.0:
                    taken += scale[j] * vector[j] * scale[j] * vector[j]
            left = radius * radius - taken
            remaining = sqrt(left) if left > 0.0 else 0.0
    judge_step(problem, place, vector, work)


def first_to_leave(
    problem: Problem,
    constants: ConstantReals,
    x: ConstantReals,
    scale: ConstantReals,
    count: Integer,
    chosen: ConstantIntegers,
    trial: ConstantReals,
) -> Integer:
    """Which of the coordinates chosen meets its bound after the least share of the step; -1: none does."""
    found = -1
    least = 0.0
    for k in range(count):
        at = chosen[k]
        value = trial[k] / scale[at]
        low = down_of(problem, constants, x, at)
        high = up_of(problem, constants, x, at)
        if value < low or value > high:
            share = low / value if value < 0.0 else high / value
            if found < 0 or share < least:
                found = k
                least = share
    return found


def judge_step(problem: Problem, place: Linearisation, vector: ConstantReals, work: Work) -> None:
    """Promise and scaled length of any step ``vector`` (n,)."""
    n = problem.n
    scaled = work.scaled
    moved = work.moved
    for j in range(n):
        scaled[j] = place.scale[j] * vector[j]
    times_upper(n, place.factor, scaled, moved)
    work.step_predicted = -(dot(n, moved, moved) + 2.0 * dot(n, moved, place.projected))
    work.step_length = norm_of(n, scaled)
