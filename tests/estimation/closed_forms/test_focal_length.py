"""Poses in plain numbers before a camera of unknown focal length, without starts: beside OpenCV's images."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm

Floats = np.ndarray
SPACE = np.array([(0.1 * i, 0.1 * j, 0.08 * k) for i in range(4) for j in range(3) for k in range(2)])
BOARD = np.array([(0.1 * i, 0.1 * j, 0.0) for j in range(4) for i in range(5)])
CENTRE, NOISE = np.array([320.0, 240.0]), 0.3
EXACT = 1e-6
"""Without noise the truth comes back, but for what the stopping rule leaves."""

ZOOM = """(problem zoom (data photos external :key photo) (data d external)
  (camera cam :per photos :focal ((f photo) (f photo)) :center (320 240))
  (unknowns (f :per photos {range}) {pose})
  (observe d (= [u v] (project (cam photo) {moved})) :sigma 0.3))"""

EULER = (
    "(a angle :per photos) (b angle :per photos) (c angle :per photos) (t (vector 3) :per photos)",
    "(transform (pose3 (euler (a photo) (b photo) (c photo)) (t photo)) [x y z])",
)
VECTOR = (
    "(w (vector 3) :per photos) (t (vector 3) :per photos)",
    "(transform (pose3 (axis-angle (w photo)) (t photo)) [x y z])",
)


def photographs(points: Floats, lengths: Floats, noise: float) -> dict[str, dict[str, Floats]]:
    """Each with another focal length."""
    generator, columns = np.random.default_rng(4), []
    for photo, length in enumerate(lengths):
        turn, place = generator.uniform(-0.5, 0.5, 3), np.array([*generator.uniform(-0.2, 0.2, 2), 1.5])
        camera = np.array([[length, 0, CENTRE[0]], [0, length, CENTRE[1]], [0, 0, 1]])
        seen = cv2.projectPoints(points, turn, place, camera, None)[0][:, 0]
        assert ((points @ Rotation.from_rotvec(turn).as_matrix().T + place)[:, 2] > 0).all()
        seen = seen + noise * generator.normal(size=seen.shape)
        columns.append(np.column_stack([np.full(len(points), float(photo)), points, seen]))
    rows = np.concatenate(columns)
    return {
        "photos": {"photo": np.arange(float(len(lengths)))},
        "d": dict(zip(("photo", "x", "y", "z", "u", "v"), rows.T, strict=True)),
    }


@pytest.mark.parametrize(
    ("points", "sign"), [(SPACE, 1.0), (BOARD, 1.0), (BOARD, -1.0)], ids=["space", "board", "board behind"]
)
@pytest.mark.parametrize("words", [EULER, VECTOR], ids=["euler", "vector"])
def test_a_zoom_and_a_pose_in_plain_numbers(words: tuple[str, str], points: Floats, sign: float) -> None:
    """The mirror twin, with the focal length's sign changed, is not the answer unless a range says so."""
    lengths = np.array([600.0, 900.0, 1300.0])
    text = ZOOM.format(pose=words[0], moved=words[1], range="" if sign > 0 else ":in (-5000 -50)")
    found = mbm.loads(text).solve(data=photographs(points, lengths, 0.0))
    np.testing.assert_allclose(np.asarray(found["f"].value), sign * lengths, rtol=EXACT)


def test_noise_is_all_that_is_left() -> None:
    text = ZOOM.format(pose=EULER[0], moved=EULER[1], range="")
    found = mbm.loads(text).solve(data=photographs(SPACE, np.array([600.0, 900.0]), NOISE))
    assert found.cost is not None
    freedom = 2 * 2 * len(SPACE) - 2 * 7
    assert abs(found.cost - freedom) < 4 * np.sqrt(2 * freedom)  # mean and variance of χ²
    assert (np.asarray(found["f"].value) > 0).all()
    assert (np.asarray(found["t"].value)[:, 2] > 0).all()
