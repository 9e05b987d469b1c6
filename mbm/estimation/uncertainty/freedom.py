"""What a free combination is: a shift, a scaling, or a direction that is free to first order only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.layout import Layout
from mbm.equations.types import Floats, FreeCombination, Indices, Mask, Minimum, Motion, Observability
from mbm.solver.decisions import SHARE

TIED = 1e-6
"""Relative difference of two pivots that may be rounding: the first of them is taken, on every processor."""


def free_combinations(null_space: Floats, scale: Floats, point: Floats) -> tuple[FreeCombination, ...]:
    """A readable basis of the free directions: few coordinates in each, separate groups apart.

    ``null_space`` (n, k) in scaled coordinates. Each direction has a coordinate of its own that no other moves, and
    what falls apart into groups comes out in groups.
    """
    if not null_space.shape[1]:
        return ()
    pivots = _pivots(null_space)
    rows = np.linalg.solve(null_space[pivots].T, null_space.T)
    rows[:, pivots] = np.eye(len(pivots))
    order = np.argsort(np.array(pivots, dtype=np.int64), kind="stable")
    return tuple(free_combination(rows[i], scale, point) for i in order)


def _pivots(null_space: Floats) -> list[int]:
    """A coordinate for each of the directions (n, k): that which they move most, beside those before it.

    The pivots of a QR decomposition with column pivoting (Businger and Golub 1965), by way of the Cholesky factor of
    the products of the coordinates: a matrix is multiplied by a vector for each, and none is updated.
    """
    n, k = null_space.shape
    factor = np.zeros((k, n))
    left = np.einsum("nk,nk->n", null_space, null_space)
    pivots: list[int] = []
    for done in range(k):
        pivot = int(np.argmax(left >= (1.0 - TIED) * left.max()))
        column = null_space @ null_space[pivot] - factor[:done, pivot] @ factor[:done]
        factor[done] = column / np.sqrt(left[pivot])
        left = left - np.square(factor[done])
        pivots.append(pivot)
        left[pivots] = 0.0
    return pivots


def free_combination(direction: Floats, scale: Floats, point: Floats) -> FreeCombination:
    """One free direction (n,) in scaled coordinates as a combination."""
    indices = np.flatnonzero(np.abs(direction) > SHARE * np.abs(direction).max())
    movement = direction[indices] / scale[indices]
    values = point[indices]
    significant = bool((values != 0.0).all())
    if significant:
        relative = movement / values
        largest = relative[int(np.argmax(np.abs(relative)))]
        significant = bool(np.isfinite(relative / largest).all())
    if not significant:
        largest = movement[int(np.argmax(np.abs(movement)))]
        return FreeCombination(
            indices=tuple(int(i) for i in indices),
            coefficients=tuple(float(v) for v in movement / largest),
            relative=None,
        )
    return FreeCombination(
        indices=tuple(int(i) for i in indices),
        coefficients=tuple(float(v) for v in movement / largest),
        relative=tuple(float(v) for v in relative / largest),
    )


def touched_by(directions: Floats) -> Mask:
    """Which coordinates (n,) the free directions (n, k) move, beside the most that each of them moves."""
    if not directions.shape[1]:
        return np.zeros(len(directions), dtype=bool)
    peaks = np.abs(directions).max(axis=0)
    return np.asarray((np.abs(directions) > SHARE * peaks).any(axis=1))


ROUNDED_AWAY = 1e-9
"""Share of its error below which a number is 0 but for rounding."""

FINITE = 0.1
"""Distance of the trial movement: a tenth of the unknowns' size, far beyond first order."""

UNCHANGED = 1e-6
"""Change of the residuals, relative to what each coordinate alone would cause, that counts as none."""

MOVED = 200
"""Combinations that are looked at: of more of them is said what holds to first order."""


def sizes(layout: Layout, free: Indices, point: Floats, errors: Floats) -> Floats:
    """The largest number in a point (N,) of the unknown that a ``free`` coordinate (n,) belongs to.

    It is 1 for what turns, and where all are 0. Numbers that are nothing beside their ``errors`` (n,) are 0 but for
    rounding: these are their sizes.
    """
    found = np.ones(len(layout.number))
    for entry in layout.entries:
        found[entry.coordinates] = float(np.abs(point[entry.range]).max(initial=0.0)) or 1.0
    found[(layout.number < 0) | layout.angle] = 1.0
    own = found[free]
    return np.where(own > ROUNDED_AWAY * errors, own, errors)


def with_motions(equations: Assembled, minimum: Minimum, observed: Observability) -> Observability:
    """``observed`` with the motion of each combination, found by moving the point and looking at the residuals."""
    if not observed.combinations:
        return observed
    found = [_classified(equations, minimum, c) for c in observed.combinations[:MOVED]]
    return replace(observed, combinations=(*found, *observed.combinations[MOVED:]))


def _classified(equations: Assembled, minimum: Minimum, combination: FreeCombination) -> FreeCombination:
    indices = np.asarray(combination.indices)
    point = equations.coordinates(minimum.point)
    size = float(sizes(equations.layout, equations.free, minimum.point, np.zeros(point.size))[indices].max())
    coefficients = np.asarray(combination.coefficients)
    shifted = np.zeros(point.size)
    shifted[indices] = FINITE * size * coefficients / float(np.abs(coefficients).max())
    moves = _invisible(equations, minimum, indices, shifted)
    scales = False
    if combination.relative is not None:
        scaled = np.zeros(point.size)
        scaled[indices] = point[indices] * np.expm1(FINITE * np.asarray(combination.relative))
        scales = _invisible(equations, minimum, indices, scaled)
    # A scaling by one factor is a shift along the point itself. It is called a shift only where all unknowns are of
    # one size and so move by one amount.
    if moves and not (scales and float(np.ptp(coefficients)) > UNCHANGED):
        return replace(combination, motion=Motion.SHIFT)
    return replace(combination, motion=Motion.SCALE) if scales else combination


def _invisible(equations: Assembled, minimum: Minimum, indices: np.ndarray, step: Floats) -> bool:
    moved = equations.retract(minimum.point, step)
    expected = float(abs(minimum.jacobian[:, indices] * step[indices]).sum(axis=1).max(initial=0.0))
    with np.errstate(all="ignore"):
        change = equations.residuals(moved) - minimum.residuals
    largest = float(np.abs(change).max(initial=0.0))
    seen = not (np.isfinite(largest) and largest <= UNCHANGED * expected)
    return not seen and not _forbidden(equations, minimum, indices, step, moved)


def _forbidden(equations: Assembled, minimum: Minimum, indices: np.ndarray, step: Floats, moved: Floats) -> bool:
    """Whether a constraint that holds the estimates notices the movement."""
    held = minimum.constraints
    # Loaded where something is free only, so that other problems start at once.
    from mbm.estimation.minimise.constrained.types import constrained

    bound = constrained(equations)
    if held is None or bound is None or not bool(held.forcing.any()):
        return False
    with np.errstate(all="ignore"):
        change = np.abs(bound.constraint_values(moved) - held.values)[held.forcing]
    expected = np.abs(held.slopes[held.forcing][:, indices] * step[indices]).sum(axis=1)
    return not bool((change <= UNCHANGED * expected).all())
