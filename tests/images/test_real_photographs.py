"""Calibration from the photographs that OpenCV is shown with, beside OpenCV on the same corners."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import mbm
from tests.evidence.material import EXAMPLES, measured

DISTORTION = ("k1", "k2", "p1", "p2", "k3")


@pytest.fixture(scope="module")
def folder():
    return measured("chessboard")


@pytest.fixture(scope="module")
def solved(folder):
    return mbm.loads((EXAMPLES / "calibration.mbm").read_text(), base=folder).solve()


def corners(folder):
    from mbm.data.readers import READERS

    arguments = {"columns": 9, "rows": 6, "size": 0.025}
    table = READERS["chessboard"].read(
        {path.stem: path for path in sorted(folder.glob("left*.jpg"))}, "left*.jpg", arguments
    )
    return {column.name: column.numbers if column.texts is None else column.texts for column in table.columns}


def test_it_is_no_worse_than_opencv_on_the_same_corners(folder, solved):
    """The same model, the same corners, 12 photographs and more: least squares has one minimum here."""
    table = corners(folder)
    photos = list(dict.fromkeys(table["photo"]))
    rows = [np.flatnonzero(np.array(table["photo"]) == photo) for photo in photos]
    places = [np.column_stack([table[c][r] for c in "xyz"]).astype(np.float32) for r in rows]
    seen = [np.column_stack([table[c][r] for c in "uv"]).astype(np.float32) for r in rows]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-14)
    rms, camera, distortion, turns, ways = cv2.calibrateCamera(places, seen, (640, 480), None, None, criteria=stop)
    assert (solved.status, len(photos)) == ("ok", 13)
    squares = 0.0  # OpenCV's own rms is that of corners rounded to float32
    for r, turn, way in zip(rows, turns, ways, strict=True):
        points = np.column_stack([table[c][r] for c in "xyz"])
        made, _ = cv2.projectPoints(points, turn, way, camera, distortion)
        squares += ((made[:, 0] - np.column_stack([table[c][r] for c in "uv"])) ** 2).sum()
    assert squares / len(table["u"]) == pytest.approx(rms**2, rel=1e-4)
    assert solved.first.cost <= squares
    values = [camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2], *distortion.ravel()[:5]]
    for name, value in zip(("fx", "fy", "cx", "cy", *DISTORTION), values, strict=True):
        # The same minimum but for OpenCV's steps and the rounding of its corners.
        assert abs(solved[name].value - value) < 0.01 * solved[name].sigma, name
    assert np.isfinite(solved["T"].sigma).all()
    assert (solved["T"].sigma > 0).all()


def test_corners_are_better_than_those_published_with_the_photographs(folder, solved):
    """The file beside the photographs states 0.39 px for the calibration from its own corners."""
    published = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    stated = published.getNode("avg_reprojection_error").real()
    camera = published.getNode("camera_matrix").mat()
    assert np.sqrt(solved.first.cost / (13 * 54)) < 0.5 * stated
    # Another model (one focal length, its own corners, one of them 10 px off): a percent.
    np.testing.assert_allclose([solved[n].value for n in ("fx", "fy")], [camera[0, 0]] * 2, rtol=0.01)
