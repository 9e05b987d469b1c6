"""Graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020): from least squares to the truncated loss.

From the least squares and from the least absolute deviations. Deterministic, and without subsets, so for any number of
unknowns; it needs a least squares fit that is not too far off.
"""

from __future__ import annotations

from math import fabs, inf, isfinite, log, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals, distinct_arrays
from mbm.solver.consensus_constraints import moved
from mbm.solver.consensus_records import NO_CANDIDATE, ConsensusWork, Fit
from mbm.solver.consensus_scores import median, rank_of_half, robust_variance, selected, squares_of_group
from mbm.solver.consensus_units import (
    linearised,
    spread_weights,
    squares_at,
    unit_squares,
    unruled_square,
    weigh_columns,
)
from mbm.solver.decisions import (
    ABSOLUTE_ROUNDS,
    CANDIDATE_DAMPING,
    CANDIDATE_REGULARISATION,
    CONTROL_GROWTH,
    GRADUATED_FITS,
    GRADUATED_ROUNDS,
    STATED,
    STILL,
)
from mbm.solver.description import Problem
from mbm.solver.linear_algebra import cholesky, copied, dot, solve_lower, solve_lower_transposed

NEARLY_STILL = 1e-4
"""A step that promises to lower the objective by less than this has arrived, where a fit is only on the way."""

ALIKE = 1e-6
"""Squared distance of two points, in standard deviations of the residuals, below which they lead to one end."""

NEAR = 0.1
"""The same where they have the same units inside: the next fit, to these, leads from both to one point."""


def weighted_step(problem: Problem, count: Integer, damping: Real, chunk: Reals, work: ConsensusWork) -> Real:
    """The Marquardt step by the weights of the rows, and the decrease of the weighted sum of squares it promises.

    Both are 0 where something is not finite. The diagonal of the normal equations, as roots, stays in `scale`.
    """
    n = problem.n
    stride = problem.chunk
    weighted = work.weighted
    normal = work.normal
    gradient = work.gradient
    scale = work.scale
    step = work.step
    weigh_columns(n + 1, stride, count, work.by_row, chunk, weighted)
    finite = 1
    for i in range(n):
        gradient[i] = dot(count, weighted[i * stride :], chunk[n * stride :])
        step[i] = 0.0
        if not isfinite(gradient[i]):
            finite = 0
        for j in range(i + 1):
            normal[i * n + j] = dot(count, weighted[i * stride :], chunk[j * stride :])
            if not isfinite(normal[i * n + j]):
                finite = 0
    if finite == 0:
        return 0.0
    for i in range(n):
        scale[i] = sqrt(normal[i * n + i]) if normal[i * n + i] > 0.0 else 1.0
    for i in range(n):
        for j in range(i + 1):
            normal[i * n + j] = normal[i * n + j] / scale[i] / scale[j]
        normal[i * n + i] += damping + CANDIDATE_REGULARISATION
        gradient[i] = gradient[i] / scale[i]
    if cholesky(n, normal) == 0:
        return 0.0
    copied(n, gradient, step)
    solve_lower(n, normal, step)
    solve_lower_transposed(n, normal, step)
    lowered = 0.0
    for i in range(n):
        lowered += gradient[i] * step[i] + damping * step[i] * step[i]
        step[i] = -step[i] / scale[i]
    return lowered if isfinite(lowered) else 0.0


def same_inliers(units: Integer, weights: ConstantReals, squares: ConstantReals, limits: ConstantReals) -> Integer:
    """Whether units count (U,) just where their squared norms are within their limits."""
    different = 0
    for u in range(units):
        different += (weights[u] > 0.0) != (squares[u] <= limits[u])
    return different == 0


def candidate_alike(
    rule: Integer, last: Integer, objective: Real, fit: Fit, problem: Problem, work: ConsensusWork
) -> Integer:
    """Which of the first ``last`` candidates the point leads to for sure, `NO_CANDIDATE` if none.

    Candidates are ends by the limits in the work.
    """
    units = work.units
    weights = units.weights
    point = fit.point
    squares = fit.squares
    for k in range(last):
        other = work.candidates[k * problem.numbers :]
        theirs = work.candidate_squares[k * units.count :]
        if fabs(work.objectives[k] - objective) < NEAR:
            near = ALIKE
            along = 1e-3
            if rule == TRUNCATED and same_inliers(units.count, weights, theirs, units.limits) == 1:
                near = NEAR
                along = 0.1
            away = 0.0
            for j in range(problem.n):
                place = problem.number_of[j]
                if place >= 0:
                    difference = work.scale[j] * (other[place] - point[place])
                    away += along * difference * difference
            for u in range(units.count):
                if weights[u] > 0.0:
                    difference = squares[u] - theirs[u]
                    away += weights[u] * (difference * difference / (squares[u] + theirs[u] + 1e-300))
            if away < near:
                return k
    return NO_CANDIDATE


