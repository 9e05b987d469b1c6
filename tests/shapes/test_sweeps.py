"""What is swept: features by number, volumes by the divergence theorem, frames along paths, bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbm
from mbm.expression.algebra import number
from mbm.expression.evaluate import evaluate
from mbm.language.limits import Limits
from mbm.shapes.types import Surface, SweptSide
from tests.shapes.bodies import DIFFERENCE, area, euler_characteristic, is_closed, pieces, vertexes, volume

MODELS = """
(defmodel polygon (n r)
  (vertexes (for (i 1 n) (i [(* r (cos (/ (* 2 pi (- i 1)) n))) (* r (sin (/ (* 2 pi (- i 1)) n))) 0])))
  (lines (for (i 1 n) (i [i (+ 1 (mod i n))])))
  (planes (1 (range 1 n))))
(defmodel angle (a b t)
  (vertexes (1 (0 0 0)) (2 (a 0 0)) (3 (a t 0)) (4 (t t 0)) (5 (t b 0)) (6 (0 b 0)))
  (lines (for (i 1 6) (i [i (+ 1 (mod i 6))])))
  (planes (1 (range 1 6))))
(defmodel window ()
  (vertexes (1 (0 0 0)) (2 (2 0 0)) (3 (2 1 0)) (4 (0 1 0)) (5 (4 0 0)) (6 (4 1 0)))
  (lines (1 (1 2)) (2 (2 3)) (3 (3 4)) (4 (4 1)) (5 (2 5)) (6 (5 6)) (7 (6 3)))
  (planes (1 (1 2 3 4)) (2 (2 5 6 3))))
(defmodel bare () (vertexes (1 (0 0 0)) (2 (2 0 0)) (3 (2 1 0)) (4 (0 1 0))) (planes (1 (1 2 3 4))))
(defmodel half-bare () (vertexes (1 (0 0 0)) (2 (2 0 0)) (3 (2 1 0)) (4 (0 1 0)))
  (lines (1 (2 3))) (planes (1 (1 2 3 4)) (2 (1 4 3 2))))
