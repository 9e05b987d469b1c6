"""Free directions → free combinations: the few unknowns that move together, and by how much each."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, FreeCombination, Mask
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