def measure(problem: Problem, count: Integer, fit: Fit, work: ConsensusWork) -> Real:
    """The squared norms of the units at a fit, and the sum of squares that no rule touches."""
    residuals = fit.chunk[problem.n * problem.chunk :]
    unit_squares(work.units, residuals, fit.squares)
    return unruled_square(count, residuals, work)


def refined(
    rule: Integer, iterations: Integer, still: Real, last: Integer, problem: Problem, work: ConsensusWork
) -> Integer:
    """Where the fit is after fits to the units that the rule picks, anew at every step; its squares follow it.

    Steps end where they promise less than ``still``. `objective` is that at the end, never above that at the start,
    infinite where there is no value. If the point comes to one of the first ``last`` candidates it stays there and the
    number of that is given.
    """
    count = linearised(problem, work.rows, work.here.point, work, work.here.chunk)
    rest = measure(problem, count, work.here, work)
    objective = objective_of(rule, work.here.squares, rest, work)
    damping = CANDIDATE_DAMPING
    alike = NO_CANDIDATE
    if isfinite(objective):
        alike = candidate_alike(rule, last, objective, work.here, problem, work)
    done = 0
    while isfinite(objective) and damping < 1e6 and done < iterations and alike == NO_CANDIDATE:
        done += 1
        here = work.here
        there = work.there
        spread_weights(work.units, count, work.by_row)
        promise = weighted_step(problem, count, damping, here.chunk, work)
        enough = still * objective if rule == GIVEN else still
        if not promise > enough:
            break
        moved(problem, here.point, work.step, work, there.point)
        linearised(problem, work.rows, there.point, work, there.chunk)
        rest_there = measure(problem, count, there, work)
        lower = objective_of(rule, there.squares, rest_there, work)
        if lower < objective:
            objective = lower
            rest = rest_there
            work.here = there
            work.there = here
            damping = max(damping * 0.1, 1e-12)
            alike = candidate_alike(rule, last, objective, there, problem, work)
        else:
            objective_of(rule, here.squares, rest, work)
            damping = max(damping * 30.0, 1e-4)
    work.objective = objective
    return alike


TRUNCATED = 0
"""Units inside their limits count with the inverse of their variances."""

TRIMMED = 1
"""The better half of each group of unknown noise counts, and units of stated noise inside their limits."""

GIVEN = 2
"""Weights as they are."""


def trimmed_mean(group: Integer, squares: ConstantReals, work: ConsensusWork) -> Real:
    """The mean of a group's better half; `threshold` (3,): its largest norm, ties of it that count, its units."""
    units = work.units
    values = work.sorted
    threshold = work.threshold
    count = squares_of_group(units, squares, group, values)
    size = 0
    for u in range(units.count):
        if units.group[u] == group:
            size = units.subset[u]
    threshold[0] = -1.0
    threshold[1] = 0.0
    threshold[2] = float(count)
    if count == 0:
        return 1.0
    half = rank_of_half(count, size)
    middle = selected(count, half - 1, values)
    total = 0.0
    ties = 0.0
    for i in range(half):
        total += values[i]
        if values[i] == middle:
            ties += 1.0
    threshold[0] = middle
    threshold[1] = ties
    return max(total / float(half), 1e-300)


