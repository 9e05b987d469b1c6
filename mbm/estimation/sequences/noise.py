"""The noise of transitions as matrices L: rows equal ``L w`` for a standard normal w, so that it may be singular."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbm.equations.types import Floats, Indices
from mbm.equations.whitening import stated_noise
from mbm.estimation.native.code import AnyCode
from mbm.problem.rows import Positions
from mbm.problem.tables import Table
from mbm.problem.types import Equation, NoiseKind


class Spreads:
    """L of all transitions, put together of those of their groups; local to one lowering."""

    def __init__(self, steps: int, rows: int) -> None:
        self._steps = np.arange(steps)
        self._matrices = np.zeros((steps, rows, 0))
        self._row = np.zeros(steps, dtype=np.int64)

    def add(self, spread: Floats, first: Indices, counts: Indices) -> None:
        """``spread`` (R, k, r) of a group: ``counts`` (T,) rows from ``first`` on belong to each transition."""
        size, width = spread.shape[1:]
        for k in range(int(counts.max(initial=0))):
            which = self._steps[counts > k]
            begin = self._matrices.shape[2]
            self._matrices = np.concatenate([self._matrices, np.zeros((*self._matrices.shape[:2], width))], axis=2)
            rows = self._row[which][:, None] + np.arange(size)
            part = spread[first[which] + k]
            self._matrices[which[:, None, None], rows[:, :, None], begin + np.arange(width)] = part
            self._row[which] += size

    def matrices(self) -> Floats:
        """(T, p, q), without columns that are zero in all of them."""
        used = (self._matrices != 0.0).any(axis=(0, 1))
        return np.ascontiguousarray(self._matrices[:, :, used])


def spread_of(
    equations: Sequence[Equation],
    table: str | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
    code: AnyCode,
) -> Floats:
    """L (rows, outputs, r) of the rows of some equations, by the routines of filters; those of exact ones are zero."""
    own = None if table is None else tables[table]
    rows = 1 if positions is None else len(positions)
    parts = [_root(equation, stated_noise(equation, own, positions, tables), code) for equation in equations]
    found = np.zeros((rows, sum(p.shape[1] for p in parts), sum(p.shape[2] for p in parts)))
    row = column = 0
    for part in parts:
        found[:, row : row + part.shape[1], column : column + part.shape[2]] = part
        row, column = row + part.shape[1], column + part.shape[2]
    return found


def covariance_of(equation: Equation, noise: Floats) -> Floats:
    """The covariance (rows, k, k) of what ``stated_noise`` says."""
    size = len(equation.components)
    if equation.noise_kind is NoiseKind.SIGMA:
        return np.asarray(noise[:, :, None] ** 2 * np.eye(size))
    matrices = noise.reshape(-1, size, size)
    return np.asarray(np.linalg.inv(matrices) if equation.noise_kind is NoiseKind.INFORMATION else matrices)


def _root(equation: Equation, noise: Floats, code: AnyCode) -> Floats:
    """L (rows, k, r) of one equation, without the columns that are zero in all rows."""
    size = len(equation.components)
    if not noise.shape[1]:
        return np.zeros((len(noise), size, 0))
    if equation.noise_kind is NoiseKind.SIGMA:
        return np.asarray(noise[:, :, None] * np.eye(size))
    covariances = covariance_of(equation, noise)
    matrices = np.ascontiguousarray(0.5 * (covariances + np.swapaxes(covariances, 1, 2)))  # inverses are rounded
    roots = np.zeros_like(matrices)
    code.expect(float(matrices.size * size))
    code.routine("roots_of_covariances", int, int, object, object)(len(matrices), size, matrices.ravel(), roots.ravel())
    return np.asarray(roots[:, :, (roots != 0.0).any(axis=(0, 1))])
