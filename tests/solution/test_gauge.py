"""Motions of the whole scene: recognised among points and poses whatever else moves along, named, settled if asked."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

CORNERS = np.array([[0, 0, 0], [4, 0, 0], [0, 3, 0], [0, 0, 2], [4, 3, 1], [1, 3, 2.5]], dtype=np.float64)
TABLE = {"k": np.arange(6.0), "x": CORNERS[:, 0], "y": CORNERS[:, 1], "z": CORNERS[:, 2]}
PAIRS = {
    "i": np.array([i for i in range(6) for j in range(i)], dtype=np.float64),
    "j": np.array([j for i in range(6) for j in range(i)], dtype=np.float64),
}
POINTS = "(unknowns (p (vector 3) :per t :init [x y z] {fixed}))"


def motions(clauses, **tables):
    text = f"(problem g (data t external :key k) (data u external) {clauses})"
    found = mbm.loads(text).solve(data={"t": TABLE, "u": PAIRS | tables})
    return found, [(g.motion, g.dimensions, g.unknowns) for g in found.observability.gauge]


def between(of):
    return {"d": np.array([of(CORNERS[int(i)], CORNERS[int(j)]) for i, j in zip(*PAIRS.values(), strict=True)])}


DISTANCES = between(lambda a, b: np.linalg.norm(a - b) + 1e-3)
HEIGHTS = between(lambda a, b: a[2] - b[2])
TAPE = "(observe u (= d (norm (- (p i) (p j)))) :sigma 0.01)"


def test_distances_leave_six_dimensions():
    found, named = motions(POINTS.format(fixed="") + TAPE, **DISTANCES)
    assert named == [("translation", 3, ("p",)), ("rotation", 3, ("p",))]
    assert found.first.status is SolveStatus.UNOBSERVABLE
    assert found.observability.dimension - found.observability.rank == 6
    assert "fix one position" in found.observability.gauge[0].sentence


def test_a_fixed_point_leaves_the_rotations():
    _, named = motions(POINTS.format(fixed=":fixed (= k 0)") + TAPE, **DISTANCES)
    assert named == [("rotation", 3, ("p",))]


def test_a_fixed_axis_leaves_one_rotation():
    found, named = motions(POINTS.format(fixed=":fixed (< k 2)") + TAPE, **DISTANCES)
    assert named == [("rotation", 1, ("p",))]
    assert "be turned about x" in found.observability.gauge[0].sentence  # the points 0 and 1 lie on it


def test_height_differences_leave_shifts_and_what_no_motion_is():
    found, named = motions(POINTS.format(fixed="") + "(observe u (= d (- ((p i) 3) ((p j) 3))) :sigma 0.01)", **HEIGHTS)
    assert named == [("translation", 1, ("p",))]
    assert "be shifted along z" in found.observability.gauge[0].sentence
    free = found.observability.dimension - found.observability.rank
    assert free == 13  # all 12 x and y, which are in no equation, and the common height
    assert len(found.observability.unobservable) > 0


def test_directions_leave_the_size_too():
    units = between(lambda a, b: 0.0)
    apart = CORNERS[PAIRS["i"].astype(int)] - CORNERS[PAIRS["j"].astype(int)]
    apart = apart / np.linalg.norm(apart, axis=1)[:, None]
    found, named = motions(
        POINTS.format(fixed="") + "(observe u (= [e f g] (normalize (- (p i) (p j)))) :sigma 0.01)",
        **units, e=apart[:, 0], f=apart[:, 1], g=apart[:, 2],
    )  # fmt: skip
    assert named == [("translation", 3, ("p",)), ("scale", 1, ("p",))]
    assert "give one distance" in found.observability.gauge[1].sentence


@pytest.mark.parametrize("way", ["(between (T i) (T j))", "(compose (T i) (inverse (T j)))"], ids=["into", "out of"])
def test_poses_either_way_round(way):
    poses = mbm.loads(f"""(problem g (data t external :key k) (data u external)
      (unknowns (T (pose 3) :per t :init (pose3 (axis-angle [(* 0.1 x) (* 0.2 y) (* -0.1 z)]) [x y z])))
      (observe u (= (pose3 (axis-angle [0 0 a]) [1 0 0]) {way}) :sigma 1))""")
    found = poses.solve(data={"t": TABLE, "u": PAIRS | {"a": 0.01 * PAIRS["i"]}})
    named = [(g.motion, g.dimensions, g.unknowns) for g in found.observability.gauge]
    assert named == [("translation", 3, ("T",)), ("rotation", 3, ("T",))]


def test_one_point_is_no_scene():
    unknown = "(unknowns (q (vector 3) :init [1 1 1]))"
    text = f"(problem g (data t external :key k) {unknown} (observe t (= x (+ (q 1) (q 2) (q 3))) :sigma 1))"
    found = mbm.loads(text).solve(data={"t": TABLE})
    assert found.observability.gauge == ()
    assert len(found.observability.unobservable) == 2


def test_the_minimum_norm_datum_is_the_pseudo_inverse():
    found, named = motions(POINTS.format(fixed="") + TAPE + "(solve :gauge free)", **DISTANCES)
    assert [m for m, _, _ in named] == ["translation", "rotation"]
    assert found.first.status is SolveStatus.CONVERGED
    p = found["p"].value
    jacobian = np.zeros((15, 18))
    for row, (i, j) in enumerate(zip(PAIRS["i"].astype(int), PAIRS["j"].astype(int), strict=True)):
        unit = (p[i] - p[j]) / np.linalg.norm(p[i] - p[j]) / 0.01
        jacobian[row, 3 * i : 3 * i + 3], jacobian[row, 3 * j : 3 * j + 3] = unit, -unit
    scale = np.linalg.norm(jacobian, axis=0)
    expected = np.sqrt(np.diag(np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), rcond=1e-10)))
    np.testing.assert_allclose(found["p"].sigma.ravel(), expected / scale, rtol=1e-6)  # two pseudo-inverses
