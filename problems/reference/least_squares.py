"""Least squares for ``expected.json``: SciPy's solver on exact derivatives, nothing of mbm.

Derivatives are taken by complex steps (Squire & Trapp 1998), which lose no digits, so residual functions have to be
analytic: no absolute values, no ``atan2``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

PROBLEMS = Path(__file__).parents[1]
Array = np.ndarray[Any, np.dtype[Any]]
STEP = 1e-200


@dataclass(frozen=True, slots=True)
class Fit:
    """Estimates (n,), their covariance (n, n) for whitened residuals, and the sum of squares at the minimum."""

    x: Array
    covariance: Array
    cost: float
    residuals: Array
    jacobian: Array

    @property
    def dof(self) -> int:
        """Residuals less unknowns."""
        return len(self.residuals) - len(self.x)

    def sigmas(self, factor: float = 1.0) -> Array:
        """Standard deviations (n,)."""
        return factor * np.sqrt(np.diag(self.covariance))

    def sigma_of(self, function: Callable[[Array], Any], factor: float = 1.0) -> float:
        """Standard deviation of a number computed from the estimates, to first order."""
        gradient = derivative(lambda x: np.atleast_1d(function(x)), self.x)[0]
        return factor * float(np.sqrt(gradient @ self.covariance @ gradient))


def derivative(function: Callable[[Array], Array], x: Array) -> Array:
    """The Jacobian (m, n) by complex steps."""
    columns = [function(x + 1j * STEP * unit).imag / STEP for unit in np.eye(len(x))]
    return np.column_stack(columns)


def fit(residuals: Callable[[Array], Array], start: Sequence[float]) -> Fit:
    """The minimum of the sum of squared whitened residuals (m,)."""
    found = least_squares(
        residuals,
        np.asarray(start, dtype=float),
        jac=lambda x: derivative(residuals, x),
        x_scale="jac",
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
        max_nfev=1000,
    )
    x = found.x
    for _ in range(3):  # Gauss-Newton steps to the last digits, which SciPy's stopping rules leave.
        x = x - np.linalg.lstsq(derivative(residuals, x), residuals(x), rcond=None)[0]
    jacobian, left = derivative(residuals, x), residuals(x)
    return Fit(x, np.linalg.inv(jacobian.T @ jacobian), float(left @ left), left, jacobian)


def fit_components(
    residuals: Callable[[Array], Array], start: Sequence[float], groups: Sequence[slice]
) -> tuple[Fit, Array]:
    """As ``fit``, with an unknown factor on the noise of each group of rows: Helmert's simplified iteration.

    s² of a group is its sum of squares by its redundancy, until nothing changes (Förstner 1979).
    """
    factors = np.ones(len(groups))
    while True:
        scale = np.ones(len(residuals(np.asarray(start, dtype=float))))
        for rows, factor in zip(groups, factors, strict=True):
            scale[rows] = factor
        found = fit(lambda x, scale=scale: residuals(x) / scale, start)  # type: ignore[misc]
        hat = np.einsum("ij,jk,ik->i", found.jacobian, found.covariance, found.jacobian)
        ratios = np.array([np.sqrt(np.sum(found.residuals[g] ** 2) / np.sum(1 - hat[g])) for g in groups])
        factors = factors * ratios
        start = found.x.tolist()
        if np.abs(ratios - 1).max() < 1e-13:
            return found, factors


def estimate(value: Any, sigma: Any) -> dict[str, Any]:
    """An entry of ``estimates`` or ``derived``."""
    return {"value": np.asarray(value).tolist(), "sigma": np.asarray(sigma).tolist()}


def write_expected(name: str, expectations: Mapping[str, Any]) -> None:
    """``expected.json`` of a problem's folder."""
    text = json.dumps(expectations, indent=1, ensure_ascii=False)
    (PROBLEMS / name / "expected.json").write_text(text + "\n", encoding="utf-8")


def table(name: str, file: str) -> list[dict[str, str]]:
    """The rows of a CSV file of a problem's folder."""
    import csv

    with (PROBLEMS / name / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def write_table(name: str, file: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """A CSV file of a problem's folder."""
    import csv

    with (PROBLEMS / name / file).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
