"""Photographs of unknown points by cameras of unknown focal length, by an independent simulator: no starts."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm

Floats = np.ndarray
CENTRE, NOISE = np.array([640.0, 360.0]), 0.5
SEEDS = [(kind, 0) for kind in ("one", "two", "centre", "distortion", "opengl")]
SEEDS += [pytest.param("one", seed, marks=pytest.mark.slow) for seed in range(1, 12)]


def scene(generator: np.random.Generator, photos: int, count: int) -> tuple[Floats, list[tuple[Floats, Floats]]]:
    """Points before the first photograph, whose frame is that of all; the others are to the right and turned back."""
    points = generator.uniform(-1.0, 1.0, (count, 3)) * [1.5, 1.2, 1.2] + [0.0, 0.0, 6.0]
    poses = [(np.eye(3), np.zeros(3))]
    for k in range(1, photos):
        turned = [0.05 * k, 0.2 * k, 0.0] + generator.uniform(-1.0, 1.0, 3) * [0.1, 0.1, 0.2]
        R = Rotation.from_rotvec(turned).as_matrix()
        aside = np.array([1.3 * k, -0.2 * k, 0.3])
        poses.append((R, -R @ (aside + generator.uniform(-0.3, 0.3, 3))))
    return points, poses


def image(generator: np.random.Generator, points: Floats, pose: tuple[Floats, Floats], focal: Floats) -> Floats:
    moved = points @ pose[0].T + pose[1]
    assert (moved[:, 2] > 0).all()
    exact = focal * moved[:, :2] / moved[:, 2:] + CENTRE
    return exact + NOISE * generator.standard_normal(exact.shape)


def table(photos: list[int], images: list[Floats]) -> dict[str, Floats]:
    """Every point in every photograph."""
    every, count = np.concatenate(images), len(images[0])
    return {
        "photo": np.repeat(np.array(photos, dtype=float), count),
        "point": np.tile(np.arange(float(count)), len(images)),
        "u": every[:, 0],
        "v": every[:, 1],
    }


BUNDLE = """(problem bundle (data photos external :key photo) (data points external :key point) (data d external)
  {camera}
  (unknowns {unknown} (T (pose 3) :per photos :fixed (= photo 0) :at (pose3)) (X (vector 3) :per points))
  (observe d (= [u v] (project {name} (transform (T photo) (X point)))) :sigma 0.5)
  (observe scale (= {apart} (distance (X 0) (X 1))) :sigma 0.001))"""

CAMERAS = {
    "one": ("(camera cam :focal (f f) :center (640 360))", "(f)", "cam"),
    "two": ("(camera cam :focal (f g) :center (640 360))", "(f) (g)", "cam"),
    "centre": ("(camera cam :focal (f f) :center (cx cy))", "(f) (cx) (cy)", "cam"),
    "distortion": ("(camera cam :focal f :center (640 360) :distortion (k 0 0 0 0))", "(f) (k)", "cam"),
    "opengl": ("(camera cam :focal f :center (640 360) :axes opengl)", "(f)", "cam"),
}
LEAVES = 5.0
"""Standard deviations of a chi² within which it counts as that of the noise."""


def fits(solve: mbm.Solve) -> bool:
    return solve.cost is not None and solve.cost < solve.dof + LEAVES * np.sqrt(2 * solve.dof)


@pytest.mark.parametrize(("kind", "seed"), SEEDS)
def test_the_focal_length_of_photographs_of_unknown_points(kind: str, seed: int) -> None:
    generator = np.random.default_rng(seed)
    points, poses = scene(generator, 4, 16)
    images = [image(generator, points, pose, np.array([800.0, 820.0 if kind == "two" else 800.0])) for pose in poses]
    camera, unknown, name = CAMERAS[kind]
    apart = np.linalg.norm(points[0] - points[1])
    text = BUNDLE.format(camera=camera, unknown=unknown, name=name, apart=apart)
    if kind == "opengl":  # x right, y up, z backwards, and v upwards: what is seen is a picture of the scene turned
        images = [each * [1, -1] + [0, 2 * CENTRE[1]] for each in images]
    tables = {"photos": {"photo": np.arange(4.0)}, "points": {"point": np.arange(16.0)}}
    found = mbm.loads(text).solve(data={**tables, "d": table([0, 1, 2, 3], images)})
    assert found.first.status == "converged"
    assert fits(found.first)
    sigma = float(found["f"].sigma)
    assert abs(float(found["f"].value) - 800.0) < 4 * sigma < 200.0


@pytest.mark.parametrize("seed", [0, 1])
def test_two_cameras_of_a_rig_of_unknown_points_and_focal_lengths(seed: int) -> None:
    """A rig without starts: both focal lengths, the rig, its poses, the points; the baseline gives the scale."""
    generator = np.random.default_rng(seed)
    points, poses = scene(generator, 3, 16)
    R, t = Rotation.from_rotvec([0.02, -0.15, 0.03]).as_matrix(), np.array([-0.5, 0.03, 0.05])
    left = [image(generator, points, pose, np.array([800.0, 800.0])) for pose in poses]
    right = [image(generator, points, (R @ q, R @ s + t), np.array([900.0, 900.0])) for q, s in poses]
    text = """(problem rig (data photos external :key photo) (data points external :key point)
      (data a external) (data b external)
      (camera one :focal f :center (640 360)) (camera other :focal g :center (640 360))
      (unknowns (f) (g) (B (pose 3)) (T (pose 3) :per photos :fixed (= photo 0) :at (pose3))
        (X (vector 3) :per points))
      (observe a (= [u v] (project one (transform (T photo) (X point)))) :sigma 0.5)
      (observe b (= [u v] (project other (transform (compose B (T photo)) (X point)))) :sigma 0.5)
      (observe base (= {base} (norm (translation B))) :sigma 0.001))"""
    tables = {"photos": {"photo": np.arange(3.0)}, "points": {"point": np.arange(16.0)}}
    tables |= {"a": table([0, 1, 2], left), "b": table([0, 1, 2], right)}
    found = mbm.loads(text.format(base=np.linalg.norm(t))).solve(data=tables)
    assert found.first.status == "converged"
    assert fits(found.first)
    for name, true in (("f", 800.0), ("g", 900.0)):
        assert abs(float(found[name].value) - true) < 4 * float(found[name].sigma) < 200.0


@pytest.mark.parametrize("seed", [0, 1])
def test_points_that_one_photograph_alone_sees_are_named_and_stop_nothing(seed: int) -> None:
    """Of points 3 and 7 one row each is left: their distance is free, all else as it is."""
    generator = np.random.default_rng(seed)
    points, poses = scene(generator, 3, 16)
    d = table([0, 1, 2], [image(generator, points, pose, np.array([800.0, 800.0])) for pose in poses])
    kept = ~np.isin(d["point"], [3.0, 7.0]) | (d["photo"] == 2.0)
    apart = np.linalg.norm(points[0] - points[1])
    text = BUNDLE.format(camera="(camera cam :focal f :center (640 360))", unknown="(f)", name="cam", apart=apart)
    tables = {"photos": {"photo": np.arange(3.0)}, "points": {"point": np.arange(16.0)}}
    found = mbm.loads(text).solve(data={**tables, "d": {name: column[kept] for name, column in d.items()}})
    assert found.first.status == "unobservable"
    assert fits(found.first)
    (solve,) = found.document()["solves"]
    named = json.dumps(solve["observability"]["unobservable"])
    assert {k for k in range(16) if f"X[{k}]" in named} == {3, 7}
    assert abs(float(found["f"].value) - 800.0) < 4 * float(found["f"].sigma)
