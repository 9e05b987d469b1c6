"""Derivatives of all that is read off outlines, against central differences of eighth order."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.outlines.scenes import MEASURES, compiled

DIFFERENCE = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
STEP = 1e-4
"""Relative to each unknown: h⁸ leaves nothing of functions of this smoothness, rounding 1e-13 / h."""

SCENES = [
    *((shape, "pinhole") for shape in ("box", "l-block", "cylinder", "cone", "ellipsoid", "torus", "tube", "post")),
    *(("l-block", "distorted"), ("cylinder", "fisheye"), ("torus", "orthographic"), ("sphere", "distorted")),
    *(("torus", "paper"), ("bar", "pinhole"), ("arch", "distorted")),
]


@pytest.mark.parametrize(("shape", "camera"), SCENES)
def test_against_differences(shape, camera):
    points = np.random.default_rng(3).uniform([230, 150], [480, 380], (8, 2)) - np.array([320, 240]) * (
        camera == "paper"
    )
    found = compiled(shape, camera, points=points.tolist())
    sizes = np.array([1, 1, 1, 1, 1, 1, 0.2, 800, 1])
    jacobian = found.jacobian(np.zeros(9)) * sizes
    # along three directions that all unknowns take part in: what is wrong by one of them is wrong along all
    signs = np.random.default_rng(4).choice([-1.0, 1.0], (9, 3))
    directions = signs * np.random.default_rng(5).uniform(0.5, 1.0, (9, 3))
    expected = np.empty((len(jacobian), 3))
    for k, direction in enumerate(directions.T):
        step = STEP * sizes * direction / 4
        expected[:, k] = sum(
            w * (found.residuals(i * step) - found.residuals(-i * step)) for i, w in DIFFERENCE.items()
        )
        expected[:, k] /= STEP / 4
    scale = np.abs(jacobian).max(axis=1, keepdims=True) + 1e-9
    assert np.isfinite(expected).all()
    wrong = np.abs(jacobian @ directions - expected) / scale
    assert wrong.max() < 1e-8, list(MEASURES)


@pytest.mark.parametrize("place", [(0.3, 0.2, 3.0), (0.2, -0.3, 2.5), (0.2, 0.2, 3.0), (0.3, 0.1, 3.0)])
def test_the_extent_of_a_sphere_that_touches_a_plane_through_the_eye(place):
    """The tangents from the eye in the planes y = 0 and x = 0, in closed form: 2 f a √(x² + z² - a²) / (z² - a²)."""
    found = compiled("sphere", measures=("extent", "top", "left"), angles=(0, 0, 0), place=place)
    focal, aside, z, a = np.array([800.0, 810.0]), np.array(place[:2]), place[2], 0.2
    root, depth = np.sqrt(aside**2 + z**2 - a**2), z**2 - a**2
    size = 2 * focal * a * root / depth
    values, slopes = found.residuals(np.zeros(9)), found.jacobian(np.zeros(9))
    assert np.isfinite(values).all()
    assert np.isfinite(slopes).all()
    np.testing.assert_allclose(values[:2], size, rtol=1e-9)
    np.testing.assert_allclose(slopes[:2, 3:5], np.diag(size * aside / root**2), atol=1e-8 * size.max())
    np.testing.assert_allclose(slopes[:2, 5], size * (z / root**2 - 2 * z / depth), rtol=1e-8)
