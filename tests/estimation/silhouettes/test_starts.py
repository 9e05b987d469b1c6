"""Poses and sizes from contour points without a start, against the scenes that the points were made from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.search import starting
from mbm.estimation.starts import projection, random_starts
from mbm.estimation.starts.silhouettes.hulls import corners_between

pytest.importorskip("shapely")

SIDES = np.array([0.12, 0.08, 0.05])
CORNERS = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * SIDES / 2
HALF_TURNS = [np.diag(d) for d in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
"""A box looks the same after them."""

CAMERA = "(camera cam :focal (900 910) :center (320 240))"
BOX = "(contour-distance (silhouette cam (transform {} (box 12cm 8cm 5cm))) [u v])"
PLACE = np.array([0.05, -0.03, 0.7])
"""Where the tests' objects stand before the camera."""


def outline(points: np.ndarray, count: int = 100) -> np.ndarray:
    """Equally spaced points (count, 2) on the convex hull of the images of points before the camera, by SciPy."""
    images = points[:, :2] / points[:, 2:] * [900, 910] + [320, 240]
    corners = images[ConvexHull(images).vertices]
    ring = np.concatenate([corners, corners[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    at = np.linspace(0, length[-1], count, endpoint=False)
    return np.stack([np.interp(at, length, ring[:, k]) for k in range(2)], axis=1)


def columns(points: np.ndarray, **others: object) -> dict[str, object]:
    return {"u": points[:, 0], "v": points[:, 1], **others}


def rotation(found: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(np.roll(found[:4], -1)).as_matrix()


def apart(R: np.ndarray, S: np.ndarray) -> float:
    """The angle in rad between orientations of a box."""
    return min(float(np.linalg.norm(Rotation.from_matrix(R.T @ S @ T).as_rotvec())) for T in HALF_TURNS)


def random_rotation(seed: int) -> np.ndarray:
    return Rotation.random(random_state=np.random.default_rng(seed)).as_matrix()


def test_corners_that_were_left_out_of_a_contour_belong_to_its_hull():
    """Points stand on a square but for 6 px about its corners; those of a circle have no corner between them."""
    side = np.arange(-44.0, 45.0, 4.0)
    edge = np.full_like(side, 50.0)
    square = np.concatenate(
        [np.stack(each, 1) for each in ((side, -edge), (edge, side), (-side, edge), (-edge, -side))]
    )
    corners = corners_between(square)
    np.testing.assert_allclose(sorted(map(tuple, corners)), [(-50, -50), (-50, 50), (50, -50), (50, 50)], atol=1e-9)
    turn = np.linspace(0, 2 * np.pi, 80, endpoint=False)
    circle = 50 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    assert len(corners_between(circle)) == 0
    shuffled = np.random.default_rng(0).permutation(square)
    assert len(corners_between(shuffled)) == 0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_box_in_any_pose_whatever_the_order_of_the_points(seed):
    R = random_rotation(seed)
    points = np.random.default_rng(seed).permutation(outline(CORNERS @ R.T + PLACE))
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA} (unknowns (T (pose 3)))
      (observe d {BOX.format("T")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(points)})
    assert found.status == "ok"
    assert found.first.cost < 1e-6  # the points lie on the outline but for rounding
    assert apart(rotation(found["T"].value), R) < 1e-5
    np.testing.assert_allclose(found["T"].value[4:], PLACE, atol=1e-6)
    alike = [each for each in found.first.alternatives if each.cost < 1e-6]
    assert len(alike) == 3, "the half turns are other solutions"


def test_a_position_within_a_range():
    """What was drawn is moved to where the contour is."""
    R = random_rotation(11)
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA}
      (unknowns (T (pose 3) :start ([-0.2 -0.2 0.4] [0.2 0.2 1.0])))
      (observe d {BOX.format("T")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(outline(CORNERS @ R.T + PLACE))})
    assert found.first.cost < 1e-6
    assert apart(rotation(found["T"].value), R) < 1e-5


def test_a_camera_before_a_box():
    """The pose of the eye is that of the box the other way round; without a unit, as a table would have it."""
    R = random_rotation(4)
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA} (unknowns (E (pose 3)))
      (observe d {BOX.format("(inverse E)")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(outline(CORNERS @ R.T + PLACE))})
    assert found.first.cost < 1e-6
    assert apart(rotation(found["E"].value).T, R) < 1e-5


def test_sides_within_ranges():
    """Which side is which is told by the ranges: all sides in proportion would fit as well, the known one another."""
    R = random_rotation(5)
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA}
      (unknowns (T (pose 3)) (a :start (9cm 15cm)) (b :start (6cm 10cm)))
      (observe d {BOX.format("T").replace("12cm 8cm", "a b")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(outline(CORNERS @ R.T + PLACE))})
    assert found.first.cost < 1e-6
    np.testing.assert_allclose([found["a"].value, found["b"].value], SIDES[:2], rtol=1e-5)
    assert apart(rotation(found["T"].value), R) < 1e-5


