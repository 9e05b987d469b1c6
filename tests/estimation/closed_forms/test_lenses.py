"""Cameras of every model from points of space and nearly plane boards, without starts: beside formulas in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm

Floats = np.ndarray
NOISE = 0.2
"""Of the images, px."""

CENTRE = np.array([320.0, 240.0])


def pinhole(places: Floats, focal: tuple[float, float], lens: tuple[float, ...] = ()) -> Floats:
    """By OpenCV."""
    camera = np.array([[focal[0], 0, CENTRE[0]], [0, focal[1], CENTRE[1]], [0, 0, 1]])
    return cv2.projectPoints(places, np.zeros(3), np.zeros(3), camera, np.array([*lens, *[0.0] * (5 - len(lens))]))[0][
        :, 0
    ]


def fisheye(places: Floats, focal: tuple[float, float], lens: tuple[float, ...] = ()) -> Floats:
    """Kannala and Brandt's."""
    out = np.hypot(*places[:, :2].T)
    angle = np.arctan2(out, places[:, 2])
    bent = angle * (1 + sum(k * angle ** (2 * i + 2) for i, k in enumerate(lens)))
    return places[:, :2] * (bent / out)[:, None] * focal + CENTRE


def parallel(places: Floats, focal: tuple[float, float]) -> Floats:
    return places[:, :2] * focal + CENTRE


def plate(depth: float, seed: int) -> Floats:
    """A board of 18 x 12 cm, off its plane by some share of its length."""
    points = np.array([(0.03 * i - 0.09, 0.03 * j - 0.06, 0.0) for j in range(5) for i in range(7)])
    points[:, 2] = np.random.default_rng(seed).uniform(-0.5, 0.5, size=len(points)) * depth * 0.18
    return points


def cloud(count: int, seed: int) -> Floats:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, size=(count, 3)) * [0.1, 0.08, 0.08]


def views(points: Floats, image: Callable[[Floats], Floats], far: float, seed: int, count: int = 4) -> dict:
    """Photographs of points held some way before the camera."""
    generator = np.random.default_rng(seed)
    rows = []
    for photo in range(count):
        turn = Rotation.from_rotvec(generator.uniform(-0.5, 0.5, size=3)).as_matrix()
        shift = np.array([*generator.uniform(-0.1, 0.1, size=2), far * generator.uniform(0.8, 1.3)])
        seen = image(points @ turn.T + shift)
        noise = NOISE * generator.normal(size=seen.shape)
        rows.append(np.column_stack([np.full(len(points), float(photo)), points, seen + noise]))
    return dict(zip(("photo", "x", "y", "z", "u", "v"), np.vstack(rows).T, strict=True))


TEXT = """(problem p (data d external) (camera cam {camera})
  (unknowns {numbers} (T (pose 3) :per d.photo))
  (observe d (= [u v] (project cam (transform (T photo) [x y z]))) :sigma 0.2))"""

FREE, BOTH = ":focal (fx fy) :center (cx cy)", "(fx) (fy) (cx) (cy)"


def calibrated(camera: str, numbers: str, data: dict, expected: dict[str, float], status: str = "converged") -> None:
    """The numbers lie within 5 standard deviations of the truth, and χ² is as of such noise."""
    solved = mbm.loads(TEXT.format(camera=camera, numbers=numbers)).solve(data={"d": data})
    assert solved.first.status == status
    freedom = solved.first.dof
    assert abs(solved.first.cost - freedom) < 5 * np.sqrt(2 * freedom)
    for name, value in expected.items():
        assert abs(float(solved[name].value) - value) < 5 * float(solved[name].sigma), name


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("camera", "numbers", "focal"),
    [
        (FREE, BOTH, (300.0, 305.0)),
        (FREE, BOTH, (300.0, -305.0)),
        (":focal (fx (- fy)) :center (cx cy)", BOTH, (300.0, -305.0)),
        (FREE, "(fx :in (-1000 -10)) (fy) (cx) (cy)", (-300.0, 305.0)),
        (FREE + " :distortion (k1 k2)", BOTH + "(k1) (k2)", (300.0, 305.0)),
        (":focal f :center (320 240)", "(f)", (302.0, 302.0)),
    ],
)
def test_a_fisheye_is_calibrated_from_points_of_space(camera, numbers, focal, seed):
    """Also mirrored ones: one focal length is negative, whether or not that is said."""
    lens = (0.05, -0.01) if "k1" in numbers else ()
    data = views(cloud(30, seed), lambda places: fisheye(places, focal, lens), 0.25, seed)
    signs = (1.0, -1.0) if "(- fy)" in camera else (1.0, 1.0)
    expected = {"f": focal[0]} if "(f)" in numbers else {"fx": focal[0] * signs[0], "fy": focal[1] * signs[1]}
    calibrated(f":model fisheye {camera}", numbers, data, expected)


