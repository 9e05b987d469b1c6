"""A box of which a face is seen nearly edge-on: both sides of that have a minimum, and the truth may lie in either."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.estimation.trust.beyond import Beyond
from tests.estimation.silhouettes.test_starts import BOX, CAMERA, CORNERS, HALF_TURNS, PLACE, columns, outline, rotation

NORMAL = np.array([0, 0, 1.0])
FACE = 0.025 * NORMAL
"""The face that is seen edge-on, or hardly beyond."""


def facing(R: np.ndarray, t: np.ndarray) -> float:
    """The sine of the angle by which the face is turned away from the camera."""
    seen = t + R @ FACE
    return float((R @ NORMAL) @ seen / np.linalg.norm(seen))


def scene(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A rotation with the face within 0.2° of edge-on, and 60 points (60, 2) of the contour with errors of 0.1."""
    random = np.random.default_rng(seed)
    turned = Rotation.random(random_state=random).as_matrix()
    axis = np.cross(turned @ NORMAL, PLACE + turned @ FACE)
    off = np.arcsin(facing(turned, PLACE)) + np.radians(random.uniform(-0.2, 0.2))
    R = Rotation.from_rotvec(-off * axis / np.linalg.norm(axis)).as_matrix() @ turned
    return R, outline(CORNERS @ R.T + PLACE, 60) + random.normal(0, 0.1, (60, 2))


def solved(points: np.ndarray, R: np.ndarray | None = None):
    start = ""
    if R is not None:
        turn = " ".join(map(repr, np.roll(Rotation.from_matrix(R).as_quat(), 1).tolist()))
        start = f":init (pose3 (quaternion {turn}) [{' '.join(map(repr, PLACE.tolist()))}])"
    unknowns = f"(unknowns (T (pose 3) {start}))"
    text = f"(problem p (data d external) {CAMERA} {unknowns} (observe d {BOX.format('T')} :sigma 0.1))"
    return mbm.loads(text).solve(data={"d": columns(points)}).first


def pose(found) -> tuple[np.ndarray, np.ndarray]:
    value = np.asarray(found.estimates[0].value)
    return rotation(value), value[4:]


@pytest.mark.parametrize("seed", [43, 67, 91])
def test_the_minimum_on_the_other_side_of_edge_on_is_told(seed):
    R, points = scene(seed)
    found = solved(points, R)
    (other,) = found.alternatives
    assert facing(*pose(found)) * facing(*pose(other)) < 0
    assert other.cost < found.cost + 9
    assert "another-solution" in [each.code.name for each in found.diagnostics]


def test_the_better_side_is_the_answer_without_a_start():
    """On each side four poses look the same."""
    R, points = scene(17)
    found = solved(points)
    assert found.cost < solved(points, R).cost - 0.5
    costs = [each.cost for each in found.alternatives]
    assert sum(abs(cost - found.cost) < 1e-3 for cost in costs) == len(HALF_TURNS) - 1
    assert sum(0.5 < cost - found.cost < 1 for cost in costs) == len(HALF_TURNS)


def test_where_no_face_is_nearly_edge_on_nothing_is_told():
    R = Rotation.random(random_state=np.random.default_rng(1)).as_matrix()
    points = outline(CORNERS @ R.T + PLACE, 60) + np.random.default_rng(1).normal(0, 0.1, (60, 2))
    assert solved(points, R).alternatives == ()


def test_regions_around_other_minima_belong_to_intervals():
    """At 2 σ a minimum that costs 3 more takes in ±1 of its own σ; one that costs 5 more nothing."""
    other = Beyond(steps=np.array([[-7.0], [9.0]]), spreads=np.array([[0.5], [1.0]]), grown=np.array([3.0, 5.0]))
    below, above = other.ends(2.0)
    np.testing.assert_allclose([below, above], [[7.5], [0.0]])
    below, above = other.ends(3.0)
    np.testing.assert_allclose([below, above], [[7 + 0.5 * 6**0.5], [11.0]])