"""
HEPTAGON = 7 / 2 * 0.2**2 * np.sin(2 * np.pi / 7)
ROUNDING = 1e-12
QUADRATURE = 1e-9  # Gauss' rule and the differences of tests/shapes/bodies.py on smooth sides of size 1


def _content(opened, form: str):
    return opened(MODELS).value(form).content


@pytest.mark.parametrize(
    ("sweep", "model"),
    [
        ("(trans (0 0 -3) (extrude (rectangular 1 2) 6))", "(box 2 4 6)"),
        ("(extrude (polygon 5 2) 3)", "(prism 5 2 3)"),
        ("(sweep (polygon 5 2) (polyline ((0 0 0) (0 0 3))))", "(prism 5 2 3)"),
        ("(sweep (rectangular 1 2) (curve (s -3 3) [0 0 s]))", "(box 2 4 6)"),
    ],
)
def test_prisms_have_the_numbers_of_the_library(opened, sweep, model):
    model_of = opened(MODELS)
    sides = 4 if "box" in model else 5
    for kind, count in (("vertex", 2 * sides), ("line", 3 * sides), ("plane", 2 + sides)):
        for n in range(1, count + 1):
            found, wanted = (model_of.numbers(f"({kind} {form} {n})") for form in (sweep, model))
            if kind == "plane":  # where the round of corners begins does not matter
                found = np.roll(found, -int(np.argmin(np.linalg.norm(found - wanted[0], axis=1))), axis=0)
            np.testing.assert_allclose(found, wanted, atol=ROUNDING)
        assert model_of.fault(f"({kind} {sweep} {count + 1})").code.name == "unknown-feature"


@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        ("(extrude (rectangular 1 2) 3)", 2 * 4 * 3),
        ("(extrude (angle 3 2 0.5) 4)", (3 * 2 - 2.5 * 1.5) * 4),
        ("(extrude (bare) 3)", 2 * 3),
        ("(extrude (half-bare) 3)", 2 * 3),
        ("(extrude (window) 2)", 8),  # two faces with a line between, over which there is no side
        # Pappus: the middle of the profile runs along the path; mitred corners give and take alike
        ("(sweep (rectangular 0.1 0.2) (polyline ((0 0) (3 0) (3 4) (7 7))))", 0.08 * 12),
        ("(sweep (rectangular 0.1 0.2) (polyline ((0 0 0) (3 0 0) (3 4 0) (3 4 5) (0 4 9))))", 0.08 * 17),
        ("(sweep (rectangular 0.1 0.2) (polyline ((0 0) (3 0) (3 4) (0 0))))", 0.08 * 12),
        (
            "(sweep (polygon 7 0.2) (polyline ((0 0 0) (0 0 2) (1 0 3))))",
            3.5 * 0.04 * np.sin(2 * np.pi / 7) * (2 + 2**0.5),
        ),
    ],
)
def test_bodies_with_flat_sides(opened, form, wanted):
    content = _content(opened, form)
    (surface,) = pieces(content)
    assert volume(content) == pytest.approx(wanted, rel=ROUNDING)
    if "window" not in form:
        assert is_closed(surface)
        assert euler_characteristic(surface) == (0 if "(0 0))))" in form else 2)


@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        ("(revolve (trans (3 1 0) (rectangular 0.5 1)) 360deg)", 2 * np.pi * 3 * 2),
        ("(revolve (trans (3 1 0) (rectangular 0.5 1)) 90deg)", np.pi / 2 * 3 * 2),
        ("(revolve (trans (2 0 0) (angle 3 2 0.5)) (* 2 pi))", None),
        ("(revolve (trans (3 0 0) (disk 1)) 360deg)", 2 * np.pi**2 * 3),
        ("(sweep (rectangular 0.2 0.1) (curve (s 0 1) [(* 3 (cos s)) (* 3 (sin s))]))", 3 * 0.08),
        ("(sweep (rectangular 0.2 0.1) (curve (s 0 1) [(* 3 (cos s)) (* 3 (sin s)) (* 4 s)]))", 5 * 0.08),
    ],
)
def test_bodies_with_smooth_sides(opened, form, wanted):
    if wanted is None:  # the angle is a rectangle less another
        wanted = 2 * np.pi * (3 * 2 * 3.5 - 2.5 * 1.5 * 3.75)
    assert volume(_content(opened, form)) == pytest.approx(wanted, rel=QUADRATURE)


@pytest.mark.parametrize(
    ("form", "wanted"),
    [
        ("(extrude (disk 2) 3)", 12 * np.pi),
        ("(sweep (disk 0.5) (polyline ((0 0) (3 0) (3 4))))", 7 * np.pi),
        ("(sweep (disk 0.5) (curve (s 0 1) [(* 3 (cos s)) (* 3 (sin s)) (* 4 s)]))", 5 * np.pi),
        ("(revolve (polyline ((1 0) (2 3))) 360deg)", np.pi * 3 * np.sqrt(10)),
        ("(revolve (trans (3 0 0) (disk 1)) 180deg)", 6 * np.pi**2),
    ],
)
def test_areas_of_smooth_sides(opened, form, wanted):
    """Guldin: the length of the profile's outline times the way of its middle, which a mitre does not change."""
    tolerance = 1e-3 if "polyline ((0 0)" in form else QUADRATURE
    assert area(_content(opened, form)) == pytest.approx(wanted, rel=tolerance)


def test_a_closed_spline_makes_a_ring(opened):
    form = "(sweep (disk 0.1) (spline ((1 0) (0 1) (-1 0) (0 -1)) :closed true))"
    length = _length(opened().value("(spline ((1 0) (0 1) (-1 0) (0 -1)) :closed true)"))
    assert volume(_content(opened, form)) == pytest.approx(np.pi * 0.01 * length, rel=1e-6)
    surface, *_ = pieces(_content(opened, form))
    assert (len(surface.vertexes), len(surface.planes)) == (4, 0)


