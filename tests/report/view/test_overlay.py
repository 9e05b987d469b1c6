"""Overlays: measured and predicted points, arrows and ellipses, against projections computed beside."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.report.view.images import image_rows
from mbm.report.view.overlay import magnification, overlay_of
from mbm.report.view.photographs import Photograph, photographs
from tests.report.view.pictured import PROBLEMS, of_folder, of_text

BOARD = """(problem one
  (data corners (table (x y u v) (-1 -1 {u} 90) (1 -1 110 90) (1 1 110 110) (-1 1 90 110) (0 0 100 100) (1 0 110 100)))
  (camera cam :focal (100 100) :center (cx cy))
  (unknowns (cx :init 90) (cy :init 90))
  (observe corners (= [u v] (project cam [x y 10])) :sigma 1 {more}))"""


def photos(folder: str, name: str) -> tuple[Photograph, ...]:
    found = of_folder(folder, name)
    rows = tuple(image_rows(found.problem, found.solution, found.seen.seeings))
    return photographs(rows, found.solution, found.seen.library)


def rows(folder: str, file: str) -> list[dict[str, str]]:
    with (PROBLEMS / folder / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_desk_is_predicted_where_its_corners_are_by_hand() -> None:
    (photo,) = photos("desk", "desk")
    found = mbm.load(PROBLEMS / "desk/desk.mbm").named("desk").solve()
    psi, xg, yg = (float(found.result.solves[0].estimates[k].value) for k in range(3))
    drawn = np.concatenate([line.points for line in photo.lines])
    places = {"board": {"1": (0.6, 0.35, 0.7), "2": (-0.6, 0.35, 0.7), "3": (-0.6, -0.35, 0.7), "4": (0.6, -0.35, 0.7)}}
    for row in rows("desk", "corners.csv"):
        part, *rest = row["path"].split("/")
        if part != "board":
            continue
        x, y, z = places["board"][rest[1]]
        forward, left = xg + np.cos(psi) * x - np.sin(psi) * y, yg + np.sin(psi) * x + np.cos(psi) * y
        predicted = 800 * np.array([left, z - 1.5]) / forward
        measured = [float(row["X"]), float(row["Y"])]
        at = int(np.argmin(np.abs(photo.measured - measured).sum(axis=1)))
        np.testing.assert_allclose(photo.measured[at], measured, rtol=0, atol=1e-9)
        np.testing.assert_allclose(photo.predicted[at], predicted, rtol=0, atol=1e-9)
        assert np.hypot(*(drawn - predicted).T).min() < 1e-9  # a line of the model ends there
    assert (photo.labels, photo.down, photo.left) == (("X", "Y"), False, True)


def test_photographs_of_a_calibration_are_told_apart_and_numbered_as_in_the_file() -> None:
    found = photos("calibration", "calibration")
    table = rows("calibration", "corners.csv")
    assert [p.name for p in found] == list(dict.fromkeys(row["photo"] for row in table))
    for photo in found:
        measured = [[float(r["u"]), float(r["v"])] for r in table if r["photo"] == photo.name]
        np.testing.assert_allclose(photo.measured, measured, rtol=0, atol=1e-9)
        assert photo.down
        assert not photo.left


def test_the_covariance_of_a_prediction_follows_from_the_estimates() -> None:
    """u = cx + 10 x: the prediction varies as the centre does, whose covariance is 1/n."""
    found = of_text(BOARD.format(u=90, more=""))
    (row,) = image_rows(found.problem, found.solution, found.seen.seeings)
    np.testing.assert_allclose(row.covariance, np.broadcast_to(np.eye(2) / 6, (6, 2, 2)), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(row.predicted[4], [100, 100], rtol=0, atol=1e-9)


def test_a_point_that_is_far_off_is_an_outlier_with_the_arrow_of_its_residual() -> None:
    found = of_text(BOARD.format(u=150, more="").replace(":sigma 1 )", ":sigma 1) (solve :robust lmeds :seed 1)"))
    (row,) = image_rows(found.problem, found.solution, found.seen.seeings)
    assert row.outlier.tolist() == [True] + [False] * 5
    (photo,) = photographs([row], found.solution, found.seen.library)
    overlay = overlay_of(photo)
    np.testing.assert_allclose(overlay.tails, row.measured, rtol=0, atol=1e-12)
    np.testing.assert_allclose(overlay.tips - overlay.tails, overlay.factor * (row.predicted - row.measured), atol=1e-9)
    np.testing.assert_allclose((row.predicted - row.measured)[0], [-60, 0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("sign", ["(subvv 2 {model} [u v])", "(subvv 2 [u v] {model})", "(= [u v] {model})"])
def test_an_image_is_found_whichever_way_its_equation_is_written(sign: str) -> None:
    text = BOARD.format(u=91, more="").replace(
        "(= [u v] (project cam [x y 10]))", sign.format(model="(project cam [x y 10])")
    )
    found = of_text(text)
    (row,) = image_rows(found.problem, found.solution, found.seen.seeings)
    np.testing.assert_allclose(row.measured[0], [91, 90], rtol=0, atol=1e-9)
    np.testing.assert_allclose(row.predicted[0], [90 + 1 / 6, 90], rtol=0, atol=1e-6)


def test_what_is_no_image_is_none() -> None:
    found = of_text("(problem p (data d (table (x y) (1 2) (2 3))) (unknowns (a :init 0)) (observe d (= y (* a x))))")
    assert found.seen.seeings == ()


@pytest.mark.parametrize(
    ("lengths", "factor"),
    [([1.0] * 10, 50.0), ([0.1] * 10, 500.0), ([200.0] * 10, 1.0), ([0.0] * 10, 1.0), ([], 1.0), ([28.0], 2.0)],
)
def test_residuals_are_magnified_by_1_2_or_5_times_a_power_of_ten(lengths: list[float], factor: float) -> None:
    """Of an image of 1,000 pixels, a typical arrow is to be about 60 long."""
    assert magnification(np.array(lengths), 1000.0) == factor


def test_ellipses_hold_95_percent() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    one = Photograph(
        name="", measured=np.array([[0.0, 0], [100, 100]]), predicted=np.array([[0.0, 0], [100, 100]]),
        covariance=np.stack([covariance, np.full((2, 2), np.nan)]), used=np.ones(2, bool), outlier=np.zeros(2, bool),
        lines=(), labels=("u", "v"), down=True, left=False,
    )  # fmt: skip
    overlay = overlay_of(one)
    assert overlay.ellipses.shape[0] == 1
    points = overlay.ellipses[0] / overlay.ellipse_factor
    distances = np.einsum("pi,ij,pj->p", points, np.linalg.inv(covariance), points)
    np.testing.assert_allclose(distances, -2 * np.log(0.05), rtol=1e-12)  # the 95 % quantile of χ² with 2


def test_cameras_of_a_calibration_stand_where_their_boards_say() -> None:
    from mbm.report.view.scene import scene_of

    found = of_folder("calibration", "calibration")
    scene = scene_of(
        found.problem,
        tuple(image_rows(found.problem, found.solution, found.seen.seeings)),
        found.solution,
        found.seen.library,
    )
    assert scene is not None
    answer = mbm.load(PROBLEMS / "calibration/calibration.mbm").solve()
    turns, places = (next(e for e in answer.result.solves[0].estimates if e.quantity.name == n) for n in ("r", "t"))
    assert turns.keys is not None
    assert len(scene.cameras) == len(turns.keys) == 5
    for key, turn, place in zip(turns.keys, turns.value, places.value, strict=True):
        (camera,) = [c for c in scene.cameras if c.name == key]
        matrix = Rotation.from_rotvec(turn).as_matrix()
        # the board has two columns x y, so that R comes from one evaluation a metre away: rounding alone
        np.testing.assert_allclose(camera.centre, -matrix.T @ place, rtol=0, atol=1e-9)
        np.testing.assert_allclose(camera.axes, np.diag([1.0, -1.0, 1.0]) @ matrix, rtol=0, atol=1e-9)


def test_the_camera_of_the_desk_stands_at_the_height_of_the_eye() -> None:
    from mbm.report.view.scene import scene_of

    found = of_folder("desk", "desk")
    scene = scene_of(
        found.problem,
        tuple(image_rows(found.problem, found.solution, found.seen.seeings)),
        found.solution,
        found.seen.library,
    )
    assert scene is not None
    (camera,) = scene.cameras
    assert camera.centre[2] == pytest.approx(1.5, abs=1e-12)
    answer = mbm.load(PROBLEMS / "desk/desk.mbm").named("desk").solve()
    away = float(answer["away"].value)
    assert np.hypot(*camera.centre[:2]) == pytest.approx(away, abs=1e-9)


def test_estimated_points_have_their_ellipsoids() -> None:
    """Two known cameras a metre apart see three points ten metres ahead."""
    from mbm.report.view.scene import scene_of

    found = of_text("""(problem stereo
      (data seen (table (point left right v) (1 10 0 5) (2 -20 -30 0) (3 0 -10 -7)))
      (data points (table (point x y) (1 1 0) (2 -2 0) (3 0 0)) :key point)
      (camera eye :focal (100 100))
      (unknowns (p (vector 3) :per points :init [x y 9]))
      (observe seen
        (= [left v] (project eye (p point))) (= [right v] (project eye (- (p point) [1 0 0]))) :sigma 1))""")
    rows_ = tuple(image_rows(found.problem, found.solution, found.seen.seeings))
    scene = scene_of(found.problem, rows_, found.solution, found.seen.library)
    assert scene is not None
    centres = sorted(camera.centre.round(9).tolist() for camera in scene.cameras)
    assert centres == [[0, 0, 0], [1, 0, 0]]
    assert sum(stroke.kind == "spread" for stroke in scene.solid.strokes) == 9
    np.testing.assert_allclose(scene.solid.dots[:, 2], 10, atol=1e-6)


def test_cameras_that_are_functions_of_the_user_are_placed_by_their_rays() -> None:
    """Two cameras of a formula, looking along -z and along +x; the points are known by their priors."""
    from mbm.report.view.rays import implied_seeings, placed_by_rays

    places = [(0, 0, -5), (1, 0, -6), (0, 1, -7), (-1, -1, -5), (1, 1, -8)]
    rows_ = []
    known = [f"({k} {x} {y} {z})" for k, (x, y, z) in enumerate(places, 1)]
    for k, (x, y, z) in enumerate(places, start=1):
        rows_ += [
            f'("a" {k} {100 * x / -z} {100 * y / -z})',
            f'("b" {k} {100 * (z + 6) / (x + 4)} {-100 * y / (x + 4)})',
        ]
    found = of_text(f"""(problem formula
      (data cameras (table (camera turned px) ("a" 0 0) ("b" 1 4)) :key camera)
      (data points (table (point x y z) {" ".join(known)}) :key point)
      (data seen (table (camera point u v) {" ".join(rows_)}) :with (cameras camera))
      (unknowns (f (vector 1) :per cameras :init [100]) (p (vector 3) :per points :init [x y z] :sigma 1))
      (observe seen
        (= [u v] (if (= cameras.turned 1)
          (* ((f camera) 1) [(/ (+ ((p point) 3) 6) (+ ((p point) 1) 4)) (- (/ ((p point) 2) (+ ((p point) 1) 4)))])
          (* ((f camera) 1) [(/ ((p point) 1) (- ((p point) 3))) (/ ((p point) 2) (- ((p point) 3)))])))
        :sigma 1))""")
    assert found.seen.seeings
    assert [s.sight.family for s in implied_seeings(found.problem)] == ["p"] * len(found.seen.seeings)
    placed = {}
    for row in image_rows(found.problem, found.solution, found.seen.seeings):
        for name in dict.fromkeys(row.photo):
            placed[name] = placed_by_rays(row, np.array(row.photo) == name, found.solution)
    first, second = placed["a"], placed["b"]
    assert first is not None
    assert second is not None
    # central differences with steps of 1e-5: errors of 1e-10, and rounding of 1e-11 over the step's share
    np.testing.assert_allclose(first.centre, [0, 0, 0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(second.centre, [-4, 0, -6], rtol=0, atol=1e-6)
    assert (first.down, second.down) == (False, True)
    assert first.axes[0] @ [1, 0, 0] > 0.9
    assert first.axes[2] @ [0, 0, -1] > 0.9
    assert second.axes[2] @ [1, 0, 0] > 0.9
    assert np.linalg.det(first.axes) == pytest.approx(
        -1, abs=1e-9
    )  # right, up, forward: forward is away from the viewer


def test_literal_members_make_no_photograph() -> None:
    (photo,) = photos("skeleton", "skeleton-near")
    assert photo.name == ""
    assert len(photo.measured) == len(rows("skeleton", "skeleton_joints.csv"))
