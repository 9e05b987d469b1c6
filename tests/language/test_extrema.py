"""Where coordinates of curves are stationary: against the roots that SciPy finds, and against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import mbm
from mbm.text.types import MbmError
from tests.language.curves_outside import FINE, forms, image, knots, slopes, spline

ROUNDING = {"rtol": 1e-12, "atol": 1e-12}
"""Some dozen operations on doubles: Newton's method has converged."""

LOOPS = np.array([(0, 0), (1, 2), (0.5, 3), (2, 2.5), (1.5, 0), (3, 1), (2.5, 3), (4, 2)])
RING = np.array([(0, 0), (3, -1), (5, 1), (3, 4), (1, 2.5)])


def stationary(curve, ends: tuple[float, float], coordinate: int) -> np.ndarray:
    """The points (n, 2) where the differences of a coordinate vanish, in order."""
    step = 1e-4 * (ends[1] - ends[0])
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}

    def slope(s):
        terms = [w * (curve(s + k * step) - curve(s - k * step)) for k, w in weights.items()]
        return np.sum(terms, axis=0)[..., coordinate]

    places = np.linspace(ends[0] + 5 * step, ends[1] - 5 * step, FINE)
    signs = slope(places) < 0
    roots = [brentq(slope, *places[i : i + 2], xtol=1e-14) for i in np.flatnonzero(signs[:-1] != signs[1:])]
    return curve(np.array(roots))


def compiled(form: str, count: int, *, unknowns: str = "(d :init 0)", extra: str = ""):
    numbers = " ".join(f"({n + 1})" for n in range(count))
    text = (
        f"(problem p {extra} (data t (table (n) {numbers})) (unknowns {unknowns})"
        f"(observe t (= [0 0] (({form}) n)) :sigma 1))"
    )
    return mbm.loads(text).compile()


@pytest.mark.parametrize(("points", "closed"), [(LOOPS, False), (RING, True)])
@pytest.mark.parametrize("coordinate", [1, 2])
def test_of_splines(points, closed, coordinate):
    curve = spline(points, closed=closed)
    wanted = curve(np.sort(curve.derivative().roots(extrapolate=False)[coordinate - 1]))
    assert len(wanted) > 1
    option = ":closed true" if closed else ""
    once = compiled(f"extrema (spline ({forms(points)}) {option}) {coordinate}", len(wanted))
    np.testing.assert_allclose(once.residuals([0.0]).reshape(-1, 2), wanted, **ROUNDING)


