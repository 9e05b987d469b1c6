"""Minima of sums of squares by SciPy, ended by Newton's method, and what statistics says of them: nothing of mbm's.

Functions take complex numbers, so that derivatives by the complex step (Squire and Trapp 1998) are exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, minimize

TINY = 1e-30
"""The complex step: its square is nothing beside any number here."""

STEP = 6e-6
"""Differences of exact gradients, by the size of the coordinate: the cube root of rounding."""

HELD = 1e-4
"""Distance, in standard deviations, from a bound or a constraint that counts as held before Newton's method decides."""

Function = Callable[[np.ndarray], np.ndarray]


def arctan2(y, x):
    """``arctan2`` of complex numbers with tiny imaginary parts."""
    real = np.arctan2(np.real(y), np.real(x))
    size = np.real(x) ** 2 + np.real(y) ** 2
    return real + 1j * (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / size


def wrapped(angle):
    """An angle between −π and π."""
    return angle - 2 * np.pi * np.round(np.real(angle) / (2 * np.pi))


def jacobian(function: Function, x: np.ndarray) -> np.ndarray:
    """∂function/∂x (m, n)."""
    moved = x.astype(complex) + TINY * 1j * np.eye(len(x))
    return np.array([np.imag(function(row)) / TINY for row in moved]).T.reshape(-1, len(x))


def differenced(function: Function, x: np.ndarray) -> np.ndarray:
    """∂function/∂x (m, n) by central differences, of functions that are derivatives by the complex step themselves."""
    columns = []
    for k, size in enumerate(STEP * np.maximum(np.abs(x), 1e-3)):
        step = size * np.eye(len(x))[k]
        columns.append((function(x + step) - function(x - step)) / (2 * size))
    return np.array(columns).T


@dataclass(frozen=True, kw_only=True)
class Statement:
    """``min Σ ρ(r²)`` with bounds, ``equal = 0`` and ``below <= 0``; ``loss`` None: squares."""

    residuals: Function
    start: np.ndarray
    loss: Function | None = None
    lower: np.ndarray | None = None
    upper: np.ndarray | None = None
    equal: Function | None = None
    below: Function | None = None

    def objective(self, x):
        squares = self.residuals(x) ** 2
        return np.sum(squares if self.loss is None else self.loss(squares))

    def gradient(self, x):
        return jacobian(lambda p: np.array([self.objective(p)]), x)[0]

    def limits(self, x):
        """All conditions as one vector: equations first, then what has to be at most zero, bounds last."""
        parts = [] if self.equal is None else [self.equal(x)]
        parts += [] if self.below is None else [self.below(x)]
        parts += [] if self.lower is None else [(self.lower - x)[np.isfinite(self.lower)]]
        parts += [] if self.upper is None else [(x - self.upper)[np.isfinite(self.upper)]]
        return np.concatenate([np.zeros(0), *parts])

    @property
    def equations(self) -> int:
        return 0 if self.equal is None else len(self.equal(self.start))


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """A point, the conditions that hold there (rows of their derivatives (k, n)), and the Hessian of half the sum.

    ``clear``: every condition that holds has a multiplier of its own, and the others are away from their limits.
    """

    x: np.ndarray
    holding: np.ndarray
    equations: int
    objective: float
    clear: bool


def sizes(statement: Statement, x: np.ndarray) -> np.ndarray:
    """Standard deviations of the coordinates, the others held, by which movements are measured; 1 if there is none."""
    norms = np.sqrt((jacobian(statement.residuals, x) ** 2).sum(axis=0))
    return 1.0 / np.where(norms > 0, norms, 1.0)


def minimum(statement: Statement) -> Minimum:
    """The minimum that SciPy finds from the start, to rounding."""
    x = _with_conditions(statement) if len(statement.limits(statement.start)) else _without(statement)
    return polished(statement, x)


def _without(statement: Statement) -> np.ndarray:
    def slopes(x):
        return jacobian(statement.residuals, x)

    loss = "linear" if statement.loss is None else _for_scipy(statement.loss)
    given = {"jac": slopes, "loss": loss, "x_scale": "jac"}
    found = least_squares(lambda x: np.real(statement.residuals(x)), statement.start, **given)
    return np.asarray(found.x)


def _for_scipy(loss: Function) -> Function:
    """ρ with its two derivatives (3, m)."""

    def three(squares):
        first = np.imag(loss(squares + TINY * 1j)) / TINY
        step = 1e-6 * np.maximum(squares, 1e-6)
        later, before = (np.imag(loss(squares + s + TINY * 1j)) / TINY for s in (step, -step))
        return np.array([np.real(loss(squares + 0j)), first, (later - before) / (2 * step)])

    return three


def _with_conditions(statement: Statement) -> np.ndarray:
    size, count = sizes(statement, statement.start), statement.equations

    def of(function, z):
        return np.real(function(statement.start + size * z))

    conditions = [
        {
            "type": kind,
            "fun": lambda z, p=part, s=sign: s * of(statement.limits, z)[p],
            "jac": lambda z, p=part, s=sign: s * (jacobian(statement.limits, statement.start + size * z) * size)[p],
        }
        for kind, part, sign in (("eq", slice(0, count), 1.0), ("ineq", slice(count, None), -1.0))
        if len(statement.limits(statement.start)[part])
    ]
    found = minimize(
        lambda z: float(of(statement.objective, z)), np.zeros(len(size)),
        jac=lambda z: statement.gradient(statement.start + size * z) * size,
        constraints=conditions, method="SLSQP", options={"maxiter": 500, "ftol": 1e-14},
    )  # fmt: skip
    return np.asarray(statement.start + size * found.x)


def polished(statement: Statement, x: np.ndarray, rounds: int = 12) -> Minimum:
    """Newton's method on the conditions of Karush, Kuhn and Tucker, from a point near the minimum."""
    size, count = sizes(statement, x), statement.equations
    values, slopes = np.real(statement.limits(x)), jacobian(statement.limits, x)
    away = np.abs(values) / np.maximum(np.abs(slopes * size).max(axis=1, initial=0.0), 1e-300)
    holding = np.arange(len(values)) < count
    holding |= away < HELD
    for _ in range(4):  # as conditions turn out to have no multiplier
        x, multipliers = _newton(statement, x, holding, rounds)
        wrong = np.flatnonzero(holding)[multipliers < 0]
        wrong = wrong[wrong >= count]
        if not len(wrong):
            break
        holding[wrong] = False
    values = np.real(statement.limits(x))
    rows = jacobian(statement.limits, x)
    gauge = np.abs(rows[holding] * sizes(statement, x)).max(axis=1, initial=0.0)
    strong = (np.abs(multipliers) * gauge > 1e-3)[count:].all()
    free = values[~holding] / np.maximum(np.abs(rows[~holding] * size).max(axis=1, initial=0.0), 1e-300)
    return Minimum(
        x=x, holding=rows[holding], equations=count, objective=float(np.real(statement.objective(x))),
        clear=bool(strong and (free < -1e-3).all()),
    )  # fmt: skip


def _newton(statement: Statement, x: np.ndarray, holding: np.ndarray, rounds: int) -> tuple[np.ndarray, np.ndarray]:
    multipliers = np.zeros(int(holding.sum()))
    size = sizes(statement, x)
    for _ in range(rounds):

        def forces(p, m=multipliers):
            return 0.5 * statement.gradient(p) + m @ jacobian(statement.limits, p)[holding]

        hessian = differenced(forces, x) * np.outer(size, size)
        rows = jacobian(statement.limits, x)[holding] * size
        matrix = np.block([[0.5 * (hessian + hessian.T), rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        right = np.concatenate([0.5 * statement.gradient(x) * size, np.real(statement.limits(x))[holding]])
        found = np.linalg.lstsq(matrix, -right, rcond=None)[0]
        x, multipliers = x + size * found[: len(x)], found[len(x) :]
        if np.abs(found[: len(x)]).max() < 1e-12:
            break
    return x, multipliers


def along(rows: np.ndarray, n: int) -> np.ndarray:
    """Directions (n, n − k) that no row changes."""
    if not len(rows):
        return np.eye(n)
    _, strengths, turned = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True))
    return turned[int((strengths > 1e-10).sum()) :].T


def covariance(statement: Statement, found: Minimum) -> np.ndarray:
    """``Z (Zᵀ JᵀJ Z)⁻¹ Zᵀ`` with the directions Z that the conditions leave, for residuals of unit variance."""
    slopes = jacobian(statement.residuals, found.x)
    free = along(found.holding, len(found.x))
    if not free.shape[1]:
        return np.zeros((len(found.x), len(found.x)))
    moved = slopes @ free
    scale = np.linalg.norm(moved, axis=0)
    triangle = np.linalg.qr(moved / scale)[1]
    factor = free / scale @ np.linalg.inv(triangle)
    return np.asarray(factor @ factor.T)


def lossy_covariance(statement: Statement, found: Minimum) -> np.ndarray:
    """Huber's sandwich for one loss over all rows (1981, 7.6), the information weighed: K² Σw²s n/(n − p)/(Σψ')² A⁻¹.

    With weights w = ρ', ``A = Σ w JᵀJ / Σ w``, ψ' = w + 2 s w', and ``K = 1 + p/n var ψ'/(mean ψ')²``.
    """
    slopes, squares = jacobian(statement.residuals, found.x), np.real(statement.residuals(found.x)) ** 2
    _, weight, bend = _for_scipy(statement.loss)(squares)
    n, p = slopes.shape
    information = (weight[:, None] * slopes).T @ slopes / weight.sum()
    psi = weight + 2 * squares * bend
    factor = 1 + p / n * psi.var() / psi.mean() ** 2
    spread = (weight**2 * squares).sum() * weight.sum() * factor**2 * n / (n - p) / psi.sum() ** 2
    return np.asarray(np.linalg.inv(information) * spread / weight.sum())
