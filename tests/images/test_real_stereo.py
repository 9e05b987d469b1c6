"""A stereo pair on the bench of the photographs that OpenCV is shown with, beside `cv2.stereoCalibrate` to its end.

There is one camera's photographs. The other one's are made of them: what its pixels see of the plane of the board, as
`cv2.calibrateCamera` places it, is looked up in the photograph. So both cameras have real corners, lenses and noise.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.data.readers import READERS
from tests.evidence.material import measured

SHOTS = ("01", "02", "03", "05", "07", "12", "14")
SIZE, COLUMNS, ROWS, SQUARE = (640, 480), 9, 6, 0.025
OTHER = np.array([[560.0, 0, 331.0], [0, 562.0, 246.0], [0, 0, 1]])
LENS = np.array([-0.2, 0.05, 0.001, -0.0005, 0.0])
TURN, PLACE = Rotation.from_euler("xyz", [0.02, 0.1, -0.03]), np.array([-0.05, 0.003, 0.02])
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
NUMBERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
TEXT = f"""(problem stereo
  (data left (chessboard "left*.png" {COLUMNS} {ROWS} 25mm))
  (data right (chessboard "right*.png" {COLUMNS} {ROWS} 25mm))
  (data both (union left right))
  (camera camL :focal (l-fx l-fy) :center (l-cx l-cy) :distortion (l-k1 l-k2 l-p1 l-p2 l-k3))
  (camera camR :focal (r-fx r-fy) :center (r-cx r-cy) :distortion (r-k1 r-k2 r-p1 r-p2 r-k3))
  (unknowns {" ".join(f"({side}-{name})" for side in "lr" for name in NUMBERS)}
    (B (pose 3)) (T (pose 3) :per both.shot))
  (observe left (= [u v] (project camL (transform (T shot) [x y z]))) :sigma 1px)
  (observe right (= [u v] (project camR (transform (compose B (T shot)) [x y z]))) :sigma 1px))"""


def single(places: list[np.ndarray], seen: list[np.ndarray]) -> tuple:
    return cv2.calibrateCamera(places, seen, SIZE, None, None, criteria=STOP)


def corners(folder: Path, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Places (shots, corners, 3) and points (shots, corners, 2), as mbm detects them."""
    paths = {path.stem: path for path in sorted(folder.glob(f"{side}*.png"))}
    arguments = {"columns": COLUMNS, "rows": ROWS, "size": SQUARE}
    table = {c.name: c.numbers for c in READERS["chessboard"].read(paths, f"{side}*.png", arguments).columns}
    count = len(paths)
    return (np.column_stack([table[name] for name in names]).reshape(count, -1, len(names)) for names in ("xyz", "uv"))


def other_view(image: np.ndarray, turn: np.ndarray, place: np.ndarray, camera: np.ndarray, lens: np.ndarray):
    """What the other camera sees of the plane z = 0 of a board that is at turn, place before the first one."""
    axes, _ = cv2.Rodrigues(turn)
    u, v = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)[:, None]
    rays = cv2.undistortPoints(pixels, OTHER, LENS)[:, 0]
    there = TURN.as_matrix() @ axes
    plane = np.column_stack([there[:, 0], there[:, 1], TURN.apply(place.ravel()) + PLACE])
    x, y, w = np.linalg.solve(plane, np.column_stack([rays, np.ones(len(rays))]).T)
    board = np.column_stack([x / w, y / w, np.zeros(len(x))])
    board[:, :2] = np.clip(board[:, :2], -0.3, 0.5)  # far from the board a lens's polynomial turns back
    seen, _ = cv2.projectPoints(board, turn, place, camera, lens)
    maps = seen[:, 0].T.reshape(2, SIZE[1], SIZE[0]).astype(np.float32)
    return cv2.remap(image, maps[0], maps[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, source = tmp_path_factory.mktemp("bench"), measured("chessboard")
    images = {shot: cv2.imread(str(source / f"left{shot}.jpg"), cv2.IMREAD_GRAYSCALE) for shot in SHOTS}
    for shot, image in images.items():
        cv2.imwrite(str(folder / f"left{shot}.png"), image)
    places, points = corners(folder, "left")
    _, camera, lens, turns, ways = single(list(places.astype(np.float32)), list(points.astype(np.float32)))
    for shot, turn, way in zip(SHOTS, turns, ways, strict=True):
        cv2.imwrite(str(folder / f"right{shot}.png"), other_view(images[shot], turn, way, camera, lens))
    return folder


def squares(places, points, turns, ways, camera, lens) -> float:
    """Sum of squared distances in px², in double precision."""
    made = [cv2.projectPoints(p, t, w, camera, lens)[0][:, 0] for p, t, w in zip(places, turns, ways, strict=True)]
    return float(((np.array(made) - points) ** 2).sum())


def test_the_optimum_of_a_real_pair_is_that_of_opencv(folder):
    """No starts here; there from both single calibrations, all intrinsics free, until nothing changes."""
    solved = mbm.loads(TEXT, base=folder).solve()
    places, left = corners(folder, "left")
    _, right = corners(folder, "right")
    rounded = [[list(each.astype(np.float32)) for each in part] for part in ((places,), (left,), (right,))]
    (own,), (seen_left,), (seen_right,) = rounded
    starts = [single(own, seen)[1:3] for seen in (seen_left, seen_right)]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    _, c1, d1, c2, d2, turn, way, _, _, turns, ways, _ = cv2.stereoCalibrateExtended(
        own, seen_left, seen_right, *starts[0], *starts[1], SIZE, np.eye(3), np.zeros(3), flags=flags, criteria=STOP
    )
    there = [cv2.composeRT(t, w, cv2.Rodrigues(turn)[0], way)[:2] for t, w in zip(turns, ways, strict=True)]
    theirs = squares(places, left, turns, ways, c1, d1)
    theirs += squares(places, right, [t for t, _ in there], [w for _, w in there], c2, d2)
    scale = np.sqrt(solved.first.cost / solved.first.dof)  # `:sigma` says 1 px, and corners are better
    assert solved.status == "ok"
    assert solved.first.cost <= theirs * (1 + 1e-9)
    assert solved.first.cost == pytest.approx(theirs, rel=1e-4)
    for side, camera, lens in (("l", c1, d1), ("r", c2, d2)):
        values = (*camera[[0, 1, 0, 1], [0, 1, 2, 2]], *lens.ravel()[:5])
        for name, value in zip(NUMBERS, values, strict=True):
            found = solved[f"{side}-{name}"]
            # The same minimum but for the steps at which OpenCV ends, and its corners of 24 bits.
            assert abs(found.value - value) < 0.05 * scale * found.sigma, name
    pose, sigma = solved["B"].value, scale * solved["B"].sigma
    off = (Rotation.from_matrix(turn).inv() * Rotation.from_quat(np.roll(pose[:4], -1))).as_rotvec()
    assert (np.abs(off) < 0.05 * sigma[:3]).all()
    assert (np.abs(pose[4:] - way.ravel()) < 0.05 * sigma[3:]).all()
    # what made the second photographs, but for the plane and the interpolation, of which nothing here knows
    assert np.abs(pose[4:] - PLACE).max() < 2e-3
