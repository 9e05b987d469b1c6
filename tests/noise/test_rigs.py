"""A stereo pair without starts, simulated by the reference's own camera model: errors are as large as their sigmas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from problems.reference import stereo
from problems.reference.cameras import Poses, exponential

FILE = Path(__file__).parents[2] / "problems" / "stereo" / "stereo.mbm"
RUNS = 300
ALLOWED = 4.0
"""Standard deviations of the mean of `RUNS` squares: of 19 such means one leaves it in one of 800 tests."""


def rotation(quaternion):
    """The matrix of a unit quaternion, by Rodrigues' formula of its rotation vector."""
    axis = quaternion[1:] / np.linalg.norm(quaternion[1:])
    return exponential(2 * np.arctan2(np.linalg.norm(quaternion[1:]), quaternion[0]) * axis)


def turned_by(matrix):
    """The rotation vector of a rotation by a small angle, to the third order."""
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2


@pytest.mark.slow
def test_errors_of_a_stereo_calibration_are_as_large_as_stated():
    random = np.random.default_rng(5)
    truth = np.concatenate([stereo.CAMERAS.ravel(), np.zeros(6 + stereo.PHOTOS.size)])
    images = stereo.seen(truth, Poses(stereo.BAR), Poses(stereo.PHOTOS))
    photos = [f"pair{i}" for i in range(1, len(stereo.PHOTOS) + 1) for _ in stereo.BOARD]
    x, y, _ = np.tile(stereo.BOARD, (len(stereo.PHOTOS), 1)).T
    turn, shift = exponential(stereo.BAR[0, :3]), stereo.BAR[0, 3:]
    names = [f"{side}-{name}" for side in stereo.SIDES for name in stereo.NAMES]
    compiled = mbm.load(FILE).compile()
    squares = []
    for _ in range(RUNS):
        data = {}
        for side, image in zip(stereo.SIDES, images, strict=True):
            u, v = (image + random.normal(0, stereo.NOISE, image.shape)).T
            data[side] = {"photo": photos, "x": x, "y": y, "u": u, "v": v}
        found = compiled.solve(data=data)
        bar, base = found["B"], found["baseline"]
        error = np.concatenate([turned_by(rotation(bar.value[:4]).T @ turn), shift - bar.value[4:]]) / bar.sigma
        inner = [(found[n].value - t) / found[n].sigma for n, t in zip(names, stereo.CAMERAS.ravel(), strict=True)]
        squares.append(np.square([*error, *inner, (base.value - np.linalg.norm(shift)) / base.sigma]))
    np.testing.assert_allclose(np.mean(squares, axis=0), 1, atol=ALLOWED * np.sqrt(2 / RUNS))
