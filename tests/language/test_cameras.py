"""Camera models against their formulas written out with NumPy, and families of cameras against single ones."""

import numpy as np
import pytest

import mbm

POINTS = np.array([[0.3, -0.2, 2.0], [1e-9, 2e-9, 3.0], [-1.5, 0.7, 0.4], [0.0, 0.0, 1.0], [0.9, 0.1, -0.2]])
ROUNDING = 1e-11
"""Pixels of size 1,000 with 16 digits, some operations."""


def images(camera, points):
    """Images [u v] of points by `project`: residuals of equations that measure zeros."""
    rows = " ".join("(" + " ".join(f"{v:.17g}" for v in p) + ")" for p in points)
    text = f"""(problem p (data pts (table (x y z) {rows})) {camera} (unknowns (d :init 0))
      (observe pts (= [0 0] (+ (project cam [x y z]) [d d])) :sigma 1))"""
    return mbm.loads(text).compile().residuals([0.0]).reshape(-1, 2)


def fisheye(points, focal, center, k):
    x, y, z = points.T
    r = np.hypot(x, y)
    theta = np.arctan2(r, z)
    bent = theta * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
    scale = np.where(r > 0, bent / np.where(r > 0, r, 1), 1 / z)
    return np.column_stack([focal[0] * scale * x + center[0], focal[1] * scale * y + center[1]])


def test_fisheye_bends_the_angle_from_the_axis():
    k = (0.05, -0.01, 0.002, -0.0003)
    camera = "(camera cam :model fisheye :focal (500 510) :center (320 240) :distortion (0.05 -0.01 0.002 -0.0003))"
    np.testing.assert_allclose(
        images(camera, POINTS), fisheye(POINTS, (500, 510), (320, 240), k), rtol=1e-13, atol=ROUNDING
    )
    plain = "(camera cam :model fisheye :focal 500)"
    wanted = fisheye(POINTS, (500, 500), (0, 0), (0, 0, 0, 0))
    np.testing.assert_allclose(images(plain, POINTS), wanted, rtol=1e-13, atol=ROUNDING)


@pytest.mark.parametrize("model", ["weak-perspective", "orthographic"])
def test_parallel_projections_do_not_divide_by_depth(model):
    camera = f"(camera cam :model {model} :focal (200 300) :center (10 20))"
    wanted = POINTS[:, :2] * [200, 300] + [10, 20]
    np.testing.assert_allclose(images(camera, POINTS), wanted, rtol=1e-14, atol=ROUNDING)
    paper = f"(camera cam :model {model} :axes paper)"
    np.testing.assert_allclose(images(paper, POINTS), POINTS[:, 1:], rtol=1e-14, atol=ROUNDING)


FAMILY = """
(problem two
  (data cams (table (id f cx) ("left" 500 320) ("right" 600 300)) :key id)
  (data seen (table (camera x y u v) ("left" 0.1 0.2 0 0) ("right" 0.1 0.2 0 0) ("right" -0.3 0.1 0 0)))
  (camera cam :per cams :focal (f f) :center (cx (cy id)))
  (unknowns (cy :per cams :init 240))
  (observe seen (= [u v] (project (cam camera) [x y 1])) :sigma 1)
  (observe one (= [0 0] (project (cam "right") [0.5 0.5 1])) :sigma 1))
"""


def test_members_of_a_family_take_their_numbers_from_their_rows():
    found = mbm.loads(FAMILY).compile().residuals(np.zeros(2)).reshape(-1, 2)
    wanted = [[370, 340], [360, 360], [120, 300], [600, 540]]
    np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_families_of_cameras_solve_with_their_unknowns():
    result = mbm.loads(FAMILY).solve()
    np.testing.assert_allclose(result["cy"].value, [-100, -(120 + 60 + 300) / 3], rtol=1e-9)


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        ("(camera cam :model orthographic :distortion (0.1))", "no distortion"),
        ("(camera cam :model fisheye :distortion (1 2 3 4 5))", "5 coefficients"),
        ("(camera cam :model fishy)", "fisheye"),
    ],
)
def test_wrong_cameras_are_refused(camera, says):
    with pytest.raises(mbm.MbmError) as caught:
        images(camera, POINTS)
    diagnostic = caught.value.diagnostics[0]
    assert says in f"{diagnostic.message} {diagnostic.hint}"


@pytest.mark.parametrize(
    ("clause", "code", "place", "mend"),
    [
        ("(camera cam :focal 0)", "bad-form", "0", "leave `:focal` out"),
        ("(camera cam :focal (500 0))", "bad-form", "(500 0)", "leave `:focal` out"),
        ("(camera cam :focal (1 2 3))", "length-clash", "(1 2 3)", "`:focal` takes two numbers, or one for both axes"),
        ('(camera cam :center "middle")', "wrong-kind", '"middle"', "`:center` takes two numbers"),
        ("(camera cam :distortion 0.1)", "wrong-kind", "0.1", "(k1 k2 p1 p2 k3)"),
        ("(camera cam :distortion (1 2 3 4 5 6))", "length-clash", "(1 2 3 4 5 6)", "(k1 k2 p1 p2 k3)"),
        ("(camera cam :near -1m)", "bad-form", "-1m", "`:near 1mm`"),
        ("(camera cam :near 0)", "bad-form", "0", "`:near 1mm`"),
        ("(camera cam :near 1kg)", "bad-form", "1kg", "`:near 1mm`"),
        ("(camera cam :foca 500)", "bad-form", ":foca", "`:focal`"),
        ("(camera cam :focal)", "bad-form", ":focal", "write the value after it"),
        ("(camera cam :focal 500 :focal 500)", "duplicate-definition", ":focal", None),
        ("(camera cam :model Pinhole)", "bad-form", "Pinhole", ":model pinhole"),
        ("(camera cam :axes (x y z))", "bad-form", "(x y z)", ":axes opencv"),
        ("(camera :focal 500)", "bad-form", ":focal", "usage: (camera name"),
        ("(camera)", "bad-form", "(camera)", "usage: (camera name"),
        ("(camera cam 500)", "bad-form", "500", "usage: (camera name"),
        ('(camera "cam" :focal 500)', "bad-form", '"cam"', "usage: (camera name"),
        ("(camera cam :per nowhere)", "unknown-table", "nowhere", "pts"),
        ("(camera cam :per pts)", "table-without-key", "pts", ":key"),
    ],
)
def test_a_mistake_in_a_camera_is_one_error_with_its_mend(clause, code, place, mend):
    """Not another one wherever the camera is used."""
    with pytest.raises(mbm.MbmError) as caught:
        images(clause, POINTS)
    (diagnostic,) = caught.value.diagnostics
    assert (diagnostic.code.name, diagnostic.place.text) == (code, place)
    assert mend is None or mend in diagnostic.hint


def test_a_key_without_a_row_is_named():
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(FAMILY.replace('("right" -0.3', '("rihgt" -0.3')).solve()
    assert any(d.code.name == "dangling-key" for d in caught.value.diagnostics)
