"""Unknowns of which each value lets closed forms tell all others: one is drawn, no start is needed."""

from __future__ import annotations

import numpy as np

import mbm

STAGE = """(problem stage (data d external) (camera cam :focal 900 :center (320 240))
  (unknowns (n direction) (X (vector 3) :per d.point))
  (observe d (= [u v] (project cam (- (X point) (* s n)))) :sigma 0.2))"""


def test_a_camera_that_is_moved_by_known_steps_in_an_unknown_direction():
    """Of each point alone, a ray in each of six photographs: only the direction makes them meet."""
    generator = np.random.default_rng(0)
    points = generator.uniform(-0.3, 0.3, (20, 3)) + np.array([0.0, 0.0, 1.2])
    n = np.array([0.98, 0.1, -0.15]) / np.linalg.norm([0.98, 0.1, -0.15])
    steps = 0.02 * np.arange(6)
    seen = points[None] - steps[:, None, None] * n
    image = 900 * seen[..., :2] / seen[..., 2:] + np.array([320.0, 240.0]) + generator.normal(0.0, 0.2, (6, 20, 2))
    columns = {"s": np.repeat(steps, 20), "point": np.tile(np.arange(20.0), 6)}
    found = mbm.loads(STAGE).solve(data={"d": columns | {"u": image[..., 0].ravel(), "v": image[..., 1].ravel()}})
    freedom = 240 - 62
    assert found.cost is not None
    assert abs(found.cost - freedom) < 4 * np.sqrt(2 * freedom)  # mean and variance of χ²
    # 0.2 px in 240 readings about 75 px of parallax: some 1e-4 across, ten times that in depth
    np.testing.assert_allclose(np.asarray(found["n"].value), n, atol=0.01)
