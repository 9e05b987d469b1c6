"""LANGUAGE §6: every function of the vocabulary against NumPy, SciPy and formulas written out here."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Component, leaves
from mbm.language.limits import Limits
from mbm.language.session import open_session, read_program
from mbm.language.values import Array, Call, CameraValue
from mbm.shapes.model import make_model
from mbm.shapes.silhouettes import FUNCTIONS
from mbm.shapes.vocabulary import vocabulary
from mbm.text.reader import read
from mbm.text.types import Source

ROUNDING = 1e-14
"""A few tens of roundings of doubles, on numbers of ordinary size."""

SCALAR = {
    "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "abs": abs, "floor": math.floor, "sin": math.sin,
    "cos": math.cos, "tan": math.tan, "asin": math.asin, "acos": math.acos, "atan": math.atan, "sinh": math.sinh,
    "cosh": math.cosh, "tanh": math.tanh, "asinh": math.asinh, "atanh": math.atanh, "log10": math.log10,
}  # fmt: skip


@pytest.mark.parametrize("name", SCALAR)
@pytest.mark.parametrize("x", [0.125, 0.75])
def test_functions_of_one_number(lisp, name, x):
    expected = SCALAR[name](x)
    assert lisp(f"({name} x)", x=x) == pytest.approx(expected, rel=ROUNDING)
    assert lisp(f"({name} {x})") == pytest.approx(expected, rel=ROUNDING)
    np.testing.assert_allclose(lisp(f"({name} [x {x}])", x=x), [expected] * 2, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(acosh x)", math.acosh(2.5)), ("(hypot x y)", math.hypot(2.5, -1.5)), ("(atan2 y x)", math.atan2(-1.5, 2.5)),
        ("(^ x 3)", 15.625), ("(^ x y)", 2.5**-1.5), ("(min x y 0)", -1.5), ("(max x y 7)", 7.0), ("(sign y)", -1.0),
        ("(mod y 1)", 0.5), ("(mod x -1)", -0.5), ("(floor y)", -2.0), ("(/ x)", 0.4), ("(/ x 2 5)", 0.25),
        ("(- x y 1)", 3.0), ("(- x)", -2.5), ("(* x y 2)", -7.5), ("(+ x)", 2.5), ("(angle x)", 2.5),
    ],
)  # fmt: skip
def test_functions_of_several_numbers(lisp, text, expected):
    assert lisp(text, x=2.5, y=-1.5) == pytest.approx(expected, rel=ROUNDING)
    # known numbers fold while compiling: the same value by another way
    assert lisp(f"(let ((x 2.5) (y -1.5)) {text})") == pytest.approx(expected, rel=ROUNDING)


def test_vectors_and_matrices(lisp):
    rng = np.random.default_rng(1)
    a, b, m, n = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 2))
    numbers = {"a": a, "b": b, "m": m, "n": n}
    for text, expected in {
        "(dot a b)": a @ b,
        "(cross a b)": np.cross(a, b),
        "(norm a)": np.linalg.norm(a),
        "(distance a b)": np.linalg.norm(a - b),
        "(normalize a)": a / np.linalg.norm(a),
        "(addvv a b)": a + b,
        "(addvv 3 a b)": a + b,
        "(subvv 3 a b)": a - b,
        "(mulmv m a)": m @ a,
        "(@ m a)": m @ a,
        "(@ a m)": a @ m,
        "(@ a b)": a @ b,
        "(@ m n)": m @ n,
        "(@ a m n)": a @ m @ n,
        "(transpose n)": n.T,
        "(outer a b)": np.outer(a, b),
        "(det m)": np.linalg.det(m),
        "(identity 3)": np.eye(3),
        "(* 2 a)": 2 * a,
        "(+ m m)": m + m,
        "(* 2 m)": 2 * m,
        "(cross [1 2] [3 5])": -1.0,
    }.items():
        np.testing.assert_allclose(lisp(text, **numbers), expected, rtol=1e-13, atol=1e-15, err_msg=text)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("(dot [1 2] [1 2 3])", "length-clash"), ("(cross [1 2 3 4] [1 2 3 4])", "length-clash"),
        ("(subvv 2 [1 2 3] [1 2 3])", "length-clash"), ("(@ [[1 2]] [[1 2]])", "length-clash"),
        ("(det [[1 2 3]])", "length-clash"), ("(identity 0)", "bad-index"), ("(transpose [1 2])", "wrong-kind"),
        ("(rotate [1 2] [1 2 3])", "length-clash"), ("(trans [1 2] [1 2 3])", "length-clash"),
        ("(pose3 (rot2 1) [0 0 0])", "wrong-kind"), ("(compose (rot2 1) (rot-x 1))", "length-clash"),
        ("(elevation [1 2])", "length-clash"), ("(project 1 [1 2 3])", "wrong-kind"),
        ("(+ (rot-x 1) 1)", "wrong-kind"), ("(rotate (pose2 0 0 1) [1 2])", "wrong-kind"),
    ],
)  # fmt: skip
def test_what_does_not_go_together(lisp, text, code):
    assert lisp.fault(text)[0] == code


ANGLES = (0.3, -1.1, 2.0)


def test_rotations_against_scipy(lisp):
    f, t, p = ANGLES
    expected = Rotation.from_euler("xyz", ANGLES).as_matrix()  # extrinsic x, y, z: Rz Ry Rx
    numbers = {"f": f, "t": t, "p": p}
    for text in ("(euler f t p)", "(compose (rot-z p) (rot-y t) (rot-x f))", "(@ (rot-z p) (@ (rot-y t) (rot-x f)))"):
        np.testing.assert_allclose(lisp(text, **numbers), expected, atol=ROUNDING)
    point = [0.5, -2.0, 3.0]
    np.testing.assert_allclose(lisp("(rotate (f t p) q)", q=point, **numbers), expected @ point, atol=ROUNDING)
    np.testing.assert_allclose(
        lisp("(rotate (inverse (euler f t p)) q)", q=point, **numbers), expected.T @ point, atol=1e-14
    )
    np.testing.assert_allclose(lisp("(transpose (euler f t p))", **numbers), expected.T, atol=ROUNDING)
    np.testing.assert_allclose(lisp("(rot2 f)", f=f), expected_plane(f), atol=ROUNDING)
    np.testing.assert_allclose(lisp("(rotate f [1 2])", f=f), expected_plane(f) @ [1, 2], atol=ROUNDING)


def expected_plane(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("length", [0.0, 1e-12, 1e-6, 0.0499, 0.0501, 1.0, 3.0, 6.0])
def test_axis_angle_is_exact_on_both_sides_of_its_series(lisp, length):
    vector = length * np.array([2.0, -1.0, 2.0]) / 3
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(lisp("(axis-angle v)", v=vector), expected, atol=5e-15)
    text = ",".join(repr(float(v)) for v in vector).replace(",", " ")
    np.testing.assert_allclose(lisp(f"(axis-angle [{text}])"), expected, atol=5e-15)


def test_quaternions_of_any_length(lisp):
    q = np.array([0.4, -0.2, 0.7, 0.1])
    expected = Rotation.from_quat(np.roll(q, -1)).as_matrix()
    for scale in (1.0, 3.0):
        w, x, y, z = scale * q
        np.testing.assert_allclose(lisp("(quaternion w x y z)", w=w, x=x, y=y, z=z), expected, atol=ROUNDING)


def test_look_at_points_x_to_the_target_and_keeps_z_up(lisp):
    eye, target = np.array([1.0, 2.0, 3.0]), np.array([4.0, 0.0, 2.0])
    found = lisp("(look-at e t)", e=eye, t=target)
    forward, left, top = found[:, 0], found[:, 1], found[:, 2]
    np.testing.assert_allclose(forward, (target - eye) / np.linalg.norm(target - eye), atol=ROUNDING)
    np.testing.assert_allclose(found[:, :3].T @ found[:, :3], np.eye(3), atol=ROUNDING)
    assert np.linalg.det(found[:, :3]) == pytest.approx(1.0)
    assert left[2] == pytest.approx(0.0, abs=1e-15)
    assert top[2] > 0
    np.testing.assert_array_equal(found[:, 3], eye)


def homogeneous(rotation, translation):
    size = len(translation)
    return np.block(
        [[np.asarray(rotation), np.reshape(translation, (size, 1))], [np.zeros((1, size)), np.ones((1, 1))]]
    )


def test_poses_combine_as_homogeneous_matrices(lisp):
    first = homogeneous(Rotation.from_euler("xyz", ANGLES).as_matrix(), [1.0, 2.0, 3.0])
    second = homogeneous(Rotation.from_rotvec([0.1, 0.5, -0.3]).as_matrix(), [-1.0, 0.5, 2.0])
    numbers = {
        "a": np.array(ANGLES),
        "t": [1.0, 2.0, 3.0],
        "v": [0.1, 0.5, -0.3],
        "u": [-1.0, 0.5, 2.0],
        "q": [3.0, 1.0, 2.0],
    }
    p, q = "(pose3 (euler (a 1) (a 2) (a 3)) t)", "(pose3 (axis-angle v) u)"
    for text, expected in {
        f"(compose {p} {q})": first @ second,
        f"(inverse {p})": np.linalg.inv(first),
        f"(between {p} {q})": np.linalg.inv(first) @ second,
        f"(compose {p} (inverse {p}))": np.eye(4),
    }.items():
        np.testing.assert_allclose(lisp(text, **numbers), expected[:3], atol=ROUNDING, err_msg=text)
    np.testing.assert_allclose(lisp(f"(transform {p} q)", **numbers), (first @ [3, 1, 2, 1])[:3], atol=ROUNDING)
    np.testing.assert_allclose(lisp(f"(translation {p})", **numbers), [1, 2, 3])
    np.testing.assert_allclose(lisp(f"(rotation {p})", **numbers), first[:3, :3], atol=ROUNDING)
    assert lisp("(heading (pose2 1 2 h))", h=2.5) == pytest.approx(2.5)
    np.testing.assert_allclose(lisp("(transform (pose2 1 2 h) [3 4])", h=2.5), expected_plane(2.5) @ [3, 4] + [1, 2])


def test_scaling(lisp):
    np.testing.assert_allclose(lisp("(scale 2 q)", q=[1.0, 2.0, 3.0]), [2, 4, 6])
    np.testing.assert_allclose(lisp("(scale [1 2 3] q)", q=[1.0, 2.0, 3.0]), [1, 4, 9])


def test_directions(lisp):
    p, q = np.array([1.0, 2.0, 3.0]), np.array([-2.0, 4.0, 5.0])
    assert lisp("(bearing p q)", p=p, q=q) == math.atan2(2, -3)
    assert lisp("(elevation p q)", p=p, q=q) == pytest.approx(math.atan2(2, math.hypot(2, 3)))
    assert lisp("(bearing q)", q=q) == math.atan2(4, -2)


def opencv_projection(point, focal, center, k):
    """OpenCV's documented model: radial k1 k2 k3, tangential p1 p2."""
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, p1, p2, k3 = k
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return [focal[0] * u + center[0], focal[1] * v + center[1]]


