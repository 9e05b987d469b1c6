"""A body on a turntable before a known camera, beside OpenCV's images: no starts."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import mbm

POINTS = np.array(
    [(0.1 * i - 0.15, 0.1 * j - 0.1, 0.08 * k - 0.04) for i in range(4) for j in range(3) for k in (0, 1)]
)
AXIS, FOOT = np.array([0.2, 0.3, 1.0]) / np.linalg.norm([0.2, 0.3, 1.0]), np.array([0.03, 0.02, 0.0])
NOISE, ANGLE_NOISE, PHOTOS = 0.3, 0.01, 8

TEXT = """(problem turntable (data photos external :key photo) (data d external)
  (camera cam :focal (800 800) :center (320 240))
  (unknowns (w direction) (o (vector 2)) (a angle :per photos) (C (pose 3)))
  (observe photos (= measured (a photo)) :sigma 0.01)
  (observe d (= [u v] (project cam (transform C
    (+ [(o 1) (o 2) 0] (rotate (axis-angle (* (a photo) w)) (- [x y z] [(o 1) (o 2) 0])))))) :sigma 0.3))"""


def test_an_axis_that_is_not_known() -> None:
    generator = np.random.default_rng(0)
    angles, columns = np.linspace(0.0, 5.0, PHOTOS), []
    camera = np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    for photo, angle in enumerate(angles):
        turned = (POINTS - FOOT) @ Rotation.from_rotvec(angle * AXIS).as_matrix().T + FOOT
        seen = cv2.projectPoints(turned, np.array([1.2, 0.1, 0.05]), np.array([0.05, 0.02, 1.5]), camera, None)[0][:, 0]
        noise = NOISE * generator.normal(size=seen.shape)
        columns.append(np.column_stack([np.full(len(POINTS), float(photo)), POINTS, seen + noise]))
    measured = angles + ANGLE_NOISE * generator.normal(size=PHOTOS)
    data = {
        "photos": {"photo": np.arange(float(PHOTOS)), "measured": measured},
        "d": dict(zip(("photo", "x", "y", "z", "u", "v"), np.concatenate(columns).T, strict=True)),
    }
    found = mbm.loads(TEXT).solve(data=data)
    freedom = 2 * PHOTOS * len(POINTS) + PHOTOS - (2 + 2 + PHOTOS + 6)
    assert found.cost is not None
    assert abs(found.cost - freedom) < 4 * np.sqrt(2 * freedom)  # mean and variance of χ²
    np.testing.assert_allclose(np.asarray(found["w"].value), AXIS, atol=0.01)  # 0.3 px on 0.2 m at 1.5 m: 0.003 rad
