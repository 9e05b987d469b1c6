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
    *(("torus", "paper"), ("bar", "pinhole")),
]


@pytest.mark.parametrize(("shape", "camera"), SCENES)
def test_against_differences(shape, camera):
    points = np.random.default_rng(3).uniform([230, 150], [480, 380], (8, 2)) - np.array([320, 240]) * (
        camera == "paper"
    )
    found = compiled(shape, camera, points=points.tolist())
    sizes = np.array([1, 1, 1, 1, 1, 1, 0.2, 800, 1])
    jacobian = found.jacobian(np.zeros(9))
    expected = np.empty_like(jacobian)
    for k, size in enumerate(sizes):
        step = STEP * size * np.eye(9)[k] / 4
        expected[:, k] = sum(
            w * (found.residuals(i * step) - found.residuals(-i * step)) for i, w in DIFFERENCE.items()
        )
        expected[:, k] /= STEP * size / 4
    scale = np.abs(expected * sizes).max(axis=1, keepdims=True) + 1e-9
    assert np.isfinite(expected).all()
    wrong = np.abs((jacobian - expected) * sizes) / scale
    assert wrong.max() < 1e-8, list(MEASURES)
