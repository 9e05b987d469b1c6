"""Two cameras photograph a board at once: the pair is calibrated from image files, beside `cv2.stereoCalibrate`."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.data.readers import READERS
from tests.images.rendering import CAMERA, SQUARE, chessboard, corners, middle_of, noisy, rendered, save

COLUMNS, ROWS, SHOTS = 7, 4, 7
OTHER = np.array([[390.0, 0, 157.0], [0, 393.0, 123.0], [0, 0, 1]])
TURN, PLACE = Rotation.from_euler("xyz", [0.02, 0.12, 0.03]), np.array([-0.06, 0.004, 0.01])
TEXT = f"""(problem stereo
  (data left (chessboard "left*.png" {COLUMNS} {ROWS} 25mm))
  (data right (chessboard "right*.png" {COLUMNS} {ROWS} 25mm))
  (data both (union left right))
  (camera camL :focal (fx fy) :center (cx cy))
  (camera camR :focal (gx gy) :center (dx dy))
  (unknowns (fx) (fy) (cx) (cy) (gx) (gy) (dx) (dy) (B (pose 3)) (T (pose 3) :per both.shot))
  (observe left (= [u v] (project camL (transform (T shot) [x y z]))) :sigma 1px)
  (observe right (= [u v] (project camR (transform (compose B (T shot)) [x y z]))) :sigma 1px))"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Seven shots by both cameras; the right one has an eighth of its own."""
    folder = tmp_path_factory.mktemp("stereo")
    random = np.random.default_rng(6)
    for shot in range(SHOTS + 1):
        tilt = Rotation.from_euler("xy", random.uniform(-0.6, 0.6, 2))
        turn = tilt * Rotation.from_euler("z", random.uniform(-0.5, 0.5))
        place = middle_of(corners(COLUMNS, ROWS), turn, 0.4)
        if shot < SHOTS:
            save(
                folder / f"left{shot:02}.png",
                noisy(rendered(chessboard(COLUMNS, ROWS), turn, place), random, 3),
            )
        seen = rendered(chessboard(COLUMNS, ROWS), TURN * turn, TURN.apply(place) + PLACE, camera=OTHER)
        save(folder / f"right{shot:02}.png", noisy(seen, random, 3))
    return folder


def points(folder, side, count=SHOTS):
    paths = {f"{side}{k:02}": folder / f"{side}{k:02}.png" for k in range(count)}
    arguments = {"columns": COLUMNS, "rows": ROWS, "size": SQUARE}
    table = {c.name: c.numbers for c in READERS["chessboard"].read(paths, f"{side}*.png", arguments).columns}
    return np.column_stack([table["u"], table["v"]]).reshape(count, -1, 2)


def test_a_stereo_pair_is_calibrated_from_image_files(folder):
    solved = mbm.loads(TEXT, base=folder).solve()
    assert solved.status == "ok"
    assert solved.first.dof == 2 * COLUMNS * ROWS * (2 * SHOTS + 1) - 8 - 6 - 6 * (SHOTS + 1)
    scale = np.sqrt(solved.first.cost / solved.first.dof)  # `:sigma` says 1 px, and corners are much better
    truth = (*CAMERA[[0, 1, 0, 1], [0, 1, 2, 2]], *OTHER[[0, 1, 0, 1], [0, 1, 2, 2]])
    for name, value in zip(("fx", "fy", "cx", "cy", "gx", "gy", "dx", "dy"), truth, strict=True):
        assert abs(solved[name].value - value) < 4 * scale * solved[name].sigma, name
    pose, sigma = solved["B"].value, scale * solved["B"].sigma
    off = (TURN.inv() * Rotation.from_quat(np.roll(pose[:4], -1))).as_rotvec()
    assert (np.abs(off) < 4 * sigma[:3]).all()
    assert (np.abs(pose[4:] - PLACE) < 4 * sigma[3:]).all()


def test_it_is_the_optimum_of_opencv(folder, tmp_path):
    """On the shots of both cameras, which alone `cv2.stereoCalibrate` takes, after each camera by itself."""
    for path in folder.glob("*.png"):
        if path.name != f"right{SHOTS:02}.png":
            (tmp_path / path.name).write_bytes(path.read_bytes())
    solved = mbm.loads(TEXT, base=tmp_path).solve()
    places = [corners(COLUMNS, ROWS).astype(np.float32)] * SHOTS
    seen = [list(points(folder, side).astype(np.float32)) for side in ("left", "right")]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
    plain = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    single = [
        cv2.calibrateCamera(places, points, (320, 240), None, None, flags=plain, criteria=stop)[1] for points in seen
    ]
    _, left, _, right, _, turn, place, *_ = cv2.stereoCalibrate(
        places,
        *seen,
        single[0],
        np.zeros(5),
        single[1],
        np.zeros(5),
        (320, 240),
        flags=plain | cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=stop,
    )
    found = (*left[[0, 1, 0, 1], [0, 1, 2, 2]], *right[[0, 1, 0, 1], [0, 1, 2, 2]])
    scale = np.sqrt(solved.first.cost / solved.first.dof)
    for name, value in zip(("fx", "fy", "cx", "cy", "gx", "gy", "dx", "dy"), found, strict=True):
        # The same minimum but for OpenCV's steps and the rounding of its corners to 24 bits, 1e-5 px.
        assert abs(solved[name].value - value) < 0.02 * scale * solved[name].sigma, name
    pose, sigma = solved["B"].value, scale * solved["B"].sigma
    off = (Rotation.from_matrix(turn).inv() * Rotation.from_quat(np.roll(pose[:4], -1))).as_rotvec()
    assert (np.abs(off) < 0.02 * sigma[:3]).all()
    assert (np.abs(pose[4:] - place[:, 0]) < 0.02 * sigma[3:]).all()
