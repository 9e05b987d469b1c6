"""A road seen by a camera on it: points and turns of the image of its shoulder, seeded, and where the camera stands.

Distances from the image are stationary along it, and so is a coordinate where it turns. Both are found for real ones,
and derivatives by the place of the camera need no derivative of the parameter there.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

SHOULDER = np.array([(3, -2), (6, -1.2), (10, 0.5), (14, 0.3), (19, -1.5), (25, -2), (32, 1)], dtype=float)
FOCAL, HEIGHT, SIGMA = 800.0, 1.2, 0.5
TRUTH = (0.4, -0.3, 0.05)
COUNT = 25

_KNOTS = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(SHOULDER, axis=0), axis=1))])
_CURVE = CubicSpline(_KNOTS, SHOULDER, bc_type="natural")
_FINE = np.linspace(_KNOTS[0], _KNOTS[-1], 2001)


def _image(place: Any, s: Any) -> tuple[Array, Array]:
    """The image (2, …) of the shoulder at s, and its slope along s; ``place`` may be complex."""
    at, way = _CURVE(s), _CURVE(s, 1)
    c, sin = np.cos(place[2]), np.sin(place[2])
    x, y = at[..., 0] - place[0], at[..., 1] - place[1]
    forward, left = x * c + y * sin, y * c - x * sin
    ahead, aside = way[..., 0] * c + way[..., 1] * sin, way[..., 1] * c - way[..., 0] * sin
    image = np.array([left / forward, -HEIGHT / forward])
    slope = np.array([(aside - image[0] * ahead) / forward, -image[1] * ahead / forward])
    return FOCAL * image, FOCAL * slope


def _root(function: Any, places: Array) -> list[float]:
    """Where ``function`` changes its sign."""
    signs = function(places) < 0
    ends = [pair for pair, a, b in zip(pairwise(places), signs[:-1], signs[1:], strict=True) if a != b]
    return [float(brentq(function, *pair, xtol=1e-14)) for pair in ends]


def _distance(place: Array, p: Array) -> Any:
    """From the foot, positive left of the direction."""

    def along(s: Any) -> Array:
        image, slope = _image(place.real, s)
        found: Array = slope[0] * (image[0] - p[0]) + slope[1] * (image[1] - p[1])
        return found

    feet = _root(along, _FINE)
    foot = min(feet, key=lambda s: float(np.linalg.norm(_image(place.real, s)[0] - p)))
    image, slope = _image(place, foot)
    r = p - image
    return (slope[0] * r[1] - slope[1] * r[0]) / np.sqrt(slope[0] ** 2 + slope[1] ** 2)


def _turns(place: Array) -> Array:
    """Where the image turns from left to right or back: the coordinate, in the order along the shoulder."""
    found = _root(lambda s: _image(place.real, s)[1][0], _FINE)
    return np.array([_image(place, s)[0][0] for s in found])


def measure() -> None:
    """Write the data."""
    random = np.random.default_rng(1989)
    truth = np.array(TRUTH)
    points = _image(truth, np.linspace(0.05, 0.95, COUNT) * _KNOTS[-1])[0].T + random.normal(0, SIGMA, (COUNT, 2))
    turns = _turns(truth) + random.normal(0, SIGMA, len(_turns(truth)))
    write_table("shoulder", "points.csv", ("u", "v"), [(f"{u:.2f}", f"{v:.2f}") for u, v in points])
    write_table("shoulder", "turns.csv", ("n", "across"), [(str(n + 1), f"{u:.2f}") for n, u in enumerate(turns)])


def main() -> None:
    """Write data and expected answer."""
    measure()
    points = np.array([(float(r["u"]), float(r["v"])) for r in table("shoulder", "points.csv")])
    across = np.array([float(r["across"]) for r in table("shoulder", "turns.csv")])

    def residuals(x: Array) -> Array:
        return np.concatenate([[*map(partial(_distance, x), points)], _turns(x) - across]) / SIGMA

    found = fit(residuals, TRUTH)
    sigmas, degree = found.sigmas(), np.pi / 180
    solve = {
        "dof": found.dof,
        "cost": found.cost,
        "estimates": {
            "x": estimate(found.x[0], sigmas[0]),
            "y": estimate(found.x[1], sigmas[1]),
            "psi": estimate(found.x[2] / degree, sigmas[2] / degree),
        },
    }
    write_expected("shoulder", {"shoulder": {"solves": [solve]}})


if __name__ == "__main__":
    main()
