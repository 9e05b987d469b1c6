"""Differences of rotations, poses and similarities, and what `compose`, `between` and `inverse` keep of them."""

import numpy as np
import pytest
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

import mbm

ROUNDING = 1e-12
"""Differences of rotations lose a few digits where the four numbers of a quaternion come from sums of a matrix."""


def residuals(equation, unknowns="(dummy :init 0)"):
    """The whitened residuals of one equation at the start, without the prior on the dummy."""
    text = f"(problem p (unknowns {unknowns}) (observe {equation} :sigma 1))"
    return mbm.loads(text).compile().residuals(np.zeros(_freedom(text)))


def _freedom(text):
    compiled = mbm.loads(text).compile()
    from mbm.estimation.solve.estimate import assemble

    found = compiled.elaborated
    starts = {}
    return assemble(found.problem, compiled.kernels, found.tables, starts, compiled.cache)[0].dimension


def quaternion(rotation):
    x, y, z, w = rotation.as_quat()
    return f"(quaternion {w:.17g} {x:.17g} {y:.17g} {z:.17g})"


def matrix(rotation):
    rows = " ".join("[" + " ".join(f"{v:.17g}" for v in row) + "]" for row in rotation.as_matrix())
    return f"(rotation (pose3 [{rows}] [0 0 0]))"


CASES = [Rotation.from_rotvec(v) for v in ([0, 0, 0], [1e-9, 0, 0], [0.3, -0.2, 0.5], [0, 2.5, -1.5], [2.2, 2.2, 0.1])]


@pytest.mark.parametrize("write", [quaternion, matrix], ids=["quaternion", "matrix"])
@pytest.mark.parametrize("turn", CASES, ids=lambda r: f"{r.magnitude():.3g}")
def test_rotations_differ_by_their_logarithm(write, turn):
    base = Rotation.from_euler("xyz", [0.4, -1.2, 2.0])
    found = residuals(f"(= {write(base)} {write(base * turn)})")
    np.testing.assert_allclose(found, turn.as_rotvec(), atol=ROUNDING)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0.6, 0.8, 0], [-0.6, 0, 0.8]])
def test_half_turns_have_the_length_pi(axis):
    turn = Rotation.from_rotvec(np.pi * np.array(axis))
    for write in (quaternion, matrix):
        found = residuals(f"(= (rot-x 0) {write(turn)})")
        assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-7)  # a matrix tells half turns to half its digits
        np.testing.assert_allclose(np.abs(found @ np.array(axis)), np.pi, atol=1e-7)


def test_poses_differ_rotation_first_in_the_frame_of_the_measured_one():
    first = (Rotation.from_rotvec([0.1, 0.2, 0.3]), np.array([1.0, 2, 3]))
    second = (Rotation.from_rotvec([0.5, -0.2, 0.1]), np.array([2.0, 1, 5]))
    poses = [f"(pose3 {quaternion(r)} [{' '.join(map(str, t))}])" for r, t in (first, second)]
    found = residuals(f"(= {poses[0]} {poses[1]})")
    turned = first[0].inv() * second[0]
    np.testing.assert_allclose(found[:3], turned.as_rotvec(), atol=ROUNDING)
    np.testing.assert_allclose(found[3:], first[0].inv().apply(second[1] - first[1]), atol=ROUNDING)


def test_differences_in_the_plane_wrap():
    found = residuals("(= (pose2 1 2 3) (pose2 2 2 -3))")
    wanted = np.array([2 * np.pi - 6, np.cos(3), -np.sin(3)])
    np.testing.assert_allclose(found, wanted, atol=ROUNDING)
    np.testing.assert_allclose(residuals("(= (rot2 170deg) (rot2 -170deg))"), [np.radians(20)], atol=ROUNDING)


def test_between_and_compose_of_poses():
    r = Rotation.from_rotvec([0.3, 0.1, -0.4])
    s = Rotation.from_rotvec([-0.2, 0.7, 0.1])
    p, q = (f"(pose3 {quaternion(a)} [1 2 3])" for a in (r, s))
    found = residuals(f"(= (between {p} {q}) (compose (inverse {p}) {q}))")
    np.testing.assert_allclose(found, np.zeros(6), atol=ROUNDING)
    ahead = residuals(f"(= (pose3 (rot-x 0) [0 0 0]) (between {p} {q}))")
    turned = logm((r.inv() * s).as_matrix()).real
    np.testing.assert_allclose(ahead[:3], [turned[2, 1], turned[0, 2], turned[1, 0]], atol=ROUNDING)


def test_kinds_must_agree():
    with pytest.raises(mbm.MbmError) as caught:
        residuals("(= (rot2 1) (rot-x 1))")
    assert "rotation" in str(caught.value)
    with pytest.raises(mbm.MbmError):
        residuals("(= (pose3 (rot-x 1) [0 0 0]) (rot-x 1))")


def test_unknowns_start_where_init_says():
    unknowns = "(T (pose 3) :init (pose3 (euler 0.1 0.2 0.3) [1 2 3])) (S (similarity 2) :init (pose2 1 2 0.5))"
    found = residuals(
        "(= (pose3 (euler 0.1 0.2 0.3) [1 2 3]) T) (= [1 2] (translation S)) (= 0.5 (heading S))", unknowns
    )
    np.testing.assert_allclose(found, np.zeros(9), atol=ROUNDING)