def _length(curve) -> float:
    """The length of a curve by a fine polygon."""
    last = float(evaluate((curve.last,), dict)[0])
    points = np.array([evaluate(curve.at(number(float(s))), dict) for s in np.linspace(0, last, 4001)], dtype=float)
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def test_features_of_revolved_bodies(opened):
    model = opened(MODELS)
    full, part = (
        "(revolve (trans (3 1 0) (rectangular 1 1)) 360deg)",
        "(revolve (trans (3 1 0) (rectangular 1 1)) 30deg)",
    )
    corners = np.array([(4, 2), (2, 2), (2, 0), (4, 0)], dtype=float)
    for j, (c, s) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
        for n, (x, y) in enumerate(corners, 1):
            np.testing.assert_allclose(model.numbers(f"(vertex {full} {4 * j + n})"), [x * c, x * s, y], atol=ROUNDING)
    np.testing.assert_allclose(
        model.numbers(f"(vertex {part} 5)"), [4 * np.cos(np.pi / 6), 4 * np.sin(np.pi / 6), 2], atol=ROUNDING
    )
    way = model.numbers(f'(curve-point (feature {part} "curve/1") 20deg)')
    np.testing.assert_allclose(way, [4 * np.cos(np.pi / 9), 4 * np.sin(np.pi / 9), 2], atol=ROUNDING)
    for n, wanted in ((1, (0, -1, 0)), (2, (-np.sin(np.pi / 6), np.cos(np.pi / 6), 0))):
        a, b, c, _ = model.numbers(f"(plane {part} {n})")
        normal = np.cross(b - a, c - a)
        np.testing.assert_allclose(normal / np.linalg.norm(normal), wanted, atol=ROUNDING)
    assert model.fault(f"(plane {full} 1)").code.name == "unknown-feature"


def test_smooth_sides_stay_what_they_are(opened):
    kinds = [type(piece) for piece in pieces(_content(opened, "(extrude (disk 1) 2)"))]
    assert kinds == [Surface, SweptSide]


def test_frames_of_a_plane_path_stand_upright(opened):
    """The profile's x to the left, its y up."""
    model = opened(MODELS)
    path = "(curve (s 0 2) [(* 3 (sin s)) (* 3 (- 1 (cos s)))])"
    ends = [model.numbers(f"(vertex (sweep (rectangular 0.1 0.2) {path}) {n})") for n in (1, 5)]
    np.testing.assert_allclose(ends[0], [0, 0.1, 0.2], atol=ROUNDING)
    left = np.array([-np.sin(2), np.cos(2), 0])
    np.testing.assert_allclose(
        ends[1], np.array([3 * np.sin(2), 3 * (1 - np.cos(2)), 0]) + 0.1 * left + [0, 0, 0.2], atol=ROUNDING
    )


def test_frames_of_a_path_in_space_are_parallel_transported(opened):
    """Against the differential equation x' = −(x·t') t; the stretches leave a twist of 1/16² of that of the whole."""
    model = opened(MODELS)
    path = "(curve (s 0 2) [(* 3 (cos s)) (* 3 (sin s)) (* 2 (sin s))])"

    def tangent(s):
        d = np.array([-3 * np.sin(s), 3 * np.cos(s), 2 * np.cos(s)])
        return d / np.linalg.norm(d)

    def turning(s, x):
        return -np.dot(x, (tangent(s + 1e-5) - tangent(s - 1e-5)) / 2e-5) * tangent(s)

    start = np.cross([0, 0, 1], tangent(0))
    start = start / np.linalg.norm(start)
    left = solve_ivp(turning, (0, 2), start, rtol=1e-10, atol=1e-12).y[:, -1]
    middle = np.array([3 * np.cos(2), 3 * np.sin(2), 2 * np.sin(2)])
    corner = model.numbers(f"(vertex (sweep (rectangular 1 0) {path}) 5)")
    np.testing.assert_allclose(corner - middle, left, atol=2e-3)
    assert np.linalg.norm(corner - middle) == pytest.approx(1, rel=ROUNDING)
    assert np.dot(corner - middle, tangent(2)) == pytest.approx(0, abs=1e-9)


