"""Errors in variables by other ways: the corrections as parameters of SciPy's solver, and closed forms for the line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Floats = NDArray[np.float64]

PEARSON = np.array(
    [
        [0.0, 1000.0, 5.9, 1.0],
        [0.9, 1000.0, 5.4, 1.8],
        [1.8, 500.0, 4.4, 4.0],
        [2.6, 800.0, 4.6, 8.0],
        [3.3, 200.0, 3.5, 20.0],
        [4.4, 80.0, 3.7, 20.0],
        [5.2, 60.0, 2.8, 70.0],
        [6.1, 20.0, 2.8, 70.0],
        [6.5, 1.8, 2.4, 100.0],
        [7.4, 1.0, 1.5, 500.0],
    ]
)
"""x, weight of x, y, weight of y: Pearson's points (1901) with the weights of York (1966)."""

ODRPACK_GROWTH = np.array(
    [
        [0.0, 1265.0], [0.0, 1263.6], [5.0, 1258.0], [7.0, 1254.0], [7.5, 1253.0], [10.0, 1249.8],
        [16.0, 1237.0], [26.0, 1218.0], [30.0, 1220.6], [34.0, 1213.8], [34.5, 1215.5], [100.0, 1212.0],
    ]
)  # fmt: skip
"""x, y of the explicit example that comes with ODRPACK 2.01 (Boggs, Byrd, Rogers and Schnabel 1992)."""
ODRPACK_CONIC = np.array(
    [
        [0.50, -0.12], [1.20, -0.60], [1.60, -1.00], [1.86, -1.40], [2.12, -2.54], [2.36, -3.36], [2.44, -4.00],
        [2.36, -4.75], [2.06, -5.25], [1.74, -5.64], [1.34, -5.97], [0.90, -6.32], [-0.28, -6.44], [-0.78, -6.44],
        [-1.36, -6.41], [-1.90, -6.25], [-2.50, -5.88], [-2.88, -5.50], [-3.18, -5.24], [-3.44, -4.86],
    ]
)  # fmt: skip
"""x, y of its implicit example: points near an ellipse."""


@dataclass(frozen=True)
class Exact:
    """The optimum of a problem with its corrections as parameters: the first ``n`` parameters are the unknowns."""

    values: Floats
    sigma: Floats
    cost: float
    others: Floats


def joint_optimum(residuals: Callable[[Floats], Floats], unknowns: Floats, others: Floats) -> Exact:
    """Least squares over unknowns and corrections together, to the last digits that SciPy reaches.

    Twice, the second time from the end of the first: the tests on the way stop it early.
    """
    n = len(unknowns)
    point = np.concatenate([unknowns, others])
    for _ in range(2):
        found = least_squares(
            residuals, point, method="trf", jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        point = found.x
    full = np.linalg.inv(found.jac.T @ found.jac)
    sigma = np.sqrt(np.diag(full)[:n])
    return Exact(values=point[:n], sigma=sigma, cost=float(2 * found.cost), others=point[n:])


def york(x: Floats, wx: Floats, y: Floats, wy: Floats) -> tuple[float, float]:
    """Intercept and slope of the line with errors in both coordinates (York et al. 2004, eq. 13), iterated."""
    slope = float(np.polyfit(x, y, 1)[0])
    for _ in range(200):
        weight = wx * wy / (wx + slope**2 * wy)
        mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
        u, v = x - mean_x, y - mean_y
        beta = weight * (u / wy + slope * v / wx)
        slope = float((weight * beta * v).sum() / (weight * beta * u).sum())
    return float(mean_y - slope * mean_x), slope


def deming(x: Floats, y: Floats, ratio: float) -> tuple[float, float]:
    """Intercept and slope where the variances of y and x have one ``ratio`` (Deming 1943): the root of a quadratic."""
    covariance = np.cov(x, y)
    difference = covariance[1, 1] - ratio * covariance[0, 0]
    root = np.sqrt(difference**2 + 4 * ratio * covariance[0, 1] ** 2)
    slope = float((difference + root) / (2 * covariance[0, 1]))
    return float(y.mean() - slope * x.mean()), slope


def rim_points(conic: Floats, angle: Floats) -> Floats:
    """Points (k, 2) of the ellipse ``b3 p² + 2 b4 p q + b5 q² = 1`` with p = x − b1, q = y − b2."""
    b1, b2, b3, b4, b5 = conic
    lower = np.linalg.cholesky(np.array([[b3, b4], [b4, b5]]))
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray((np.linalg.solve(lower.T, circle) + np.array([[b1], [b2]])).T)


def rim_angles(conic: Floats, points: Floats) -> Floats:
    """Parameters of the points of the ellipse in the directions of ``points`` (k, 2) from its middle."""
    b1, b2, b3, b4, b5 = conic
    lower = np.linalg.cholesky(np.array([[b3, b4], [b4, b5]]))
    circle = lower.T @ (points - [b1, b2]).T
    return np.asarray(np.arctan2(circle[1], circle[0]))