def camera(axes, distortion):
    names = ("f1", "f2", "c1", "c2")
    parts = [Component(name) for name in names]
    return CameraValue(
        "cam",
        (parts[0], parts[1]),
        (parts[2], parts[3]),
        tuple(Component(f"k{i}") for i in range(5)) if distortion else (),
        axes,
    )


@pytest.mark.parametrize("distorted", [False, True])
@pytest.mark.parametrize("axes", ["opencv", "paper"])
def test_cameras_with_both_axes(lisp, axes, distorted):
    project = next(f for f in FUNCTIONS if f.name == "project")
    k = (0.1, -0.02, 0.003, -0.004, 0.005)
    values = {"f1": 800.0, "f2": 780.0, "c1": 320.0, "c2": 240.0, **{f"k{i}": v for i, v in enumerate(k)}}
    point = np.array([0.4, -0.3, 2.0]) if axes == "opencv" else np.array([2.0, 0.4, -0.3])
    # x, y, z of the paper (forward, left, up) give X = k0 y/x, Y = k1 z/x: as (y, z, x) in OpenCV's axes
    seen = point if axes == "opencv" else point[[1, 2, 0]]
    expected = opencv_projection(seen, (800, 780), (320, 240), k if distorted else (0,) * 5)
    lisp_point = lisp.value("p", numbers={"p": point})
    call = lisp_call(lisp, project, (camera(axes, distorted), lisp_point))
    found = evaluate(
        call.elements, lambda leaf: values.get(leaf.unknown) if leaf.unknown != "p" else point[leaf.index[0] - 1]
    )
    np.testing.assert_allclose(np.array(found, dtype=float), expected, rtol=ROUNDING)


