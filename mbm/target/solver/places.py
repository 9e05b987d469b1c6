"""A place: a point with all that depends on it alone, and the tests that end the iteration there.

The tests, the metric and their constants are those of `solution.solvers.state`; the scaled triangle stands in for the
singular value decomposition. Where a diagonal of it is as good as zero the place is *deficient*: steps along that
column are zero then.
"""

from __future__ import annotations

from math import fabs, inf, sqrt

from mbm.target.decisions import CAP, EPSILON, FLOOR, HUGE, ROUNDED_ROTATION, ROUNDING_ERRORS, TINY, ZERO_COST
from mbm.target.solver.description import (
    BOUNDS_AT,
    BOXED,
    COORDINATES,
    EXACT_FIT,
    PLACES_AT,
    ROUNDING,
    RUNNING,
    SMALL_OFFSET,
)
from mbm.target.solver.linear_algebra import filled, times_transposed
from mbm.target.solver.manifolds import coordinates_of
from mbm.target.solver.newton import newton_step
from mbm.target.solver.steps import boxed_step, norm_of, undamped_step, without_dependent
from mbm.target.solver.workspace import (
    AT_COST,
    AT_LENGTH,
    AT_NOISE,
    AT_OFFSET,
    AT_POINT,
    AT_PREDICTED,
    AT_SLACK,
    COUNT_HERE,
    DEFICIENT_OF,
    ENDING_OF,
    FREE,
    FREEDOM_OF,
    FULL,
    IMAGE,
    METRIC,
    NORMS,
    PEAK,
    SLOT,
    STEP_LENGTH,
    STEP_PREDICTED,
    STOPPED,
    TOLERANCE_NOW,
    X,
    factor_at,
    place_at,
    scalars_at,
    step_at,
    triangle_at,
    vector_at,
)
from mbm.target.step_control import relative_offset
from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Integers, Reals, distinct_arrays


@distinct_arrays
def set_metric(system: ConstantIntegers, x: ConstantReals, peak: ConstantReals, scale: Reals) -> None:
    """The scale of each coordinate (n,) > 0, from the largest norms that the columns have had."""
    n = system[COORDINATES]
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
        if system[system[PLACES_AT] + j] < 0 and scale[j] > curved:
            curved = scale[j]
    for j in range(n):
        if system[system[PLACES_AT] + j] < 0 and scale[j] < ROUNDED_ROTATION * curved:
            scale[j] = curved


@distinct_arrays
def set_factor(n: Integer, triangle: ConstantReals, scale: ConstantReals, factor: Reals, image: Reals) -> Integer:
    """The scaled triangle and the image; how many columns are as good as dependent on those before them."""
    for j in range(n):
        for i in range(n):
            factor[i * n + j] = triangle[i * (n + 1) + j] / scale[j] if i <= j else 0.0
        image[j] = triangle[j * (n + 1) + n]
    return without_dependent(n, factor, image)


@distinct_arrays
def set_free(
    system: ConstantIntegers, constants: ConstantReals, x: ConstantReals, gradient: ConstantReals, free: Reals
) -> None:
    """Mark coordinates that are not at a bound which the descent direction would leave."""
    n = system[COORDINATES]
    for j in range(n):
        low = x[j] <= constants[BOUNDS_AT + j] and gradient[j] >= 0.0
        high = x[j] >= constants[BOUNDS_AT + n + j] and gradient[j] <= 0.0
        free[j] = 0.0 if low or high else 1.0


