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
