"""A shape of which only the place is unknown is found by its contour, without a start."""

from __future__ import annotations

import numpy as np

import mbm

TEXT = """(problem ball
  (data e external)
  (camera cam :focal (700 700) :center (320 240))
  (unknowns (p (vector 3)))
  (observe e (contour-distance (silhouette cam (trans p (sphere 5cm))) [u v]) :sigma 0.3))"""


def test_a_sphere_is_found_where_it_is() -> None:
    # The contour is the circle in which the cone from the camera touches the sphere; without noise, p is exact.
    centre, radius = np.array([0.1, -0.05, 0.6]), 0.05
    distance = np.linalg.norm(centre)
    sight = centre / distance
    across = np.cross(sight, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)[:, None]
    ring = np.cos(turn) * across + np.sin(turn) * np.cross(sight, across)
    points = centre - sight * radius**2 / distance + radius * np.sqrt(1 - (radius / distance) ** 2) * ring
    seen = {"u": 700 * points[:, 0] / points[:, 2] + 320, "v": 700 * points[:, 1] / points[:, 2] + 240}
    found = mbm.loads(TEXT).solve(data={"e": seen})
    np.testing.assert_allclose(found["p"].value, centre, atol=1e-6)
