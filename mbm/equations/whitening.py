"""From stated noise to weights: h/σ for standard deviations, L⁻¹h for covariances, Lᵀh for information matrices."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import evaluate
from mbm.problem import faults
from mbm.problem.rows import Positions, lookup
from mbm.problem.tables import Table
from mbm.problem.types import Equation, NoiseKind
from mbm.text.types import MbmError
from mbm.values import dataclass

FLOOR = 1e-4
"""Standard deviation of what has no noise, beside what the noise gives the same components: standard
deviations differ from those of exact equations by its square, estimates by that times the standard deviations by which
the rows pull at what has no noise. The rounding of normal equations grows as the inverse square: in a chain of 3000
steps standard deviations are right to 2e-8, with a tenth of it to 2e-6."""

NEGATIVE = 1e-9
"""Eigenvalue of a correlation matrix below zero that is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Whitener:
    """What makes the components ``first … last`` of a row's outputs independent with variance 1.

    ``weights`` has shape (rows, k) (factors), or (rows, k, k) (matrices). ``exact`` (rows, k) are components without
    noise of their own (None: there are none); their factor is 1. ``floored``: some combination has `FLOOR`.
    """

    first: int
    last: int
    weights: Floats
    exact: Mask | None = None
    floored: bool = False

    @property
    def noisy(self) -> Mask:
        """Which components have noise of their own (rows, k)."""
        if self.exact is None:
            return np.ones(self.weights.shape[:2], dtype=bool)
        return ~self.exact

    def some(self, rows: Indices) -> Whitener:
        """The whitener of some rows."""
        exact = None if self.exact is None else self.exact[rows]
        return Whitener(self.first, self.last, self.weights[rows], exact, self.floored)

    def without(self, rows: Mask) -> Whitener:
        """The whitener with the equation left out in some ``rows``: its residuals and derivatives are zero there."""
        weights = self.weights.copy()
        weights[rows] = 0.0
        exact = None if self.exact is None else self.exact & ~rows[:, None]
        return Whitener(self.first, self.last, weights, exact, self.floored)

    def apply(self, values: Floats) -> Floats:
        """Whitened values, shape (…, rows, k), from outputs of shape (…, rows, outputs)."""
        return self._product("rij,...rj->...ri", values)

    def transposed(self, values: Floats) -> Floats:
        """Its transpose applied to whitened values (…, rows, outputs): (…, rows, k)."""
        return self._product("rij,...ri->...rj", values)

    @np.errstate(all="ignore")
    def _product(self, sum_of: str, values: Floats) -> Floats:
        """The equation's part of ``values`` by the weights: each by its own, or by matrices as ``sum_of`` says."""
        part = values[..., self.first : self.last]
        if self.weights.ndim == 2:
            return np.asarray(part * self.weights)
        return np.asarray(np.einsum(sum_of, self.weights, part), dtype=np.float64)


def whitener(
    equation: Equation,
    first: int,
    table: Table | None,
    positions: Positions | None,
    tables: Mapping[str, Table],
    *,
    may_be_exact: bool = False,
    may_be_singular: bool = False,
) -> Whitener:
    """The whitener of one equation for the rows at ``positions``; with ``may_be_exact`` sigmas may be zero.

    With ``may_be_singular`` covariances may be: combinations without noise have `FLOOR` instead.

    Raises:
        MbmError: a sigma that is not above zero, or a matrix that is not symmetric and positive definite.

    """
    noise = stated_noise(equation, table, positions, tables)
    rows, size = len(noise), len(equation.components)
    if equation.noise_kind is NoiseKind.SIGMA:
        exact = (noise == 0) & may_be_exact
        wrong = (~(noise > 0) & ~exact) | ~np.isfinite(noise)
        if bool(wrong.any()):
            row, j = np.argwhere(wrong)[0]
            raise _bad(equation, f"a sigma is {noise[row, j]:g}", table, positions, int(row))
        if bool(exact.any()):
            return Whitener(first, first + size, 1.0 / np.where(exact, 1.0, noise), exact)
        return Whitener(first, first + size, 1.0 / noise)
    if equation.noise_kind is NoiseKind.BOUND:
        raise MbmError(faults.bound_without_distribution(equation.span, None))
    matrices, floored = noise.reshape(rows, size, size), False
    if may_be_singular and equation.noise_kind is NoiseKind.COVARIANCE:
        stated, matrices = matrices, _floored(matrices)
        floored = stated is not matrices
    return Whitener(first, first + size, _roots(equation, matrices, table, positions), floored=floored)


def stated_noise(
    equation: Equation, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> Floats:
    """What is stated as the noise of an equation in the rows at ``positions``: (rows, k), or (rows, k·k)."""
    noise = np.empty((1 if positions is None else len(positions), len(equation.noise)))
    for j, column in enumerate(evaluate(equation.noise, lookup(table, positions, tables))):
        noise[:, j] = column
    return noise


def _floored(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariances (rows, k, k) whose eigenvalues, each variance being 1, are `FLOOR`² at least.

    What is no covariance, or has a variance of zero, stays as it is.
    """
    deviations = np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    fine = np.asarray((deviations > 0).all(axis=1) & np.isfinite(matrices).all(axis=(1, 2)))
    scales = np.where(fine[:, None], deviations, 1.0)
    scales = scales[:, :, None] * scales[:, None, :]
    values, vectors = np.linalg.eigh(np.where(fine[:, None, None], matrices / scales, np.eye(matrices.shape[1])))
    fine &= values[:, 0] > -NEGATIVE
    low = fine & (values[:, 0] < FLOOR**2)
    if not low.any():
        return matrices
    found = np.einsum("rij,rj,rkj->rik", vectors, np.maximum(values, FLOOR**2), vectors) * scales
    return np.where(low[:, None, None], found, matrices)


def _roots(
    equation: Equation, matrices: NDArray[np.float64], table: Table | None, positions: Positions | None
) -> Floats:
    size = matrices.shape[1]
    scale = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    skew = np.abs(matrices - matrices.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    wrong = np.flatnonzero(~(skew <= 1e-9 * scale) | ~np.isfinite(scale))
    if wrong.size:
        raise _bad(
            equation, f"the {equation.noise_kind.value} matrix is not symmetric", table, positions, int(wrong[0])
        )
    try:
        lower = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        lowest = np.linalg.eigvalsh(matrices)[:, 0]
        row = int(np.flatnonzero(~(lowest > 0))[0]) if bool((~(lowest > 0)).any()) else 0
        message = f"the {equation.noise_kind.value} matrix is not positive definite"
        raise _bad(equation, message, table, positions, row) from None
    if equation.noise_kind is NoiseKind.INFORMATION:
        return np.asarray(lower.transpose(0, 2, 1))
    identity = np.broadcast_to(np.eye(size), lower.shape)
    return np.asarray(np.linalg.solve(lower, identity))


def _bad(equation: Equation, what: str, table: Table | None, positions: Positions | None, row: int) -> MbmError:
    span = equation.noise[0].span or equation.span
    place = table.place(int(positions[row])) if table is not None and positions is not None else None
    return MbmError(faults.bad_noise(span, what, place))