def lisp_call(lisp, function, arguments) -> Array:
    """Calls a function of the vocabulary with values that no form makes (cameras are made by problems)."""

    words = vocabulary()
    program = read_program(Source("d", ""), Path("d"), sandbox=None, limits=Limits(), reserved=frozenset())
    session = open_session(program, words, make_model, Limits())
    form = read(Source("call", "(project cam p)"))[0]
    return function.call(Call(session.evaluator, form, session.scope, arguments, form.items[1:]))


ANGLE_CASES = {
    "(atan2 x 1)": True, "(bearing [1 2] [x 4])": True, "(angle x)": True, "(+ (angle x) 1)": True,
    "(- 1 (angle x))": True, "(if (> x 0) (angle x) 0)": True, "(let ((a (angle x))) a)": True,
    "(* 2 (angle x))": False,
    "(sin (angle x))": False, "(heading (pose2 0 0 x))": True, "x": False, "(- (angle x))": True, "(+ x 1)": False,
}  # fmt: skip


@pytest.mark.parametrize("text", ANGLE_CASES)
def test_being_an_angle_survives_sums_and_choices_only(lisp, text):
    value = lisp.value(text, numbers={"x": 1.0})
    assert value.angle is ANGLE_CASES[text]
    assert [leaf for leaf in leaves((value,)) if isinstance(leaf, Component)]


def test_angles_survive_in_vectors(lisp):
    value = lisp.value("[(angle x) x]", numbers={"x": 1.0})
    assert [element.angle for element in value.elements] == [True, False]


def test_equality_of_angles_wraps(lisp):
    test = "(if (= (angle a) (angle b)) 1 0)"
    assert lisp(test, a=math.pi, b=-math.pi) == 1.0
    assert lisp(test, a=1.0, b=-1.0) == 0.0
    assert lisp("(if (= a b) 1 0)", a=math.pi, b=-math.pi) == 0.0
