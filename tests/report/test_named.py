"""Estimates by name: members of families, rotations and translations, as SciPy has them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm

TURNS = Rotation.from_rotvec([[0.3, -0.2, 0.5], [-1.0, 0.4, 0.2]])
PLACES = np.array([[0.1, 0.2, 0.3], [1.0, -2.0, 0.5]])


@pytest.fixture(scope="module")
def solved():
    rows = " ".join(
        f'("{key}" {" ".join(map(str, [*turn, *place]))})'
        for key, turn, place in zip(("a", "b"), TURNS.as_rotvec().tolist(), PLACES.tolist(), strict=True)
    )
    text = f"""(problem p
      (data t (table (k rx ry rz x y z) {rows}) :key k)
      (data n (table (i u) (1 5cm) (2 7cm)) :key i)
      (unknowns (T (pose 3) :per t) (P (pose 2) :init (pose2 0 0 0.1)) (S (similarity 3))
                (f :per n :unit cm) (v (vector 2)))
      (observe t (= (pose3 (axis-angle [rx ry rz]) [x y z]) (T k)) :sigma 0.1)
      (observe (= (pose2 1 2 0.4) P) :sigma 0.1)
      (observe (= [1 0 0] (transform S [0 0 0])) (= [3 0 0] (transform S [1 0 0])) (= [1 0 2] (transform S [0 1 0]))
               :sigma 0.1)
      (observe n (= u (f i)) :sigma 1mm)
      (observe (= [1 2] v) :sigma 1)
      (derive (far (norm v)) (twice (* 2 (f i)) :over n)))"""
    return mbm.loads(text).solve()


def test_names_are_those_of_estimates_and_then_of_derived_quantities(solved):
    assert list(solved) == ["T", "P", "S", "f", "v", "far", "twice"]
    assert solved.keys() == tuple(solved)
    assert "far" in solved
    assert "T" in solved
    assert "t" not in solved
    assert 0 not in solved
    assert set(dict(solved)) == set(solved)


def test_a_family_of_poses_has_matrices_quaternions_and_translations(solved):
    T = solved["T"]
    assert T.keys == ("a", "b")
    np.testing.assert_allclose(T.rotation, TURNS.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(T.translation, PLACES, atol=1e-12)
    mine = Rotation.from_quat(np.roll(T.quaternion, -1, axis=1))
    assert np.abs((mine * TURNS.inv()).as_rotvec()).max() < 1e-12
    for i, key in enumerate(T.keys):
        member = T[key]
        assert (member.name, member.keys, member.unit) == (f'T["{key}"]', None, T.unit)
        np.testing.assert_array_equal(member.value, T.value[i])
        np.testing.assert_array_equal(member.sigma, T.sigma[i])
        np.testing.assert_array_equal(member.rotation, T.rotation[i])
        np.testing.assert_array_equal(member.translation, T.translation[i])


def test_a_pose_of_the_plane(solved):
    P = solved["P"]
    c, s = np.cos(0.4), np.sin(0.4)
    np.testing.assert_allclose(P.rotation, [[c, -s], [s, c]], atol=1e-12)
    np.testing.assert_allclose(P.translation, [1, 2], atol=1e-12)
    turn = Rotation.from_rotvec([0, 0, 0.4]).as_quat()
    np.testing.assert_allclose(P.quaternion, np.roll(turn, 1), atol=1e-12)


def test_a_similarity_has_a_scale(solved):
    S = solved["S"]
    np.testing.assert_allclose(S.scale, 2, rtol=1e-9)
    np.testing.assert_allclose(S.rotation, Rotation.from_rotvec([np.pi / 2, 0, 0]).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(S.translation, [1, 0, 0], atol=1e-9)


def test_members_are_in_the_unit_of_the_family(solved):
    assert float(solved["f"][2].value) == pytest.approx(7)
    assert float(solved["f"][1.0].sigma) == pytest.approx(0.1)
    assert solved["f"][2].name == "f[2]"
    assert float(solved["twice"][1].value) == pytest.approx(0.1)


def test_what_there_is_not_is_said(solved):
    with pytest.raises(KeyError, match=r"`T` has no member 'c'; its 2 keys are in `.keys`"):
        solved["T"]["c"]
    with pytest.raises(TypeError, match="`v` is one vector, not a family"):
        solved["v"][0]
    for name, part in (("v", "rotation"), ("far", "quaternion"), ("f", "translation"), ("T", "scale")):
        with pytest.raises(AttributeError, match=f"has no {part}"):
            getattr(solved[name], part)
    with pytest.raises(KeyError, match="there are T, P, S, f, v, far, twice"):
        solved["q"]


def test_the_first_of_several_solves_tells_the_names():
    text = "(problem p (data t (table (g y) (1 2) (2 3))) (for-each g) (unknowns (m)) (observe t (= y m) :sigma 1))"
    assert list(mbm.loads(text).solve()) == ["m"]
