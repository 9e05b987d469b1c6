"""Directions, rotations, poses and similarities as unknowns, against closed forms and differences of their own."""

import json

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

import mbm

SIGMA = 0.01
EXACT = 1e-9
"""The iteration ends where the next step is 1e-10 standard deviations; rounding of a few operations is far below."""


def table(columns, array):
    rows = " ".join("(" + " ".join(f"{v:.17g}" for v in row) + ")" for row in array)
    return f"(table ({columns}) {rows})"


def rotation_of(value):
    w, x, y, z = value[:4]
    return Rotation.from_quat([x, y, z, w])


def kabsch(source, target):
    """Rotation and translation of least squares (Umeyama 1991, without scale)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    r = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return r, target.mean(axis=0) - r @ source.mean(axis=0)


@pytest.fixture
def pairs():
    random = np.random.default_rng(11)
    source = random.normal(size=(8, 3))
    turn = Rotation.from_rotvec([2.0, -1.5, 1.0])
    return source, turn.apply(source) + [5, -3, 2] + SIGMA * random.normal(size=(8, 3))


@pytest.mark.parametrize("start", ["(rot-x 0)", "(euler 3 1 -2)", "(rot-z 100deg)"])
def test_a_pose_aligns_points_as_the_closed_form_does(pairs, start):
    source, target = pairs
    result = mbm.loads(f"""(problem p (data d {table("x y z u v w", np.hstack(pairs))})
      (unknowns (T (pose 3) :init (pose3 {start} [0 0 0]) :unit m))
      (observe d (= [u v w] (transform T [x y z])) :sigma {SIGMA}))""").solve()
    r, t = kabsch(source, target)
    found = result["T"].value
    np.testing.assert_allclose(rotation_of(found).as_matrix(), r, atol=EXACT)
    np.testing.assert_allclose(found[4:], t, atol=EXACT)
    # Rows of the Jacobian by a step (omega, v): R [-x]_x, I
    rows = [np.hstack([-r @ np.cross(np.eye(3), x), np.eye(3)]) for x in source]
    jacobian = np.vstack(rows) / SIGMA
    wanted = np.linalg.inv(jacobian.T @ jacobian)
    assert result.covariance.names == ("T.rot[1]", "T.rot[2]", "T.rot[3]", "T.trans[1]", "T.trans[2]", "T.trans[3]")
    np.testing.assert_allclose(result.covariance.matrix, wanted, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(result["T"].sigma, np.sqrt(np.diag(wanted)), rtol=1e-7)


def test_a_similarity_of_the_plane_is_complex_least_squares():
    random = np.random.default_rng(12)
    z = random.normal(size=6) + 1j * random.normal(size=6)
    w = (0.3 - 1.7j) * z + (4 + 2j) + 0.01 * (random.normal(size=6) + 1j * random.normal(size=6))
    rows = np.column_stack([z.real, z.imag, w.real, w.imag])
    result = mbm.loads(f"""(problem p (data d {table("x y u v", rows)})
      (unknowns (S (similarity 2) :init (pose2 0 0 0)))
      (observe d (= [u v] (transform S [x y])) :sigma 0.01))""").solve()
    design = np.column_stack([z, np.ones(6)])
    (a, b), *_ = np.linalg.lstsq(design, w, rcond=None)
    angle, tx, ty, scale = result["S"].value
    assert scale == pytest.approx(abs(a), rel=EXACT)
    assert np.exp(1j * angle) == pytest.approx(a / abs(a), abs=EXACT)
    assert complex(tx, ty) == pytest.approx(b, abs=EXACT)
    # d(angle) and d(log c) are the parts of d(a)/a; the four real unknowns have unit weights.
    centred = z - z.mean()
    sigma = 0.01 / (abs(a) * np.sqrt((np.abs(centred) ** 2).sum()))
    np.testing.assert_allclose(result["S"].sigma[[0, 3]], sigma, rtol=1e-7)
    document = json.loads(result.to_json())["solves"][0]
    assert document["covariance"]["names"] == ["S.rot[1]", "S.trans[1]", "S.trans[2]", "S.logscale"]
    value = document["estimates"]["S"]["value"]
    assert value["scale"] == pytest.approx(abs(a), rel=EXACT)
    np.testing.assert_allclose(value["translation"], [b.real, b.imag], atol=EXACT)


def test_two_measured_rotations_meet_on_their_geodesic():
    first, second = Rotation.from_rotvec([0.4, 1.1, -0.3]), Rotation.from_rotvec([-0.5, 0.2, 0.9])
    texts = []
    for each in (first, second):
        x, y, z, w = each.as_quat()
        texts.append(f"(quaternion {w:.17g} {x:.17g} {y:.17g} {z:.17g})")
    result = mbm.loads(f"""(problem p (unknowns (R (rotation 3) :init (rot-x 0)))
      (observe a (= {texts[0]} R) :sigma 1deg) (observe b (= {texts[1]} R) :sigma 2deg))""").solve()
    # Weights 4 : 1 along the one-parameter group between them.
    wanted = first * Rotation.from_rotvec((first.inv() * second).as_rotvec() / 5)
    np.testing.assert_allclose(rotation_of(result["R"].value).as_matrix(), wanted.as_matrix(), atol=EXACT)


def test_a_prior_on_a_pose_counts_rotation_first():
    result = mbm.loads("""(problem p
      (unknowns (T (pose 3) :init (pose3 (rot-z 30deg) [1 2 3]) :sigma [0.1 0.2 0.3 1 2 3]))
      (observe (= [1.5 2 3] (translation T)) :sigma 1))""").solve()
    sigma = result["T"].sigma
    np.testing.assert_allclose(sigma[:3], [0.1, 0.2, 0.3], rtol=1e-9)
    # The translation's prior stands in the measured frame, turned by 30 degrees, before 1 per axis of the world.
    r = Rotation.from_rotvec([0, 0, np.pi / 6]).as_matrix()
    information = r @ np.diag([1, 1 / 4, 1 / 9]) @ r.T + np.eye(3)
    np.testing.assert_allclose(sigma[3:], np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-8)


def test_a_direction_is_the_mean_of_directions():
    """Of unit vectors with equal weights the least squares direction is their sum, made a unit vector."""
    random = np.random.default_rng(13)
    vectors = np.array([0.2, -0.6, 0.77]) + 0.05 * random.normal(size=(9, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    result = mbm.loads(f"""(problem p (data d {table("x y z", vectors)})
      (unknowns (n direction :init [1 0 0])) (observe d (= [x y z] n) :sigma 0.05))""").solve()
    wanted = vectors.sum(axis=0)
    np.testing.assert_allclose(result["n"].value, wanted / np.linalg.norm(wanted), atol=EXACT)
    # Information per axis: the Hessian of -sum(m·n) in the tangent plane is |sum m|; Gauss-Newton's is the count.
    np.testing.assert_allclose(result["n"].sigma, 0.05 / 3, rtol=1e-6)


def test_fixed_coordinates_and_families_of_poses():
    text = """(problem p
      (data nodes (table (id) (1) (2) (3)) :key id)
      (data edges (table (from to dx dy da) (1 2 1 0 0.5) (2 3 1 0.2 0.4) (3 1 -1.9 -0.6 -1)))
      (unknowns (T (pose 2) :per nodes :init (pose2 0 0 (* 0.1 id)) :fixed (= id 1)))
      (observe edges (= (pose2 dx dy da) (between (T from) (T to))) :sigma [0.001 10 10]))"""
    result = mbm.loads(text).solve()
    found = result["T"]
    np.testing.assert_allclose(found.value[0], [0.1, 0, 0], atol=1e-15)
    assert (found.sigma[0] == 0).all()
    assert (found.sigma[1:] > 0).all()
    # The angles close to 0.1 each, as three equal measurements of a sum that should be zero do.
    np.testing.assert_allclose(np.diff(found.value[:, 0]), [0.5 + 0.1 / 3, 0.4 + 0.1 / 3], atol=1e-6)


def test_bounds_hold_the_translation_of_a_pose():
    result = mbm.loads("""(problem p
      (unknowns (T (pose 2) :init (pose2 0 0 0) :in ([-1 -1] [1 1])))
      (observe (= (pose2 3 0.5 1) T) :sigma 0.1))""").solve()
    angle, x, y = result["T"].value
    assert x == 1.0
    # With x held, the others minimise the rest of the residuals; the rotation is free of them.
    assert angle == pytest.approx(1.0, abs=1e-9)
    assert y == pytest.approx(0.5, abs=1e-8)
    assert result.solves[0].estimates[0].at_bound.tolist() == [False, True, False]


def test_a_result_is_where_the_next_solve_starts(pairs):
    text = f"""(problem p (data d {table("x y z u v w", np.hstack(pairs))})
      (unknowns (T (pose 3) :init (pose3 (rot-x 0) [0 0 0]) :unit cm))
      (observe d (= [u v w] (transform T [x y z])) :sigma {SIGMA}))"""
    problem = mbm.loads(text)
    first = problem.solve()
    again = problem.solve(init=json.loads(first.to_json()))
    assert again.solves[0].iterations <= 1
    np.testing.assert_allclose(again["T"].value, first["T"].value, rtol=1e-12, atol=1e-12)
    by_name = problem.solve(init={"T": {"quaternion": [1, 0, 0, 0], "translation": [0, 0, 0]}})
    np.testing.assert_allclose(by_name["T"].value, first["T"].value, rtol=1e-7, atol=1e-9)


def test_derived_poses_carry_their_covariance_along(pairs):
    text = f"""(problem p (data d {table("x y z u v w", np.hstack(pairs))})
      (unknowns (T (pose 3) :init (pose3 (rot-x 1) [0 0 0])))
      (observe d (= [u v w] (transform T [x y z])) :sigma {SIGMA})
      (derive (back (inverse T)) (turn (rotation T))))"""
    result = mbm.loads(text).solve()
    value, matrix = result["T"].value, result.covariance.matrix
    r, t = rotation_of(value).as_matrix(), value[4:]
    np.testing.assert_allclose(rotation_of(result["back"].value).as_matrix(), r.T, atol=1e-12)
    np.testing.assert_allclose(result["back"].value[4:], -r.T @ t, atol=1e-12)
    columns = []
    for j in range(6):
        sides = []
        for sign in (1, -1):
            step = np.zeros(6)
            step[j] = sign * 1e-6
            turned = r @ expm(np.cross(np.eye(3), step[:3]))
            moved = -turned.T @ (t + step[3:])
            w = logm(r @ turned.T).real
            sides.append(np.concatenate([[w[2, 1], w[0, 2], w[1, 0]], moved]))
        columns.append((sides[0] - sides[1]) / 2e-6)
    slopes = np.array(columns).T
    wanted = np.sqrt(np.diag(slopes @ matrix @ slopes.T))
    np.testing.assert_allclose(result["back"].sigma, wanted, rtol=1e-5)
    np.testing.assert_allclose(result["turn"].sigma, np.sqrt(np.diag(matrix))[:3], rtol=1e-7)


def test_tangent_coordinates_about_the_start(pairs):
    """`residuals` and `jacobian` of a compiled problem take steps of the whole way, not only small ones."""
    text = f"""(problem p (data d {table("x y z u v w", np.hstack(pairs))})
      (unknowns (T (pose 3) :init (pose3 (rot-x 1) [1 2 3])) (n direction :init [1 1 1]))
      (observe d (= [u v w] (transform T (+ n [x y z]))) :sigma 1))"""
    compiled = mbm.loads(text).compile()
    x = np.array([1.0, -2.0, 0.5, 3.0, -1.0, 2.0, 0.8, -0.4])
    jacobian = compiled.jacobian(x)
    for j in range(8):
        step = np.zeros(8)
        step[j] = 1e-6
        slope = (compiled.residuals(x + step) - compiled.residuals(x - step)) / 2e-6
        np.testing.assert_allclose(jacobian[:, j], slope, atol=1e-7)


def test_the_covariance_of_a_plane_direction_does_not_depend_on_the_sign_of_a_rounding():
    """The tangent coordinates' own axes are free; the eigenvalues are those about any axes."""
    across = np.array([[-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    noise = np.array([[1e-4, 0.0, 5e-5], [0.0, 1e-4, 3e-5], [5e-5, 3e-5, 1e-4]])
    wanted = np.linalg.inv(across @ np.linalg.inv(noise) @ across.T)
    above, below = (
        mbm.loads(f"""(problem p (unknowns (d direction :init [0.6 0.8 {z}]))
          (observe (= [0.6 0.8 {z}] d) :covariance [[1e-4 0 5e-5] [0 1e-4 3e-5] [5e-5 3e-5 1e-4]]))""").solve()
        for z in ("1e-12", "-1e-12")
    )
    np.testing.assert_allclose(below.covariance.matrix, above.covariance.matrix, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.eigvalsh(above.covariance.matrix), np.linalg.eigvalsh(wanted), rtol=1e-9)
