"""Curves: splines against SciPy's, points of projected and moved curves against NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import mbm
from mbm.text.types import MbmError

ROUNDING = {"rtol": 1e-13, "atol": 1e-13}
"""A spline is a few dozen operations on doubles; its system is well conditioned."""

PLANE = np.array([(0, 0), (1, 2), (3, 2.5), (4, 1), (6, 0.5)])
SPACE = np.column_stack([PLANE, [0, 1, -1, 0.5, 2]])


def _forms(points) -> str:
    return " ".join("(" + " ".join(f"{c:.17g}" for c in point) + ")" for point in points)


def _values(*vectors: str, extra: str = "", x=(0.0,), unknowns: str = "(d :init 0)") -> np.ndarray:
    """The numbers of forms that are vectors, at values ``x`` of the unknowns."""
    equations = " ".join(f"(= {'[0 0]' if 'plane' in v else '[0 0 0]'} {v.removeprefix('plane ')})" for v in vectors)
    text = f"(problem p {extra} (unknowns {unknowns}) (observe o {equations} :sigma 1) (constraints (normal d 0 1)))"
    return mbm.loads(text).compile().residuals(list(x))[: sum(2 if "plane" in v else 3 for v in vectors)]


def _reference(points: np.ndarray, *, closed: bool) -> CubicSpline:
    around = np.vstack([points, points[:1]]) if closed else points
    knots = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(around, axis=0), axis=1))])
    return CubicSpline(knots, around, bc_type="periodic" if closed else "natural")


@pytest.mark.parametrize("closed", [False, True], ids=["natural", "closed"])
@pytest.mark.parametrize("points", [PLANE, SPACE, PLANE[:3]], ids=["plane", "space", "three points"])
def test_splines_are_those_of_scipy(points, closed):
    spline = _reference(points, closed=closed)
    places = np.linspace(0, spline.x[-1], 23)
    option = ":closed true" if closed else ""
    kind = "plane " if points.shape[1] == 2 else ""
    found = _values(*(f"{kind}(curve-point (spline ({_forms(points)}) {option}) {s:.17g})" for s in places))
    np.testing.assert_allclose(found.reshape(len(places), -1), spline(places), **ROUNDING)


def test_two_points_make_a_straight_line():
    found = _values(
        "plane (curve-point (spline ((1 2) (4 6))) 2.5)", "plane (curve-point (polyline ((1 2) (4 6))) 2.5)"
    )
    np.testing.assert_allclose(found, [2.5, 4, 2.5, 4], **ROUNDING)


def test_a_polyline_runs_from_point_to_point():
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(SPACE, axis=0), axis=1))])
    places = np.linspace(0, lengths[-1], 17)
    found = _values(*(f"(curve-point (polyline ({_forms(SPACE)})) {s:.17g})" for s in places))
    wanted = np.column_stack([np.interp(places, lengths, column) for column in SPACE.T])
    np.testing.assert_allclose(found.reshape(-1, 3), wanted, **ROUNDING)


@pytest.mark.parametrize("closed", [False, True], ids=["natural", "closed"])
def test_a_spline_through_an_unknown_point_at_an_unknown_place(closed):
    """The values are those of SciPy at other points, and so is the Jacobian: sixth-order differences of SciPy's."""
    option = ":closed true" if closed else ""
    points = f"(0 0) (1 2) (a b) (4 1) {_forms(PLANE[4:])}"
    text = (
        "(problem p (unknowns (a :init 0) (b :init 0) (s :init 0))"
        f"(observe o (= [0 0] (curve-point (spline ({points}) {option}) s)) :sigma 1))"
    )
    compiled = mbm.loads(text).compile()

    def outside(x: np.ndarray) -> np.ndarray:
        moved = PLANE.copy()
        moved[2] = x[:2]
        return _reference(moved, closed=closed)(x[2])

    for at in ([3, 2.5, 5], [2.8, 1.9, 1.1], [3.3, 2.2, 7.3], [3.1, 2, -0.5]):
        x = np.array(at, dtype=float)
        if closed and at[2] < 0:
            continue  # beyond its ends a closed spline of SciPy goes round, and ours goes on
        np.testing.assert_allclose(compiled.residuals(x), outside(x), **ROUNDING)
        step, weights = 1e-2, {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
        columns = []
        for unit in np.eye(3):
            terms = [w * (outside(x + k * step * unit) - outside(x - k * step * unit)) for k, w in weights.items()]
            columns.append(np.sum(terms, axis=0) / step)
        # The differences leave step⁶ of the seventh derivative, 1e-12 times some thousands.
        np.testing.assert_allclose(compiled.jacobian(x), np.column_stack(columns), rtol=1e-8, atol=1e-8)


def test_parametric_curves_take_unknowns():
    curve = "(curve (s 0 6) [(* d (cos s)) (* d (sin s)) (* 0.1 s)])"
    found = _values(f"(curve-point {curve} 0.7)", x=[2.0])
    np.testing.assert_allclose(found, [2 * np.cos(0.7), 2 * np.sin(0.7), 0.07], **ROUNDING)


def test_the_parameter_hides_other_names():
    found = _values("(curve-point (curve (d 0 1) [d 0 0]) 0.25)", x=[9.0])
    np.testing.assert_allclose(found, [0.25, 0, 0], **ROUNDING)


def test_a_curve_of_another_curve():
    inner = "(curve-point (curve (w 0 1) [(* w s) w 0]) 0.5)"
    found = _values(f"(curve-point (curve (s 0 1) {inner}) 3)")
    np.testing.assert_allclose(found, [1.5, 0.5, 0], **ROUNDING)


def test_moved_curves_are_curves():
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a right angle about z
    spline = _reference(SPACE, closed=False)
    form = f"(trans (1 2 3) (rotate (0 0 90deg) (scale (2 1 1) (spline ({_forms(SPACE)})))))"
    found = _values(f"(curve-point {form} 4.2)")
    np.testing.assert_allclose(found, turn @ (spline(4.2) * [2, 1, 1]) + [1, 2, 3], **ROUNDING)
    found = _values(f"plane (curve-point (scale 2 (rotate 90deg (spline ({_forms(PLANE)})))) 4.2)")
    np.testing.assert_allclose(found, 2 * turn[:2, :2] @ _reference(PLANE, closed=False)(4.2), **ROUNDING)


def test_projected_curves_are_curves_of_the_image():
    camera = "(camera cam :focal (500 510) :center (320 240) :distortion (0.1))"
    found = _values(f"plane (curve-point (project cam (trans (0 0 5) (spline ({_forms(SPACE)})))) 4.2)", extra=camera)
    x, y, z = _reference(SPACE, closed=False)(4.2)
    x, y = x / (z + 5), y / (z + 5)
    radial = 1 + 0.1 * (x * x + y * y)
    np.testing.assert_allclose(found, [320 + 500 * x * radial, 240 + 510 * y * radial], **ROUNDING)


ROAD = """
(defmodel road (w)
  (spline ((0 0 0) (10 1 0) (20 5 0)))
  (left (trans (0 w 0) (polyline ((0 0) (10 1) (20 5)))))
  (both (curve (s 0 1) (s w 0)) (trans (0 1 0) (rotate (0 0 90deg) (curve (s 0 2) [s 0])))))
"""


@pytest.mark.parametrize(
    ("path", "at", "wanted"),
    [
        ("curve/1", 0, (0, 0, 0)),
        ("left/curve/1", np.sqrt(101) / 2, (5, 3.5, 0)),
        ("both/curve/1", 0.25, (0.25, 3, 0)),
        ("both/curve/2", 2, (0, 3, 0)),
    ],
)
def test_curves_are_features_by_their_number(path, at, wanted):
    form = f'(curve-point (feature (road d) "{path}") {at})'
    text = f"{ROAD} (problem p (unknowns (d :init 0)) (observe (= [0 0 0] {form}) :sigma 1))"
    np.testing.assert_allclose(mbm.loads(text).compile().residuals([3.0]), wanted, **ROUNDING)


def test_points_come_from_lists_vectors_and_names():
    lists = ["((0 0 0) (3 4 0))", "[[0 0 0] [3 4 0]]", "(list [0 0 0] (list 3 4 0))", "(p q)", "rows"]
    for points in lists:
        form = f"(let ((p [0 0 0]) (q [3 4 0]) (rows [[0 0 0] [3 4 0]])) (curve-point (polyline {points}) 2.5))"
        text = f"(problem p (unknowns (d :init 0)) (observe (= [d d d] {form}) :sigma 1))"
        np.testing.assert_allclose(mbm.loads(text).compile().residuals([0]), [1.5, 2, 0], **ROUNDING)


FAULTS = [
    ("bad-form", "(curve s [s 0])", "(curve s [s 0])", "(curve (s first last)"),
    ("bad-form", "(curve (1 0 1) [1 0])", "1", "a name"),
    ("length-clash", "(curve (s 0 1) [s 0 0 0])", "[s 0 0 0]", "2 or 3"),
    ("wrong-kind", "(curve (s 0 1) s)", "s", "a vector"),
    ("bad-form", "(polyline ((0 0)))", "((0 0))", "at least 2"),
    ("bad-form", "(spline ((0 0) (1 1)) :closed true)", "((0 0) (1 1))", "at least 3"),
    ("bad-form", "(spline ((0 0) (1 1)) :open true)", ":open", ":closed"),
    ("wrong-kind", "(spline ((0 0) (1 1) (1 0)) :closed 1)", "1", "true or false"),
    ("length-clash", "(polyline ((0 0) (1 1 1)))", "(1 1 1)", "as the first"),
    ("bad-form", "(spline ((0 0) (1 1) (1 1)))", "(1 1)", "points 2 and 3"),
    ("bad-form", "(spline ((0 0) (1 1) (0 0)) :closed true)", "(0 0)", "points 3 and 1"),
    ("wrong-kind", "(curve-point [1 2] 3)", "[1 2]", "a curve"),
    ("wrong-kind", "(perse (polyline ((0 0) (1 1))))", "(polyline ((0 0) (1 1)))", "a curve of space"),
    ("length-clash", "(trans (1 2 3) (polyline ((0 0) (1 1))))", None, "coordinates"),
    ("wrong-kind", "(norm (polyline ((0 0) (1 1))))", "(polyline ((0 0) (1 1)))", "a curve of the plane"),
    ("wrong-kind", "(+ 1 (polyline ((0 0 0) (1 1 0))))", "(polyline ((0 0 0) (1 1 0)))", "a curve"),
    ("not-static", "(curve (s 0 1) [(sum (i 1 s) 1) 0])", "s", "this"),
    ("list-too-long", "(polyline (map (lambda (i) (list i 0)) (range 1 1000000)))", None, "100000"),
    ("too-many-steps", "(spline (map (lambda (i) (list i 0)) (range 1 10000)))", None, "64000"),
]


@pytest.mark.parametrize(("code", "form", "blamed", "words"), FAULTS, ids=[f"{c}-{f[:40]}" for c, f, _, _ in FAULTS])
def test_faults(code, form, blamed, words):
    text = f"(problem p (unknowns (d :init 0)) (observe (= d {form}) :sigma 1))"
    with pytest.raises(MbmError) as caught:
        mbm.loads(text).compile()
    fault = caught.value.diagnostics[0]
    assert fault.code.name == code, fault.message
    assert blamed in (None, fault.place.text)
    assert words in f"{fault.message} | {fault.hint}"
