"""Photographs of points of unknown places, by an independent simulator: no starts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.starts.closed_forms.numerics.structure import View, structures

Floats = np.ndarray
FOCAL, CENTRE = 800.0, np.array([640.0, 360.0])
EXACT = 1e-6
"""Without noise the truth comes back, but for what the stopping rule leaves."""


def scene(count: int, *, plane: bool, seed: int = 0) -> Floats:
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3)) * [1.5, 1.2, 0.8]
    if plane:
        points[:, 2] = 0.4 * points[:, 0] - 0.2 * points[:, 1]
    return points + np.array([0.0, 0.0, 6.0])


def photographs(count: int) -> list[tuple[Floats, Floats]]:
    """The first is the frame of all; the others are to the right of it and turned back."""
    found = [(np.eye(3), np.zeros(3))]
    for k in range(1, count):
        R = Rotation.from_rotvec([0.05 * k, 0.22 * k, 0.1 * (-1) ** k]).as_matrix()
        found.append((R, -R @ [1.3 * k, -0.2 * k, 0.3]))
    return found


def seen(points: Floats, R: Floats, t: Floats) -> Floats:
    moved = points @ R.T + t
    assert (moved[:, 2] > 0).all()
    return FOCAL * moved[:, :2] / moved[:, 2:] + CENTRE


def pixels(points: Floats, poses: list[tuple[Floats, Floats]], noise: float = 0.0) -> dict[str, Floats]:
    """Every point in every photograph."""
    generator, count = np.random.default_rng(1), len(points)
    every = np.concatenate([seen(points, R, t) for R, t in poses])
    every += noise * generator.standard_normal(every.shape)
    return {
        "photo": np.repeat(np.arange(float(len(poses))), count),
        "point": np.tile(np.arange(float(count)), len(poses)),
        "u": every[:, 0],
        "v": every[:, 1],
    }


def solve(text: str, **data: Floats | dict[str, Floats]) -> mbm.Solved:
    return mbm.loads(text).solve(data=data)


def numbers(solved: mbm.Solved, name: str, count: int) -> Floats:
    found = np.asarray(solved[name].value)
    assert found.shape[0] == count
    return found


PAIR = """(problem pair (data points external :key point) (data left external) (data right external)
  (camera cam :focal (800 800) :center (640 360) {axes})
  (unknowns (B (pose 3)) (X (vector 3) :per points))
  (observe left (= [u v] (project cam (X point))) :sigma 0.5)
  (observe right (= [u v] (project cam {moved})) :sigma 0.5)
  (observe scale (= {scale}) :sigma 0.001))"""

BUNDLE = """(problem bundle (data photos external :key photo) (data points external :key point) (data d external)
  (camera cam :focal (800 800) :center (640 360))
  (unknowns (T (pose 3) :per photos {fixed}) (X (vector 3) :per points))
  (observe d (= [u v] (project cam (transform (T photo) (X point)))) :sigma 0.5)
  {more})"""


@pytest.mark.parametrize("plane", [False, True], ids=["space", "plane"])
@pytest.mark.parametrize(
    ("moved", "scale"),
    [
        ("(transform B (X point))", "{apart} (distance (X 0) (X 1))"),
        ("(transform (inverse B) (X point))", "{base} (norm (translation B))"),
    ],
    ids=["distance", "baseline"],
)
def test_two_photographs_and_one_length(moved: str, scale: str, plane: bool) -> None:
    points, poses = scene(12, plane=plane), photographs(2)
    data = pixels(points, poses)
    left, right = ({name: column[data["photo"] == k] for name, column in data.items()} for k in (0, 1))
    apart, base = np.linalg.norm(points[0] - points[1]), np.linalg.norm(poses[1][1])
    text = PAIR.format(axes="", moved=moved, scale=scale.format(apart=apart, base=base))
    found = solve(text, points={"point": np.arange(12.0)}, left=left, right=right)
    np.testing.assert_allclose(numbers(found, "X", 12), points, atol=EXACT)


@pytest.mark.parametrize("photos", [2, 4])
def test_photographs_of_unknown_points_the_first_of_which_is_the_frame(photos: int) -> None:
    points, poses = scene(20, plane=False), photographs(photos)
    apart = np.linalg.norm(points[0] - points[1])
    text = BUNDLE.format(
        fixed=":fixed (= photo 0) :at (pose3)",
        more=f"(observe scale (= {apart} (distance (X 0) (X 1))) :sigma 0.001)",
    )
    tables = {"photos": {"photo": np.arange(float(photos))}, "points": {"point": np.arange(20.0)}}
    found = solve(text, **tables, d=pixels(points, poses))
    np.testing.assert_allclose(numbers(found, "X", 20), points, atol=EXACT)
    # noise of half a pixel: the sum of squares has the mean and, doubled, the variance of its degrees of freedom
    noisy = solve(text, **tables, d=pixels(points, poses, 0.5))
    freedom = 40 * photos + 1 - 6 * (photos - 1) - 60
    assert noisy.cost is not None
    assert abs(noisy.cost - freedom) < 4 * np.sqrt(2 * freedom)


def test_a_bundle_without_frame_or_scale() -> None:
    """Distances of its points are known but for their unit."""
    points, poses = scene(20, plane=False), photographs(3)
    tables = {"photos": {"photo": np.arange(3.0)}, "points": {"point": np.arange(20.0)}}
    found = solve(BUNDLE.format(fixed="", more="(solve :gauge free)"), **tables, d=pixels(points, poses))
    got = numbers(found, "X", 20)
    shape = [np.linalg.norm(each[1:] - each[0], axis=1) / np.linalg.norm(each[1] - each[0]) for each in (got, points)]
    np.testing.assert_allclose(shape[0], shape[1], rtol=EXACT)


TURN, PLACE = "(Q (rotation 3) :per photos)", "(t (vector 3) :per photos)"


@pytest.mark.parametrize("unknowns", [(TURN, PLACE), (PLACE, TURN)], ids=["turn-first", "place-first"])
def test_a_bundle_whose_rotations_and_positions_are_unknowns_of_their_own(unknowns: tuple[str, str]) -> None:
    points, poses = scene(20, plane=False), photographs(3)
    apart = np.linalg.norm(points[0] - points[1])
    text = f"""(problem bundle (data photos external :key photo) (data points external :key point) (data d external)
      (camera cam :focal (800 800) :center (640 360))
      (unknowns {unknowns[0]} {unknowns[1]} (X (vector 3) :per points))
      (observe d (= [u v] (project cam (+ (t photo) (rotate (Q photo) (X point))))) :sigma 0.5)
      (observe scale (= {apart} (distance (X 0) (X 1))) :sigma 0.001)
      (solve :gauge free))"""
    tables = {"photos": {"photo": np.arange(3.0)}, "points": {"point": np.arange(20.0)}}
    got = numbers(solve(text, **tables, d=pixels(points, poses)), "X", 20)
    far = [np.linalg.norm(each[1:] - each[0], axis=1) for each in (got, points)]
    np.testing.assert_allclose(far[0], far[1], rtol=EXACT)


@pytest.mark.parametrize("unknowns", ["(Q (rotation 3)) (t (vector 3))", "(t (vector 3)) (Q (rotation 3))"])
def test_consensus_places_a_camera_whose_rotation_and_position_are_unknowns_of_their_own(unknowns: str) -> None:
    points, (_, (R, t)) = scene(12, plane=False), photographs(2)
    image = seen(points, R, t)
    image[:4] += 50.0
    text = f"""(problem sights (data d external)
      (camera cam :focal (800 800) :center (640 360))
      (unknowns {unknowns})
      (observe d (= [u v] (project cam (+ t (rotate Q [x y z])))) :sigma 0.5)
      (solve :robust lmeds))"""
    d = dict(zip("xyz", points.T, strict=True)) | {"u": image[:, 0], "v": image[:, 1]}
    found = solve(text, d=d)
    np.testing.assert_allclose(np.asarray(found["t"].value).ravel(), t, atol=EXACT)


def test_a_large_bundle_with_few_points_in_each_photograph() -> None:
    """Of thousands of rows some are probed where the point is beside the camera."""
    generator = np.random.default_rng(0)
    points, d = generator.uniform(-3.0, 3.0, (3_000, 3)), {"photo": [], "point": [], "u": [], "v": []}
    for photo in range(30):
        there = np.flatnonzero(generator.uniform(size=len(points)) < 0.2)
        R = Rotation.from_euler("y", 0.2 * photo).as_matrix()
        found = seen(points[there], R, np.array([0.0, 0.0, 12.0])) + 0.5 * generator.standard_normal((len(there), 2))
        for name, column in zip(d, (np.full(len(there), float(photo)), there.astype(float), *found.T), strict=True):
            d[name] = np.append(d[name], column)
    often = np.bincount(d["point"].astype(int))[d["point"].astype(int)] > 1
    own, again = np.unique(d["point"][often], return_inverse=True)
    d = {name: column[often] for name, column in d.items()} | {"point": again.astype(float)}
    solved = solve(
        BUNDLE.format(fixed="", more="(solve :gauge free)"),
        photos={"photo": np.arange(30.0)}, points={"point": np.arange(float(len(own)))}, d=d,
    )  # fmt: skip
    assert solved.cost == pytest.approx(solved.dof, abs=5 * np.sqrt(2 * solved.dof))


def test_ways_of_two_photographs_that_the_others_do_not_fit_are_left() -> None:
    """Thirty points about a centre that cameras turn about: the first two photographs leave four ways."""
    generator = np.random.default_rng(0)
    points, views = generator.uniform(-1.0, 1.0, (30, 3)), []
    for k in range(4):
        R = Rotation.from_euler("y", 0.25 * k) * Rotation.from_rotvec(generator.uniform(-0.1, 0.1, 3))
        moved = R.apply(points) + np.array([0.0, 0.0, 5.0]) + generator.uniform(-0.2, 0.2, 3)
        rays = np.column_stack([moved[:, :2] / moved[:, 2:] + generator.normal(0.0, 0.3 / 800, (30, 2)), np.ones(30)])
        views.append(View(points=np.arange(30), bearings=rays / np.linalg.norm(rays, axis=1, keepdims=True)))
    (found,) = structures(views, 30)
    far = [np.linalg.norm(each[1:] - each[0], axis=1) for each in (found.points, points)]
    # a ray is 4e-4 rad off, 2 mm at 5; three photographs and more meet in a point to some mm, of 0.5 to 2 apart
    np.testing.assert_allclose(far[0] / far[0].sum(), far[1] / far[1].sum(), atol=1e-3)
