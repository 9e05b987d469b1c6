"""Poses from bearings: three points with all solutions, many points, points in a plane, resection in the plane."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.native.callbacks import InterpretedCode
from mbm.estimation.starts.closed_forms.intersection import meeting_points
from mbm.estimation.starts.closed_forms.numerics.bearings import (
    plane_poses_from_bearings,
    poses_from_bearings,
    poses_from_three,
)
from mbm.estimation.starts.closed_forms.pose_from_points import is_central
from tests.estimation.closed_forms.numerics_cases import ROTATIONS, Floats, bearings, cloud

CODE = InterpretedCode()
EXACT = 1e-8
"""Roots of a quartic that are nearly double have half the digits of its coefficients."""


def poses_of(points: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """Those of one set of three."""
    rotations, shifts = poses_from_three(CODE, points[None], seen[None])
    return rotations[0], shifts[0]


@pytest.mark.parametrize("R", ROTATIONS)
@pytest.mark.parametrize("seed", range(5))
def test_the_pose_is_among_the_solutions_for_three_points(R: Floats, seed: int) -> None:
    points, t = cloud(3, seed), np.array([0.3, -0.2, 4.0])
    rotations, shifts = poses_of(points, bearings(points, R, t))
    best = int(np.nanargmin(np.abs(rotations - R).max(axis=(1, 2))))
    np.testing.assert_allclose(rotations[best], R, atol=EXACT)
    np.testing.assert_allclose(shifts[best], t, atol=10 * EXACT)


def test_every_solution_for_three_points_sees_them_where_they_are_seen() -> None:
    """An equilateral triangle from straight above is seen alike from three other places (Fischler and Bolles 1981)."""
    angles = np.array([0.0, 2.0, 4.0]) * np.pi / 3
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    seen = bearings(points, np.eye(3), np.array([0.0, 0.0, np.sqrt(3.0)]))
    rotations, shifts = poses_of(points, seen)
    real = np.isfinite(shifts).all(axis=1)
    assert real.sum() == 4
    for R, t in zip(rotations[real], shifts[real], strict=True):
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(bearings(points, R, t), seen, atol=1e-6)


def test_three_points_on_a_line_give_no_pose() -> None:
    points = np.outer(np.arange(3.0), [1.0, 0.0, 0.0])
    assert np.isnan(poses_of(points, bearings(points, np.eye(3), np.array([0.0, 1.0, 4.0])))[1]).all()


@pytest.mark.parametrize("R", ROTATIONS)
@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [4, 6, 40])
def test_many_points_give_the_pose(R: Floats, flat: bool, count: int) -> None:
    points, t = cloud(count, count, flat=flat), np.array([0.3, -0.2, 4.0])
    rotations, shifts = poses_from_bearings(points, bearings(points, R, t))
    np.testing.assert_allclose(rotations[0], R, atol=EXACT)
    np.testing.assert_allclose(shifts[0], t, atol=10 * EXACT)


def test_a_plane_seen_from_afar_has_two_poses() -> None:
    """Tilted by ±30° about an axis in the image, at 100 times its size: perspective hardly tells which."""
    points, t = cloud(6, 7, flat=True), np.array([0.0, 0.0, 100.0])
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    tilted = np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])
    rotations, _ = poses_from_bearings(points, bearings(points, tilted, t))
    assert len(rotations) == 2
    np.testing.assert_allclose(rotations[0], tilted, atol=1e-6)
    np.testing.assert_allclose(rotations[1], tilted.T, atol=0.1)


def test_no_point_may_be_behind_the_eye() -> None:
    points, t = cloud(8, 8), np.array([0.3, -0.2, 4.0])
    backwards, _ = poses_from_bearings(points, -bearings(points, np.eye(3), t))
    assert not len(backwards) or np.abs(backwards[0] - np.eye(3)).max() > 0.1


@pytest.mark.parametrize("angle", [0.0, 1.0, 3.1, -2.0])
def test_landmarks_of_the_plane_give_position_and_heading(angle: float) -> None:
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    t, points = np.array([0.5, -2.0]), cloud(4, 9)[:, :2]
    seen = points @ R.T + t
    found, shifts = plane_poses_from_bearings(points, seen / np.linalg.norm(seen, axis=1, keepdims=True))
    np.testing.assert_allclose(found[np.isfinite(found[:, 0, 0])][0], R, atol=EXACT)
    np.testing.assert_allclose(shifts[np.isfinite(found[:, 0, 0])][0], t, atol=EXACT)


def test_rays_meet_where_they_were_sent_from() -> None:
    places, point = cloud(5, 10), np.array([1.0, 2.0, 9.0])
    rays = (point - places) / np.linalg.norm(point - places, axis=1, keepdims=True)
    np.testing.assert_allclose(meeting_points(places, -rays), point, atol=EXACT)
    assert np.isnan(meeting_points(places, np.tile(rays[:1], (5, 1)))).all()


AHEAD = np.tile([0.0, 0.0, 1.0], (5, 1))
ROUNDED = np.tile([4e-16, -7e-17, 5.0], (12, 1))
"""Their mean is not quite where they all are."""


@pytest.mark.parametrize(
    ("points", "seen"),
    [
        (np.tile([1.0, 2.0, 3.0], (5, 1)), AHEAD),
        (ROUNDED, bearings(cloud(12, 0), np.eye(3), np.zeros(3))),
        (cloud(5, 3), AHEAD),
    ],
    ids=["one place", "one place but for rounding", "one ray"],
)
def test_points_at_one_place_or_on_one_ray_have_no_pose(points: np.ndarray, seen: np.ndarray) -> None:
    found, shifts = poses_from_bearings(points, seen)
    assert (found.shape, shifts.shape) == ((0, 3, 3), (0, 3))


@pytest.mark.parametrize(
    ("seen", "central"),
    [
        (lambda x, y, z: [[1 / z, 0 * z, -x / z**2], [0 * z, 1 / z, -y / z**2]], True),  # x/z, y/z
        (lambda x, y, z: [[1 / z, 0 * z, -x / z**2], [x, y, z]], False),  # x/z, (x² + y² + z²)/2
        (lambda x, y, z: [[0 * x, 0 * x, 0 * x], [0 * x, 0 * x, 0 * x]], False),  # nothing
    ],
)
def test_rows_of_a_camera_do_not_notice_how_far_away_a_point_is(seen, central):
    slopes = lambda place: np.moveaxis(np.array(seen(*place.T)), 2, 0)  # noqa: E731
    assert is_central(SimpleNamespace(points=np.ones((5, 3)), slopes=slopes)) is central


BACKWARDS = """(problem back (data d external) (unknowns (P (pose 3)))
  (observe d (= [u v] (let ((c (transform P [x y z]))) [(/ (* -800 (c 1)) (c 3)) (/ (* -800 (c 2)) (c 3))]))
    :sigma 0.5))"""


def test_a_camera_that_looks_along_its_negative_axis_needs_no_start():
    """As those of bundle adjustment in the large: the other way round it would see the points mirrored."""
    points = np.random.default_rng(3).uniform(-1.0, 1.0, (8, 3))
    turn, shift = Rotation.from_rotvec([0.3, -0.4, 0.2]), np.array([0.1, -0.2, -6.0])
    x, y, z = (turn.apply(points) + shift).T
    columns = {**dict(zip("xyz", points.T, strict=True)), "u": -800 * x / z, "v": -800 * y / z}
    found = mbm.loads(BACKWARDS).solve(data={"d": columns})
    assert found.cost == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found["P"].value[4:], shift, atol=1e-6)
    np.testing.assert_allclose(found["P"].value[:4], turn.as_quat(scalar_first=True), atol=1e-7)