def test_unknowns_inside_sweeps_are_differentiated_and_found():
    """A bent bar: its section, radius and angle from its corners."""
    bar = "(sweep (rectangular (/ w 2) (/ h 2)) (curve (s 0 a) [(* r (sin s)) (* r (- 1 (cos s))) 0]))"
    w, h, r, a = 0.3, 0.2, 2.0, 1.1

    def corner(n):
        x, y = [(1, 1), (-1, 1), (-1, -1), (1, -1)][(n - 1) % 4]
        s = a if n > 4 else 0.0
        return (
            np.array([r * np.sin(s), r * (1 - np.cos(s)), 0])
            + x * w / 2 * np.array([-np.sin(s), np.cos(s), 0])
            + np.array([0, 0, y * h / 2])
        )

    rows = " ".join("(" + " ".join(f"{v:.17g}" for v in (n, *corner(n))) + ")" for n in range(1, 9))
    text = f"""(problem p (data d (table (n x y z) {rows}))
      (unknowns (w :init 0.5) (h :init 0.5) (r :init 1.5) (a :init 0.8))
      (observe d (= [x y z] (vertex {bar} n)) :sigma 1mm))"""
    compiled = mbm.loads(text).compile()
    solve = compiled.solve().solves[0]
    found = [estimate.value for estimate in solve.estimates]
    np.testing.assert_allclose(np.ravel(found), [w, h, r, a], rtol=1e-9)
    x, step = np.array([0.01, -0.02, 0.03, 0.02]), 1e-3

    def slope(way: np.ndarray) -> np.ndarray:
        terms = [c * (compiled.residuals(x + k * way) - compiled.residuals(x - k * way)) for k, c in DIFFERENCE.items()]
        return np.sum(terms, axis=0) / step

    differences = np.column_stack([slope(step * way) for way in np.eye(4)])
    np.testing.assert_allclose(compiled.jacobian(x), differences, rtol=1e-8, atol=1e-6)  # of some hundreds per unit


@pytest.mark.parametrize(
    ("code", "form"),
    [
        ("list-too-long", "(sweep (polygon 1000 1) (polyline (map (lambda (i) (list i 0)) (range 1 1000))))"),
        ("too-many-steps", "(extrude (polygon 20000 1) 1)"),
        ("too-many-steps", "(sweep (polygon 200 1) (polyline (map (lambda (i) (list i 0)) (range 1 200))))"),
    ],
)
def test_sweeps_are_bounded(opened, code, form):
    fault = opened(MODELS).fault(form)
    assert fault.code.name == code
    assert str(Limits().list_length if code == "list-too-long" else Limits().steps) in fault.message


def test_vertexes_do_not_move_when_a_profile_is_numbered_with_gaps(opened):
    text = """(defmodel gap () (vertexes (2 (0 0 0)) (5 (1 0 0)) (7 (0 1 0))) (lines (3 (2 5)) (4 (5 7)) (6 (7 2)))
      (planes (4 (2 5 7))))"""
    surface, *_ = pieces(opened(text).value("(extrude (gap) 1)").content)
    np.testing.assert_allclose(list(vertexes(surface)), [2, 5, 7, 9, 12, 14])
    first = {3: (2, 5), 4: (5, 7), 6: (7, 2)}
    assert surface.lines == first | {9: (9, 12), 10: (12, 14), 12: (14, 9), 14: (2, 9), 17: (5, 12), 19: (7, 14)}
    ends = {1: (2, 7, 5), 2: (9, 12, 14)}
    assert surface.planes == ends | {5: (2, 5, 12, 9), 6: (5, 7, 14, 12), 8: (7, 2, 9, 14)}
