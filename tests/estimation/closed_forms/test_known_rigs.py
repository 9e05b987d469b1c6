"""Cameras at known places of one body: where a board is before several of them at once, without starts."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.closed_forms.rigs import (
    Camera,
    Corners,
    Floats,
    board,
    composed,
    held,
    keyed,
    numbers,
    photographed,
    turn,
)

PHOTOS = 5
CAMERAS = [Camera(), Camera(focal=(700.0, 705.0)), Camera(focal=(750.0, 740.0))]
RIG = [(turn([0.1 * k, 0.15 * k, 0.02 * k]), np.array([-0.12 * k, 0.03 * k, 0.01 * k])) for k in range(3)]

KNOWN = """(problem known (data photos external :key photo) (data cams external :key cam) (data d external)
  (camera c :per cams :focal (f g) :center (320 240))
  (define (place (pose3 (quaternion cams.w cams.i cams.j cams.k) [cams.tx cams.ty cams.tz])))
  (unknowns (T (pose 3) :per photos))
  (observe d (= [u v] (project (c cam) (transform (compose place (T photo)) [x y z]))) :sigma 0.2) {more})"""


def places() -> dict[str, Floats]:
    """The table of the cameras: where they are, and their focal lengths."""
    columns = np.array([[float(k), *numbers(place), *CAMERAS[k].focal] for k, place in enumerate(RIG)]).T
    return dict(zip(("cam", "w", "i", "j", "k", "tx", "ty", "tz", "f", "g"), columns, strict=True))


def corners(
    noise: float, points: Floats | None = None, per_camera: int | None = None
) -> tuple[dict, list[list[float]]]:
    """Images of a board by all cameras; with ``per_camera``, of so many points of its own by each. And its places."""
    generator = np.random.default_rng(7)
    boards = held(generator, PHOTOS)
    tables = photographed(CAMERAS, RIG, boards, [range(PHOTOS)] * 3, noise, generator, points)
    every = Corners(keys=("cam", "photo"))
    for k, table in enumerate(tables):
        count = len(table.rows) // PHOTOS
        own = range(count) if per_camera is None else range(k * per_camera, (k + 1) * per_camera)
        every.rows += [(float(k), *row) for i, row in enumerate(table.rows) if i % count in own]
    table = every.columns() | {"cam": np.array([row[0] for row in every.rows])}
    return {"photos": keyed("photo", PHOTOS), "cams": places(), "d": table}, [numbers(each) for each in boards]


def solved(text: str, data: dict) -> mbm.Solved:
    text = text.replace("(data d external)", "(data d external :with (cams cam))")
    return mbm.loads(text.format(more="")).solve(data=data)


def test_a_board_before_cameras_at_known_places() -> None:
    data, expected = corners(0.0)
    np.testing.assert_allclose(solved(KNOWN, data)["T"].value, expected, atol=1e-6)  # without noise


def test_two_points_by_each_of_three_cameras_are_enough() -> None:
    """No camera could tell a pose by itself."""
    points = np.random.default_rng(3).uniform(-0.15, 0.15, size=(6, 3))
    data, expected = corners(0.0, points, per_camera=2)
    np.testing.assert_allclose(solved(KNOWN, data)["T"].value, expected, atol=1e-6)


def test_wrong_corners_do_not_hide_the_board() -> None:
    data, expected = corners(0.2)
    generator = np.random.default_rng(5)
    wrong = generator.random(len(data["d"]["u"])) < 0.15
    data["d"]["u"] = data["d"]["u"] + wrong * generator.uniform(20, 100, size=len(wrong))
    text = KNOWN.replace("{more}", "(solve :robust (gnc))")
    # a thousandth of the distance, several times what 0.2 px leave of it
    np.testing.assert_allclose(solved(text, data)["T"].value, expected, atol=3e-3)


@pytest.mark.parametrize("product", ["(compose K B (T photo))", "(between (inverse (compose K B)) (T photo))"])
def test_two_cameras_that_stand_still_to_one_another(product: str) -> None:
    """What both see of a product of unknown poses goes together."""
    data, _ = corners(0.0)
    between = composed(RIG[2], (RIG[1][0].T, -RIG[1][0].T @ RIG[1][1]))
    w, i, j, k, *shift = numbers(between)
    text = f"""(problem pair (data photos external :key photo) (data d external)
      (camera a :focal (800 810) :center (320 240)) (camera b :focal (700 705) :center (320 240))
      (camera c :focal (750 740) :center (320 240))
      (define (K (pose3 (quaternion {w} {i} {j} {k}) [{" ".join(map(str, shift))}])))
      (unknowns (B (pose 3)) (T (pose 3) :per photos))
      (observe one d (= [u v] (project a (transform (T photo) [x y z]))) :sigma 0.2 :when (= cam 0))
      (observe two d (= [u v] (project b (transform (compose B (T photo)) [x y z]))) :sigma 0.2 :when (= cam 1))
      (observe three d (= [u v] (project c (transform {product} [x y z]))) :sigma 0.2 :when (= cam 2)))"""
    found = mbm.loads(text).solve(data={"photos": data["photos"], "d": data["d"]})
    np.testing.assert_allclose(found["B"].value, numbers(RIG[1]), atol=1e-6)


@pytest.mark.parametrize("flip", ["(rot-x pi)", "(rot-y 150deg)"])
def test_a_camera_turned_away_by_a_known_pose(flip: str) -> None:
    """It looks along −z of the frame in which the poses are sought: the boards are before it all the same."""
    generator = np.random.default_rng(2)
    boards = held(generator, PHOTOS)
    (table,) = photographed([Camera()], [RIG[0]], boards, [range(PHOTOS)], 0.0, generator, board())
    text = f"""(problem away (data photos external :key photo) (data d external)
      (camera c :focal (800 810) :center (320 240))
      (unknowns (T (pose 3) :per photos))
      (observe d (= [u v] (project c (transform (compose (pose3 {flip} [0 0 0]) (T photo)) [x y z]))) :sigma 0.2))"""
    found = mbm.loads(text).solve(data={"photos": keyed("photo", PHOTOS), "d": table.columns()})
    angle, axis = (np.pi, 0) if "pi" in flip else (np.radians(150.0), 1)
    away = (turn(-angle * np.eye(3)[axis]), np.zeros(3))
    np.testing.assert_allclose(found["T"].value, [numbers(composed(away, each)) for each in boards], atol=1e-6)
