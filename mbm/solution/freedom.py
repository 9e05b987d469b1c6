"""Free directions → free combinations: the few unknowns that move together, and by how much each."""

from __future__ import annotations

import numpy as np

from mbm.solution.types import Floats, FreeCombination, Mask
from mbm.target.decisions import SHARE

TIED = 1e-6
"""Relative difference of two pivots that may be rounding: the first of them is taken, on every processor."""


def free_combinations(null_space: Floats, scale: Floats, point: Floats) -> tuple[FreeCombination, ...]:
    """A readable basis of the free directions: few coordinates in each, separate groups apart.

    ``null_space`` (n, k) in scaled coordinates. Gauss-Jordan elimination with complete pivoting: each direction has a
    coordinate of its own that no other moves, and what falls apart into groups comes out in groups. Rows above a pivot
    wait for the end, where all of them are reduced at once.
    """
    rows = np.array(null_space.T)
    pivots: list[int] = []
    for done in range(rows.shape[0]):
        sizes = np.abs(rows[done:])
        best, column = divmod(int(np.argmax(sizes >= (1.0 - TIED) * sizes.max())), rows.shape[1])
        rows[[done, done + best]] = rows[[done + best, done]]
        rows[done] /= rows[done, column]
        below = rows[done + 1 :]
        below -= below[:, column, None] * rows[done]
        below[:, column] = 0.0
        pivots.append(column)
    rows[:] = np.linalg.solve(rows[:, pivots], rows)
    rows[:, pivots] = np.eye(len(pivots))
    order = np.argsort(np.array(pivots, dtype=np.int64), kind="stable")
    return tuple(free_combination(rows[i], scale, point) for i in order)


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