def test_two_angles_of_a_can_and_its_radius():
    """What turns nothing is no unknown; the can that stands on its head is another solution."""
    turn = 2 * np.pi * np.arange(2000) / 2000
    ring = 0.03 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    can = np.concatenate([np.column_stack([ring, np.full(2000, z)]) for z in (0, 0.1)])
    R = Rotation.from_euler("xyz", [1.2, 0.3, 0]).as_matrix()
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA}
      (unknowns (g angle) (h angle) (p (vector 3)) (r :start (1cm 6cm)))
      (observe d (contour-distance (silhouette cam (trans p (rotate (g h 0) (cylinder r 10cm)))) [u v]) :sigma 0.1))""")
    found = problem.solve(data={"d": columns(outline(can @ R.T + PLACE))})
    # 2,000 chords leave out 1e-6 of the radius, or 4e-5 px
    assert abs(found["r"].value - 0.03) < 1e-6
    solutions = [(found["g"].value, found["h"].value)]
    for other in found.first.alternatives:
        values = {each.name: each.value for each in other.estimates}
        solutions += [(float(values["g"]), float(values["h"]))] if other.cost < 1 else []
    axes = [Rotation.from_euler("xyz", [g, h, 0]).as_matrix()[:, 2] for g, h in solutions]
    assert max(axis @ R[:, 2] for axis in axes) > 1 - 1e-9
    assert min(axis @ R[:, 2] for axis in axes) < -0.9


def test_a_pose_for_each_photograph():
    """Three photographs in one table, of which each has a pose of its own."""
    turns = [random_rotation(seed) for seed in (6, 7, 8)]
    points = [outline(CORNERS @ R.T + PLACE + np.array([0, 0, 0.05 * k]), 60) for k, R in enumerate(turns)]
    data = columns(np.concatenate(points), photo=np.repeat(["a", "b", "c"], 60))
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA}
      (unknowns (T (pose 3) :per d.photo))
      (observe d {BOX.format("(T photo)")} :sigma 0.1))""")
    found = problem.solve(data={"d": data})
    assert found.first.cost < 1e-6
    for k, R in enumerate(turns):
        value = found["T"].value[k]
        assert apart(rotation(value), R) < 1e-5
        np.testing.assert_allclose(value[4:], PLACE + np.array([0, 0, 0.05 * k]), atol=1e-6)


@pytest.mark.parametrize("camera", [":axes paper :focal (900 910)", ":focal (900 910) :distortion (-0.1 0.05)"])
def test_other_cameras(camera):
    """The paper's axes, and a lens that bends edges: points by the formulas of the manuals along all edges."""
    R = random_rotation(9)
    share = np.linspace(0, 1, 400)[:, None]
    edges = [(a, b) for a in CORNERS for b in CORNERS if np.count_nonzero(a != b) == 1]
    x, y, z = (np.concatenate([a + share * (b - a) for a, b in edges]) @ R.T + PLACE).T
    x, y = x / z, y / z
    if "distortion" in camera:
        r2 = x * x + y * y
        x, y = (each * (1 - 0.1 * r2 + 0.05 * r2 * r2) for each in (x, y))
    images = np.stack([900 * x, 910 * y], axis=1)
    hull = images[ConvexHull(images).vertices]
    problem = mbm.loads(f"""(problem p (data d external) (camera cam {camera}) (unknowns (T (pose 3)))
      (observe d {BOX.format("T")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(hull if len(hull) > 50 else outline_of(hull))})
    place, R_found = found["T"].value[4:], rotation(found["T"].value)
    if "paper" in camera:  # x ahead, u along y, v along z
        place, R_found = np.roll(place, -1), np.roll(R_found, -1, axis=0)
    assert found.first.cost < 0.1  # concave edges of a bent box are not on its hull: by 1e-3 px here
    assert apart(R_found, R) < 1e-3
    np.testing.assert_allclose(place, PLACE, atol=1e-3)


def outline_of(corners: np.ndarray) -> np.ndarray:
    """Points along a convex polygon."""
    after = np.roll(corners, -1, axis=0)
    return np.concatenate([corners + s * (after - corners) for s in np.linspace(0.05, 0.95, 12)])


@pytest.mark.slow
def test_what_has_no_pose_is_not_trusted():
    """Points of a star, which is no box: whatever is found does not fit, and is said not to."""
    turn = 2 * np.pi * np.arange(100) / 100
    points = (100 + 40 * np.cos(5 * turn))[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1) + [320, 240]
    problem = mbm.loads(f"""(problem p (data d external) {CAMERA} (unknowns (T (pose 3)))
      (observe d {BOX.format("T")} :sigma 0.1))""")
    found = problem.solve(data={"d": columns(points)})
    assert found.first.cost > 1e4


@pytest.mark.slow
def test_a_sphere_is_looked_for_with_few_outlines(monkeypatch):
    """Each takes ten milliseconds: no scan of thousands, but the starts that any problem has."""
    asked = []

    def costs(equations, points):
        asked.append(len(points))
        return original(equations, points)

    original = random_starts.costs
    for module in (starting, projection):
        monkeypatch.setattr(module, "costs", costs)
    turns = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    radius = 0.03 / np.sqrt(0.7**2 - 0.03**2)  # the tangent of the cone of a sphere straight ahead
    points = radius * np.stack([900 * np.cos(turns), 910 * np.sin(turns)], axis=1) + [320, 240]
    text = f"""(problem p (data d external) {CAMERA} (unknowns (c (vector 3)))
      (observe d (contour-distance (silhouette cam (trans c (sphere 3cm))) [u v]) :sigma 0.1))"""
    solve = mbm.loads(text).solve(data={"d": columns(points)}, starts=2).first
    assert sum(asked) < 200
    np.testing.assert_allclose(solve["c"].value, [0.0, 0.0, 0.7], atol=1e-4)
