"""Nearest places of curves by SciPy: a fine polygon tells where, a minimisation in one variable how near."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

Curve = Callable[[np.ndarray], np.ndarray]
"""The points (n, d) where the parameter is s (n,)."""

FINE = 4001
"""Corners of the polygon."""


def forms(points) -> str:
    """Points as they are written."""
    return " ".join("(" + " ".join(f"{c:.17g}" for c in point) + ")" for point in points)


def knots(points: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def spline(points: np.ndarray, *, closed: bool = False) -> CubicSpline:
    around = np.vstack([points, points[:1]]) if closed else points
    return CubicSpline(knots(around), around, bc_type="periodic" if closed else "natural")


def polyline(points: np.ndarray) -> Curve:
    lengths = knots(points)
    return lambda s: np.stack([np.interp(s, lengths, column) for column in points.T], axis=-1)


def image(curve: Curve, *, focal: float = 500.0, center=(320.0, 240.0), radial: float = 0.0) -> Curve:
    """The image by a camera at the origin that looks along z."""

    def seen(s):
        x, y, z = np.moveaxis(curve(s), -1, 0)
        x, y = x / z, y / z
        factor = 1 + radial * (x * x + y * y)
        return np.stack([center[0] + focal * x * factor, center[1] + focal * y * factor], axis=-1)

    return seen


def minima(curve: Curve, ends, p: np.ndarray) -> list[tuple[float, float]]:
    """Distance and parameter of each local minimum of the distance from ``p``, the least first.

    ``ends`` are the parameters where the curve begins, has corners, and ends.
    """
    places = np.union1d(np.linspace(ends[0], ends[-1], FINE), ends)
    squares = ((curve(places) - p) ** 2).sum(axis=1)
    around = np.concatenate([[np.inf], squares, [np.inf]])
    found = []
    for i in np.flatnonzero((squares <= around[:-2]) & (squares <= around[2:])):
        low, high = places[max(i - 1, 0)], places[min(i + 1, len(places) - 1)]

        def square(s):
            return float(((curve(np.array([s]))[0] - p) ** 2).sum())

        best = minimize_scalar(square, bounds=(low, high), method="bounded", options={"xatol": 1e-12}).x
        best = min((best, low, places[i], high), key=square)
        found.append((np.sqrt(square(best)), float(best)))
    return sorted(found)


def signed(curve: Curve, ends: tuple[float, float], p: np.ndarray) -> float:
    """The least distance, positive left of the direction; of a smooth curve."""
    distance, s = minima(curve, ends, p)[0]
    step = 1e-6 * (ends[1] - ends[0])
    before, after = curve(np.clip([s - step, s + step], *ends))
    way, r = after - before, p - curve(np.array([s]))[0]
    return float(np.copysign(distance, way[0] * r[1] - way[1] * r[0]))


def slopes(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float) -> np.ndarray:
    """The Jacobian by central differences of eighth order."""
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    columns = []
    for unit in np.eye(len(x)):
        terms = [w * (function(x + k * step * unit) - function(x - k * step * unit)) for k, w in weights.items()]
        columns.append(np.sum(terms, axis=0) / step)
    return np.column_stack(columns)
