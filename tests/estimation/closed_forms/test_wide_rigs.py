"""Two fisheyes of 60° and more about a board that is held near: what a start that leads astray ends with."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.closed_forms.rigs import Camera, held, photographed, turn

TEXT = """
(problem rig
  (data photos external :key photo) (data left external) (data right external)
  (camera a :model fisheye :focal (fa ga) :center (320 240))
  (camera b :model fisheye :focal (fb gb) :center (320 240))
  (unknowns (fa :init 300) (ga :init 300) (fb :init 300) (gb :init 300)
    (T (pose 3) :per photos :init (pose3 (euler 0 0 0) [-0.1 -0.07 0.25]))
    (B (pose 3) :init (pose3 (euler 0 0 0) [0 0 0])))
  (observe l left (= [u v] (project a (transform (T photo) [x y z]))) :sigma 0.3)
  (observe r right (= [u v] (project b (transform (compose B (T photo)) [x y z]))) :sigma 0.3))"""

PHOTOS = 8


def data(seed):
    generator = np.random.default_rng(seed)
    rig = [(np.eye(3), np.zeros(3)), (turn([0.02, -0.1, 0.01]), np.array([-0.1, 0, 0.01]))]
    boards = held(generator, PHOTOS, tilt=0.8, far=0.25)
    cameras = [Camera(focal=(150.0, 151.5), fisheye=True)] * 2
    tables = photographed(cameras, rig, boards, [range(PHOTOS)] * 2, 0.3, generator)
    left, right = (table.columns() for table in tables)
    return {"photos": {"photo": np.arange(float(PHOTOS))}, "left": left, "right": right}


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_a_rough_start_is_enough(seed):
    """By itself the search of seed 7 ends with boards turned round, and focal lengths of 500 px."""
    found = mbm.loads(TEXT).solve(data=data(seed))
    for name, focal in (("fa", 150.0), ("ga", 151.5), ("fb", 150.0), ("gb", 151.5)):
        assert abs(found[name].value - focal) < 4 * found[name].sigma
    assert found.first.chi2_p > 1e-4


WAVE = """
(problem wave (data d external) (unknowns (w :init 2 :start (0.5 5)))
  (observe d (= y (sin (* w t))) :sigma 0.05))"""


def wave():
    t = np.linspace(0, 10, 60)
    return {"d": {"t": t, "y": np.sin(3.7 * t) + np.random.default_rng(2).normal(0, 0.05, 60)}}


def test_another_minimum_is_doubted_and_the_way_out_is_named():
    found = mbm.loads(WAVE).solve(data=wave())
    (diagnostic,) = (d for d in found.first.diagnostics if d.code.name == "noise-against-data")
    assert "`--starts 20` looks for a better minimum" in diagnostic.hint
    better = mbm.loads(WAVE).solve(data=wave(), starts=20, seed=1)
    assert abs(better["w"].value - 3.7) < 4 * better["w"].sigma


BESIDE = """
(problem beside
  (data photos external :key photo) (data left external) (data right external)
  (camera a :focal (fa ga) :center (ca da))
  (camera b :model fisheye :focal (fb gb) :center (cb db) :distortion (k1 k2 k3 k4))
  (unknowns (fa) (ga) (ca) (da) (fb) (gb) (cb) (db) (k1) (k2) (k3) (k4) (T (pose 3) :per photos) (B (pose 3)))
  (observe l left (= [u v] (project a (transform (T photo) [x y z]))) :sigma 0.3)
  (observe r right (= [u v] (project b (transform (compose B (T photo)) [x y z]))) :sigma 0.3))"""

ALONE = """
(problem alone
  (data photos external :key photo) (data right external)
  (camera b :model fisheye :focal {focal} :center {center})
  (unknowns {numbers} (T (pose 3) :per photos))
  (observe right (= [u v] (project b (transform (T photo) [x y z]))) :sigma 0.3))"""


def stereo(seed, noise, focal=(250.0, 251.5)):
    """A pinhole camera of 800 px and a fisheye of 250 px that see a board up to 60° off."""
    generator = np.random.default_rng(seed)
    rig = [(np.eye(3), np.zeros(3)), (turn([0.02, -0.1, 0.01]), np.array([-0.1, 0, 0.01]))]
    cameras = [Camera(), Camera(focal=focal, centre=(330.0, 235.0), fisheye=True)]
    boards = held(generator, PHOTOS, tilt=0.6, far=0.25)
    left, right = photographed(cameras, rig, boards, [range(PHOTOS)] * 2, noise, generator)
    return {"photos": {"photo": np.arange(float(PHOTOS))}, "left": left.columns(), "right": right.columns()}


@pytest.mark.parametrize(("seed", "axes"), [(0, "opencv"), (1, "opencv"), (1, "opengl")])
def test_a_fisheye_beside_a_pinhole_wants_no_start(seed, axes):
    """Also where it looks along −z, with the image upwards."""
    data, down = stereo(seed, 0.3), 1.0 if axes == "opencv" else -1.0
    data["right"]["v"] = down * data["right"]["v"]
    found = mbm.loads(BESIDE.replace("fisheye", f"fisheye :axes {axes}")).solve(data=data)
    true = (("fa", 800.0), ("ga", 810.0), ("fb", 250.0), ("gb", 251.5), ("cb", 330.0), ("db", down * 235.0))
    for name, value in true:
        assert abs(found[name].value - value) < 4 * found[name].sigma
    assert found.first.chi2_p > 1e-4


@pytest.mark.parametrize(
    ("focal", "center", "numbers"),
    [
        ("(fb gb)", "(cb db)", "(fb) (gb) (cb) (db)"),
        ("(fb fb)", "(330 235)", "(fb)"),
        ("(fb gb)", "(cb db)", "(fb :in (-2000 -50)) (gb :in (-2000 -50)) (cb) (db)"),
    ],
)
def test_a_fisheye_alone_is_calibrated(focal, center, numbers):
    """Without noise the truth comes back, but for what the stopping rule leaves."""
    data = stereo(3, 0.0, (250.0, 250.0) if focal == "(fb fb)" else (250.0, 251.5))
    del data["left"]
    found = mbm.loads(ALONE.format(focal=focal, center=center, numbers=numbers)).solve(data=data)
    sign = -1.0 if ":in" in numbers else 1.0  # seen through it all is turned about the axis
    assert abs(found["fb"].value - sign * 250.0) < 1e-4
    assert found.first.cost < 1e-6