def arrive(
    system: ConstantIntegers,
    constants: ConstantReals,
    number: Integer,
    before: Integer,
    curved: Integer,
    work: Reals,
    flags: Integers,
) -> None:
    """Everything at place ``number``, whose point, cost and triangle are known; reached from ``before`` (-1: start)."""
    n = system[COORDINATES]
    place = work[place_at(system, number) :]
    x = place[vector_at(system, X) :]
    norms = place[vector_at(system, NORMS) :]
    peak = place[vector_at(system, PEAK) :]
    scale = place[vector_at(system, METRIC) :]
    triangle = place[triangle_at(system) :]
    coordinates_of(system, place[AT_POINT:], x)
    deficient = 0
    for j in range(n):
        square = 0.0
        for i in range(j + 1):
            square += triangle[i * (n + 1) + j] * triangle[i * (n + 1) + j]
        norms[j] = sqrt(square)
        if not (norms[j] > TINY and norms[j] < HUGE):
            deficient += 1
        peak[j] = norms[j]
    if before >= 0:
        old = work[place_at(system, before) + vector_at(system, PEAK) :]
        for j in range(n):
            if old[j] > peak[j]:
                peak[j] = old[j]
    set_metric(system, x, peak, scale)
    terms = 0.0
    for j in range(n):
        size = fabs(x[j]) if system[system[PLACES_AT] + j] >= 0 else 1.0
        terms += norms[j] * size * norms[j] * size
    noise = ROUNDING_ERRORS * EPSILON * (sqrt(terms) + sqrt(place[AT_COST]))
    place[AT_NOISE] = noise
    place[AT_SLACK] = 2.0 * noise * sqrt(place[AT_COST]) + noise * noise
    deficient += set_factor(n, triangle, scale, place[factor_at(system) :], place[vector_at(system, IMAGE) :])
    flags[SLOT * number + DEFICIENT_OF] = deficient
    free = place[vector_at(system, FREE) :]
    filled(n, 1.0, free)
    if system[BOXED] == 1:
        gradient = work[step_at(system, 11) :]
        times_transposed(n, place[factor_at(system) :], place[vector_at(system, IMAGE) :], gradient)
        set_free(system, constants, x, gradient, free)
    judge(system, constants, number, curved, work, flags)


def judge(
    system: ConstantIntegers, constants: ConstantReals, number: Integer, curved: Integer, work: Reals, flags: Integers
) -> None:
    """The undamped step at a place (Newton's where ``curved``), its offset, and why the iteration ends there if so."""
    n = system[COORDINATES]
    place = work[place_at(system, number) :]
    set_full_step(system, constants, place, curved, work, flags)
    norms = place[vector_at(system, NORMS) :]
    full = place[vector_at(system, FULL) :]
    x = place[vector_at(system, X) :]
    free = place[vector_at(system, FREE) :]
    moving = 0
    movement = 0.0
    terms = 0.0
    for j in range(n):
        if free[j] != 0.0:
            moving += 1
        movement += norms[j] * full[j] * norms[j] * full[j]
        size = fabs(x[j]) if system[system[PLACES_AT] + j] >= 0 else 1.0
        terms += norms[j] * size * norms[j] * size
    rank = n - flags[SLOT * number + DEFICIENT_OF]
    if rank > moving:
        rank = moving
    freedom = flags[COUNT_HERE] - rank
    flags[SLOT * number + FREEDOM_OF] = freedom
    noise = place[AT_NOISE]
    outside = place[AT_COST] - place[AT_PREDICTED]
    if outside < 0.0:
        outside = 0.0
    offset = relative_offset(place[AT_PREDICTED], outside, moving, freedom)
    place[AT_OFFSET] = offset
    ending = RUNNING
    if place[AT_COST] <= noise * noise or place[AT_COST] <= ZERO_COST:
        ending = EXACT_FIT
    elif offset <= work[scalars_at(system) + TOLERANCE_NOW]:
        ending = SMALL_OFFSET
    elif sqrt(movement) <= ROUNDING_ERRORS * EPSILON * sqrt(terms):
        ending = ROUNDING
    flags[SLOT * number + ENDING_OF] = ending


def set_full_step(
    system: ConstantIntegers, constants: ConstantReals, place: Reals, curved: Integer, work: Reals, flags: Integers
) -> None:
    """The undamped step of a place, its promise and length."""
    n = system[COORDINATES]
    full = place[vector_at(system, FULL) :]
    stopped = place[vector_at(system, STOPPED) :]
    image = place[vector_at(system, IMAGE) :]
    scale = place[vector_at(system, METRIC) :]
    factor = place[factor_at(system) :]
    filled(n, 0.0, stopped)
    if curved == 1 and newton_step(system, constants, place, work, flags) == 1:
        return
    if system[BOXED] == 1:
        scalars = work[scalars_at(system) :]
        promised = scalars[STEP_PREDICTED]
        length = scalars[STEP_LENGTH]
        boxed_step(system, constants, place, inf, 0, work, flags, full, stopped, scalars)
        place[AT_PREDICTED] = scalars[STEP_PREDICTED]
        place[AT_LENGTH] = scalars[STEP_LENGTH]
        scalars[STEP_PREDICTED] = promised
        scalars[STEP_LENGTH] = length
        return
    undamped_step(n, factor, image, full)
    inside = 0.0
    for j in range(n):
        if factor[j * n + j] != 0.0:
            inside += image[j] * image[j]
    place[AT_PREDICTED] = inside
    place[AT_LENGTH] = norm_of(n, full)
    for j in range(n):
        full[j] /= scale[j]