@distinct_arrays
def truncated_weights(
    units: Integer, squares: ConstantReals, limits: ConstantReals, variances: ConstantReals, weights: Reals
) -> Real:
    """``Σ min(s, L)/variance``, and the weights (U,): one over the variance inside the limits (U,), 0 outside."""
    for u in range(units):
        weights[u] = 1.0 / variances[u]
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    for i in range(units // 4):
        s0 += min(squares[4 * i], limits[4 * i]) * weights[4 * i]
        s1 += min(squares[4 * i + 1], limits[4 * i + 1]) * weights[4 * i + 1]
        s2 += min(squares[4 * i + 2], limits[4 * i + 2]) * weights[4 * i + 2]
        s3 += min(squares[4 * i + 3], limits[4 * i + 3]) * weights[4 * i + 3]
    for i in range(4 * (units // 4), units):
        s0 += min(squares[i], limits[i]) * weights[i]
    for u in range(units):
        weights[u] = weights[u] if squares[u] <= limits[u] else 0.0
    return (s0 + s1) + (s2 + s3)


def objective_of(rule: Integer, squares: ConstantReals, rest: Real, work: ConsensusWork) -> Real:
    """The objective at squared norms (U,), with the weights (U,) of the units there put down in the work.

    ``rest`` is the sum of squares that no rule touches.
    """
    units = work.units
    weights = units.weights
    limits = units.limits
    total = rest
    if rule == GIVEN:
        for u in range(units.count):
            if weights[u] > 0.0:
                total += weights[u] * squares[u]
        return total if isfinite(total) else inf
    if rule == TRUNCATED:
        total += truncated_weights(units.count, squares, limits, units.variances, weights)
        return total if isfinite(total) else inf
    for u in range(units.count):
        if units.group[u] == STATED:
            total += min(squares[u], limits[u])
            weights[u] = 1.0 if squares[u] <= limits[u] else 0.0
    threshold = work.threshold
    for group in range(work.rules.groups):
        mean = trimmed_mean(group, squares, work)
        ties = threshold[1]
        for u in range(units.count):
            if units.group[u] == group:
                normed = squares[u] / units.medians[u]
                weights[u] = 0.0
                if normed < threshold[0]:
                    weights[u] = 1.0 / mean
                elif normed == threshold[0] and ties > 0.0:
                    weights[u] = 1.0 / mean
                    ties -= 1.0
        total += threshold[2] * log(mean)
    return total if isfinite(total) else inf


def widen_limits(fresh: Integer, work: ConsensusWork) -> None:
    """Limits by the noise at the present squares; smaller ones stay unless ``fresh`` is 1."""
    units = work.units
    for group in range(-1, work.rules.groups):
        variance = 1.0
        if group >= 0:
            variance = robust_variance(units, work.spent, work.here.squares, group, work.sorted)
        for u in range(units.count):
            if units.group[u] == group:
                wide = units.cuts[u] * variance
                units.limits[u] = wide if fresh == 1 else min(units.limits[u], wide)


def gnc_weight(square: Real, limit: Real, control: Real) -> Real:
    """The weight of the truncated loss made smooth (eq. 14 of the paper)."""
    if square <= control / (control + 1.0) * limit:
        return 1.0
    if square >= (control + 1.0) / control * limit:
        return 0.0
    between = sqrt(limit * control * (control + 1.0) / max(square, 1e-300)) - control
    return min(max(between, 0.0), 1.0)


def gnc_fit(absolute: Integer, problem: Problem, work: ConsensusWork) -> None:
    """The fit where weights have become 0 or 1, begun at least squares or least absolute deviations.

    Both leave out units without a value at the start; graduation takes those in that have one by then.
    """
    units = work.units
    weights = units.weights
    limits = units.limits
    squares_at(problem, work.here.point, work, work.here.squares)
    for u in range(units.count):
        weights[u] = 1.0 if isfinite(work.here.squares[u]) else 0.0
    refined(GIVEN, GRADUATED_FITS, STILL, 0, problem, work)
    for _ in range(absolute * ABSOLUTE_ROUNDS):
        for u in range(units.count):
            work.sorted[u] = sqrt(work.here.squares[u])
        least = 1e-3 * median(units.count, work.sorted) + 1e-300
        for u in range(units.count):
            weights[u] = 1.0 / max(sqrt(work.here.squares[u]), least)
        refined(GIVEN, 1, STILL, 0, problem, work)
    widen_limits(1, work)
    control = inf
    for u in range(units.count):
        square = work.here.squares[u]
        if isfinite(square):
            control = min(limits[u] / max(2.0 * square - limits[u], 1e-300), control)
    if not (control > 0.0 and isfinite(control)):
        return
    for _ in range(GRADUATED_ROUNDS):
        decided = 1
        for u in range(units.count):
            weights[u] = gnc_weight(work.here.squares[u], limits[u], control)
            if weights[u] >= 1e-6 and weights[u] <= 1.0 - 1e-6:
                decided = 0
        refined(GIVEN, 1, STILL, 0, problem, work)
        widen_limits(0, work)
        if decided == 1:
            break
        control = control * CONTROL_GROWTH