@pytest.mark.parametrize("focal", [(300.0, -305.0), (-300.0, 305.0)])
def test_a_mirrored_fisheye_before_boards(focal):
    data = views(plate(0.0, 0), lambda places: fisheye(places, focal), 0.2, 3)
    signs = ["(- fx)" if focal[0] < 0 else "fx", "(- fy)" if focal[1] < 0 else "fy"]
    camera = f":model fisheye :focal ({' '.join(signs)}) :center (cx cy)"
    calibrated(camera, BOTH, data, {"fx": 300.0, "fy": 305.0, "cx": 320.0, "cy": 240.0})


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
@pytest.mark.parametrize("depth", [0.003, 0.01, 0.029, 0.035])
def test_nearly_plane_boards_that_were_measured(model, depth):
    """Neither plane nor of space enough for either closed form by itself."""
    image, focal = (pinhole, (800.0, 810.0)) if model == "pinhole" else (fisheye, (300.0, 305.0))
    data = views(plate(depth, 1), lambda places: image(places, focal), 0.4 if model == "pinhole" else 0.2, 2)
    calibrated(f":model {model} {FREE}", BOTH, data, {"fx": focal[0], "fy": focal[1]})


def test_a_mirrored_pinhole_sees_points_of_space_before_it():
    data = views(cloud(20, 1), lambda places: pinhole(places, (800.0, -810.0)), 0.6, 1)
    calibrated(FREE, BOTH, data, {"fx": 800.0, "fy": -810.0})


@pytest.mark.parametrize(
    ("points", "focal", "numbers", "count"),
    [
        ("space", "3000", "", 2),
        ("plane", "3000", "", 2),
        ("space", "f", "(f)", 2),
        ("plane", "f", "(f)", 1),
        ("nearly", "f", "(f)", 3),
        ("space", "(fx fy)", "(fx) (fy)", 1),
        ("plane", "(fx fy)", "(fx) (fy)", 4),
    ],
)
def test_cameras_that_do_not_divide_by_the_depth(points, focal, numbers, count):
    """All but the depth of a pose is found: of that nothing tells, and the status says so."""
    true = (3000.0, 3300.0) if "fx" in focal else (3000.0, 3000.0)
    body = {"space": cloud(20, 2), "plane": plate(0.0, 2), "nearly": plate(0.01, 2)}[points]
    data = views(body, lambda places: parallel(places, true), 1.0, 4, count)
    expected = {"fx": true[0], "fy": true[1]} if "fx" in focal else {"f": true[0]} if numbers else {}
    calibrated(f":model orthographic :focal {focal} :center (320 240)", numbers, data, expected, "unobservable")


@pytest.mark.parametrize(
    ("camera", "numbers", "lens", "expected"),
    [
        (FREE + " :distortion (-0.2 0.05)", BOTH, (-0.2, 0.05), {"fx": 800.0, "fy": 816.0, "cx": 320.0}),
        (":focal (800 816) :center (cx cy)", "(cx) (cy)", (), {"cx": 320.0, "cy": 240.0}),
        (":focal (800 816) :center (320 240) :distortion (k1)", "(k1)", (-0.2,), {"k1": -0.2}),
        (":focal (f (* 1.02 f)) :center (cx (- cy))", "(f) (cx) (cy)", (), {"f": 800.0, "cx": 320.0, "cy": -240.0}),
    ],
)
def test_pinholes_of_which_some_numbers_are_known(camera, numbers, lens, expected):
    data = views(plate(0.0, 1), lambda places: pinhole(places, (800.0, 816.0), lens), 0.5, 5)
    calibrated(camera, numbers, data, expected)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [4, 5])
def test_few_points_of_space_tell_a_focal_length(count, seed):
    """Four have eight coordinates for seven unknowns: χ² is small, and the focal length is that of OpenCV's images."""
    points = np.array(
        [[0.1, 0.0, 0.0], [-0.1, 0.05, 0.02], [0.0, -0.1, 0.05], [0.02, 0.08, -0.09], [-0.05, -0.02, -0.08]]
    )
    data = views(points[:count], lambda places: pinhole(places, (900.0, 900.0)), 0.5, seed, 3)
    solved = mbm.loads(TEXT.format(camera=":focal f :center (320 240)", numbers="(f)")).solve(data={"d": data})
    assert solved.first.cost < solved.first.dof + 5 * np.sqrt(2 * solved.first.dof)
    assert abs(float(solved["f"].value) - 900.0) < 5 * float(solved["f"].sigma)
