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
    expected = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-10)
    np.testing.assert_allclose(found["p"].sigma.ravel(), np.sqrt(np.diag(expected)), rtol=1e-6)  # two pseudo-inverses
    np.testing.assert_allclose(found.covariance.matrix, expected, atol=1e-6 * np.abs(expected).max())


TURNS = {1: [0.3, -0.2, 0.5], 2: [1.1, 0.4, -0.7], 3: [-0.6, 0.9, 0.2], 4: [0.1, 2.0, -1.0]}
ROTATIONS = """(problem g (data t (table (k) (1) (2) (3) (4)) :key k) (data u external)
  (unknowns (R (rotation 3) :per t))
  (observe u (= (axis-angle [a b c]) (between (R i) (R j))) :sigma 0.01)
  (derive (d (between (R 1) (R 3)))) {solve})"""


def between_turns():
    """Relative rotations of all pairs but (1, 4), each off by some 0.01 rad."""
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    pairs = [(1, 2), (2, 3), (3, 4), (1, 3), (2, 4)]
    errors = 0.01 * np.random.default_rng(1).normal(size=(5, 3))
    vectors = np.array([
        (rotation.from_rotvec(TURNS[i]).inv() * rotation.from_rotvec(TURNS[j]) * rotation.from_rotvec(e)).as_rotvec()
        for (i, j), e in zip(pairs, errors, strict=True)
    ])  # fmt: skip
    i, j = np.array(pairs, dtype=np.float64).T
    return {"i": i, "j": j, "a": vectors[:, 0], "b": vectors[:, 1], "c": vectors[:, 2]}


def test_rotations_beside_each_other_only_may_turn_together():
    found = mbm.loads(ROTATIONS.format(solve="")).solve(data={"u": between_turns()})
    assert [(g.motion, g.dimensions, g.unknowns) for g in found.observability.gauge] == [("rotation", 3, ("R",))]
    assert found.first.status is SolveStatus.UNOBSERVABLE
    assert len(found.observability.unobservable) == 1  # said once, not once for each of the three directions
    assert "be turned" in found.observability.unobservable[0].sentence


def test_rotations_are_settled_by_the_datum():
    found = mbm.loads(ROTATIONS.format(solve="(solve :gauge free)")).solve(data={"u": between_turns()})
    assert found.first.status is SolveStatus.CONVERGED
    fixed = ROTATIONS.format(solve="").replace(":per t)", ":per t :init (axis-angle [0 0 0]) :fixed (= k 1))")
    held = mbm.loads(fixed).solve(data={"u": between_turns()})
    np.testing.assert_allclose(found["d"].sigma, held["d"].sigma, rtol=1e-6)  # the same fit, found from other starts


def test_rotations_and_directions_turn_together():
    text = """(problem g (data t (table (k) (1) (2)) :key k) (data l (table (k) (1) (2) (3)) :key k) (data u external)
      (unknowns (R (rotation 3) :per t) (d direction :per l))
      (observe u (= [x y z] (rotate (inverse (R i)) (d j))) :sigma 0.01) (solve :gauge free))"""
    rows = {"i": [1.0, 1, 1, 2, 2, 2], "j": [1.0, 2, 3, 1, 2, 3],
            "x": [1.0, 0, 0, 0, -1, 0], "y": [0.0, 1, 0, 1, 0, 0], "z": [0.0, 0, 1, 0, 0, 1]}  # fmt: skip
    found = mbm.loads(text).solve(data={"u": {k: np.array(v) for k, v in rows.items()}})
    assert [(g.motion, g.dimensions, g.unknowns) for g in found.observability.gauge] == [("rotation", 3, ("R", "d"))]
    assert found.first.status is SolveStatus.CONVERGED


LEVELS = """(problem g (data t (table (k) (1) (2) (3)) :key k)
  (data u (table (i j d) (1 2 1.02) (2 3 0.49) (1 3 1.5)))
  (unknowns (h :per t :init 0)) (observe u (= d (- (h j) (h i))) :sigma 0.01) {solve})"""


def test_heights_beside_each_other_only():
    found = mbm.loads(LEVELS.format(solve="")).solve()
    assert [(g.motion, g.dimensions, g.unknowns) for g in found.observability.gauge] == [("translation", 1, ("h",))]
    assert "only their differences are determined" in found.observability.unobservable[0].sentence
    assert "fix one of them" in found.observability.gauge[0].sentence
    settled = mbm.loads(LEVELS.format(solve="(solve :gauge free)")).solve()
    assert settled.first.status is SolveStatus.CONVERGED
    design = np.array([[-1, 1, 0], [0, -1, 1], [-1, 0, 1]]) / 0.01  # all columns are of one length
    np.testing.assert_allclose(settled["h"].sigma, np.sqrt(np.diag(np.linalg.pinv(design.T @ design))), rtol=1e-9)
    np.testing.assert_allclose(settled["h"].value, np.linalg.pinv(design) @ ([102.0, 49, 150]), atol=1e-12)


SHEET = """(problem g
  (data c (table (x y u v) {rows}))
  (camera cam :focal (fx fy) :center (cx cy))
  (unknowns (fx :init 800) (fy :init 810) (cx :init 320 {fixed}) (cy :init 240 {fixed})
    (r (vector 3) :init [0.35 -0.2 0.1]) (t (vector 3) :init [-0.1 -0.05 0.5]))
  (observe c (= [u v] (project cam (trans t (rotate (axis-angle r) [x y 0])))) :sigma 0.1))"""


def test_one_photograph_of_a_plane_is_no_motion_of_the_scene():
    """A homography has eight numbers, camera and pose ten (Zhang 2000); the grid gives size and direction.

    Rotation vector and position are six numbers: shifts, turns and growth of two points span all their changes, so
    that a motion is found in whatever is free.
    """
    grid = [(x, y, *_seen(x, y)) for x in np.arange(5) * 0.05 for y in np.arange(4) * 0.05]
    rows = " ".join("(" + " ".join(f"{number:.12g}" for number in row) + ")" for row in grid)
    found = mbm.loads(SHEET.format(rows=rows, fixed="")).solve()
    assert found.observability.dimension - found.observability.rank == 2
    assert found.observability.gauge == ()
    assert all({"fx", "fy"} <= set(each.unknowns) for each in found.observability.unobservable)
    known = mbm.loads(SHEET.format(rows=rows, fixed=":fixed true")).solve()
    assert known.first.status is SolveStatus.CONVERGED
    assert known["fx"].value == pytest.approx(800, rel=1e-6)


def _seen(x, y):
    """The image of a point of the sheet: Rodrigues' rotation, then a pinhole."""
    r, t = np.array([0.3, -0.25, 0.1]), np.array([-0.1, -0.06, 0.45])
    angle = np.linalg.norm(r)
    axis, p = r / angle, np.array([x, y, 0.0])
    turned = p * np.cos(angle) + np.cross(axis, p) * np.sin(angle) + axis * (axis @ p) * (1 - np.cos(angle))
    a, b, c = turned + t
    return 800 * a / c + 320, 810 * b / c + 240
