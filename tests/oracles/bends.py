"""Points along a curve that was moved: data that are drawn, and distances by SciPy's spline."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from tests.oracles.kinds import one

POINTS = np.array([(0, 0), (1, 2), (3, 2.5), (4, 1), (6, 0.5)])
WRITTEN = " ".join(f"({x:g} {y:g})" for x, y in POINTS)
SPLINE = CubicSpline(
    np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1))]), POINTS, bc_type="natural"
)


def along_a_bend(generator, rows=11, noise=0.05):
    """Points of the curve, moved a little, with noise in both coordinates."""
    end = SPLINE.x[-1]
    s = np.linspace(0.05 * end, 0.95 * end, rows) + generator.uniform(-0.02, 0.02, rows) * end
    x, y = (SPLINE(s) + generator.uniform(-0.3, 0.3, 2) + noise * generator.normal(size=(rows, 2))).T
    return one(x=x, y=y)


def from_the_bend(t, tables, sigma=0.05):
    """Distances (rows,), positive on the left; exact for complex shifts ``t`` (2,) with tiny imaginary parts."""
    d = tables["d"]
    return np.array([_distance(np.array([x - t[0], y - t[1]])) for x, y in zip(d["x"], d["y"], strict=True)]) / sigma


def _distance(p):
    """At the foot of the real point, one more step of Newton's method carries the imaginary part."""
    places = np.linspace(0, SPLINE.x[-1], 801)
    s = places[np.argmin(((SPLINE(places) - np.real(p)) ** 2).sum(axis=1))]
    for _ in range(8):
        step = _step(s, np.real(p))
        s = s - step
    step = -_step(s, p)
    at, way, bend = (SPLINE(s, k) for k in range(3))
    r, way = p - at - way * step - bend * step**2 / 2, way + bend * step
    return (way[0] * r[1] - way[1] * r[0]) / np.sqrt(way @ way)


def _step(s, p):
    at, way, bend = (SPLINE(s, k) for k in range(3))
    return (at - p) @ way / (way @ way + (at - p) @ bend)