@pytest.mark.parametrize("coordinate", [1, 2])
def test_derivatives_by_a_point_of_a_spline(coordinate):
    written = f"{forms(LOOPS[:3])} (a b) {forms(LOOPS[4:])}"

    def outside(x):
        moved = LOOPS.astype(float).copy()
        moved[3] = x
        curve = spline(moved)
        return curve(np.sort(curve.derivative().roots(extrapolate=False)[coordinate - 1])).ravel()

    x = LOOPS[3]
    unknowns = "(a :init 0) (b :init 0)"
    once = compiled(f"extrema (spline ({written})) {coordinate}", len(outside(x)) // 2, unknowns=unknowns)
    np.testing.assert_allclose(once.residuals(x), outside(x), **ROUNDING)
    np.testing.assert_allclose(once.jacobian(x), slopes(outside, x, 4e-3), rtol=1e-8, atol=1e-8)


def test_of_the_image_of_a_moved_curve():
    points = np.column_stack([LOOPS, np.linspace(5, 9, len(LOOPS))]) - [2, 1.5, 0]
    camera = "(camera cam :focal 500 :center (320 240) :distortion (k))"
    form = f"extrema (project cam (trans [a b 0] (spline ({forms(points)})))) 2"
    ends = (0, knots(points)[-1])

    def outside(x):
        return stationary(image(spline(points + np.array([*x[:2], 0])), radial=x[2]), ends, 1).ravel()

    x = np.array([0.2, -0.1, -0.03])
    wanted = outside(x)
    once = compiled(form, len(wanted) // 2, unknowns="(a :init 0) (b :init 0) (k :init 0)", extra=camera)
    # Across a knot the differences of the reference see a step of the third derivative: some 1e-9 px.
    np.testing.assert_allclose(once.residuals(x), wanted, rtol=1e-10, atol=1e-7)
    np.testing.assert_allclose(once.jacobian(x), slopes(outside, x, 2e-3), rtol=1e-6, atol=1e-4)


def test_of_an_ellipse_that_is_turned():
    """(a cos s, b sin s) turned by w: its greatest height is √(a² sin² w + b² cos² w). Slopes in closed form."""
    curve = "(rotate w (curve (s 0 360deg) [(* 3 (cos s)) (* 2 (sin s))]))"
    text = (
        "(problem p (data t (table (n) (1) (2))) (unknowns (w angle :init 0))"
        f"(observe t (= 0 ((extrema {curve} 2) n 2)) :sigma 1))"
    ).replace(f"((extrema {curve} 2) n 2)", f"(((extrema {curve} 2) n) 2)")
    once = mbm.loads(text).compile()
    w = 0.4
    height = np.sqrt(9 * np.sin(w) ** 2 + 4 * np.cos(w) ** 2)
    np.testing.assert_allclose(once.residuals([w]), [height, -height], **ROUNDING)
    slope = 5 * np.sin(w) * np.cos(w) / height
    np.testing.assert_allclose(once.jacobian([w])[:, 0], [slope, -slope], **ROUNDING)


def test_of_a_polyline_they_are_corners():
    points = "(0 0) (1 2) (2 a) (3 5) (4 4)"
    once = compiled(f"extrema (polyline ({points})) 2", 3, unknowns="(a :init 0)")
    np.testing.assert_allclose(once.residuals([1.0]), [1, 2, 2, 1, 3, 5], **ROUNDING)
    np.testing.assert_allclose(once.jacobian([1.0])[:, 0], [0, 0, 0, 1, 0, 0], **ROUNDING)


def test_a_coordinate_that_turns_exactly_at_a_knot_counts_once():
    once = compiled("extrema (spline ((0 0) (1 1) (2 0))) 2", 1)
    np.testing.assert_allclose(once.residuals([0.0]), [1, 1], **ROUNDING)
    twice = compiled("extrema (spline ((0 0) (1 1) (2 0))) 2", 2)
    assert np.isnan(twice.residuals([0.0])[2:]).all()


HILL = "(curve (s -2 2) [s (- (* a s) (* s s s))])"
"""Two places for positive a, ±√(a/3); none for negative ones."""


def solved(start: float, measured: float):
    text = (
        f"(problem p (data t (table (n u) (1 {-measured}) (2 {measured}))) (unknowns (a :init {start}))"
        f"(observe t (= u (((extrema {HILL} 2) n) 1)) :sigma 0.01))"
    )
    return mbm.loads(text).solve().first


def test_a_solve_stays_where_they_are():
    """The whole first step from 3 leads below zero, where there is nothing."""
    found = solved(3.0, 0.1)
    assert found.status == "converged"
    assert found.estimates[0].value == pytest.approx(0.03, rel=1e-8)


def test_one_that_is_not_there_is_told():
    found = solved(-1.0, 0.5)
    assert found.status == "not-converged"
    (warning,) = found.diagnostics
    assert warning.code.name == "not-finite-at-start"
    assert warning.labels[0].place.row == 1


FAULTS = [
    ("wrong-kind", "(extrema (polyline ((0 0 0) (1 1 1))) 1)", "(polyline ((0 0 0) (1 1 1)))", "plane"),
    ("wrong-kind", "(extrema [1 2] 1)", "[1 2]", "a curve"),
    ("bad-index", "(extrema (polyline ((0 0) (1 1))) 3)", "3", "neither 1 nor 2"),
    ("bad-index", "((extrema (polyline ((0 0) (1 1))) 1) 0)", "0", "from 1"),
    ("bad-index", "((extrema (polyline ((0 0) (1 1))) 1) 1.5)", "1.5", "from 1"),
]


@pytest.mark.parametrize(("code", "form", "blamed", "words"), FAULTS, ids=[f for _, f, _, _ in FAULTS])
def test_faults(code, form, blamed, words):
    with pytest.raises(MbmError) as caught:
        mbm.loads(f"(problem p (unknowns (d :init 0)) (observe (= [d d] {form}) :sigma 1))").compile()
    fault = caught.value.diagnostics[0]
    assert fault.code.name == code, fault.message
    assert fault.place.text == blamed
    assert words in f"{fault.message} | {fault.hint}"


@pytest.mark.parametrize(
    "curve",
    [
        "(polyline ((0m 0m) (1m l) (2m 0m) (3m 2m)))",
        "(spline ((0m 0) (1m l) (2m 0) (3m 2m)))",
        "(spline ((0m 0m) (1m l) (2m 2m) (0m 3m)) :closed true)",
        "(curve (s 0m 3m) [s (* l (sin (/ s 1m)))])",
    ],
)
def test_curves_have_lengths(curve):
    """Distances and places in metres; one in seconds is refused, with the two things that do not go together."""
    text = (
        f"(problem p (unknowns (l :init 1.5m)) (observe (= 1m (((extrema {curve} 2) 1) 2)) :sigma 1cm)"
        f"(observe o (= 1m (curve-distance {curve} [1m 3m])) :sigma 1cm)"
        f"(derive (d (curve-distance {curve} [2m 1m]))))"
    )
    assert mbm.loads(text).solve()["d"].unit == "m"
    with pytest.raises(MbmError) as caught:
        mbm.loads(text.replace("[1m 3m]", "[1s 3s]")).compile()
    assert caught.value.diagnostics[0].code.name == "unit-clash"


def test_three_extrema_of_one_image_curve_are_not_too_much():
    text = """(problem p
      (camera cam :focal (800 800) :center (320 240))
      (unknowns (a :init 0.31) (b :init 0.19) (w :init 0))
      (define
        (ring (curve (s -1 (- (* 2 pi) 1)) [(* a (cos s)) (* b (sin s)) (* w (cos s))]))
        (C (project cam (trans [0 0 2] ring))))
      (observe one (= [320 320] ((extrema C 2) 1)) :sigma 1)
      (observe two (= [200 240] ((extrema C 1) 2)) :sigma 1)
      (observe three (= [320 160] ((extrema C 2) 2)) :sigma 1))"""
    (solve,) = mbm.loads(text).solve().solves
    assert [solve[name].value for name in "abw"] == pytest.approx([0.3, 0.2, 0.0], abs=1e-6)
