"""Distances from curves: values against SciPy's minima and closed forms, derivatives against differences of those."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.text.types import MbmError
from tests.language.curves_outside import forms, image, knots, minima, polyline, signed, slopes, spline

ROUNDING = {"rtol": 1e-12, "atol": 1e-12}
"""Some dozen operations on doubles; at the foot an error of the parameter counts by its square."""

WAVE = np.array([(0, 0), (1, 2), (3, 2.5), (4, 1), (6, 0.5), (7, 2)])
SPACE = np.column_stack([WAVE, [0, 1, -1, 0.5, 2, 1]])
RING = np.array([(0, 0), (3, -1), (5, 1), (3, 4), (1, 2.5)])


def compiled(distance: str, points: np.ndarray, *, unknowns: str = "(d :init 0)", extra: str = ""):
    """One equation for each point, whose residual is the distance; the columns are x, y and z."""
    names = " ".join("xyz"[: points.shape[1]])
    text = (
        f"(problem p {extra} (data t (table ({names}) {forms(points)})) (unknowns {unknowns})"
        f"(observe t (= 0 {distance}) :sigma 1))"
    )
    return mbm.loads(text).compile()


def scattered(points: np.ndarray, count: int = 150) -> np.ndarray:
    """Places on all sides of a curve and beyond its ends."""
    random = np.random.default_rng(count + len(points))
    return random.uniform(points.min(axis=0) - 2, points.max(axis=0) + 2, (count, points.shape[1]))


def lone(curve, ends, places: np.ndarray, gap: float = 0.2) -> np.ndarray:
    """Those of ``places`` that are far from where another foot is as near."""

    def clear(p):
        found = [d for d, _ in minima(curve, ends, p)]
        return len(found) == 1 or found[1] - found[0] > gap

    return np.array([p for p in places if clear(p)])


@pytest.mark.parametrize(("points", "closed"), [(WAVE, False), (RING, True), (WAVE[:3], False), (WAVE[:2], False)])
def test_distance_from_a_spline(points, closed):
    curve = spline(points, closed=closed)
    places = scattered(points)
    form = f"(curve-distance (spline ({forms(points)}) {':closed true' if closed else ''}) [x y])"
    found = compiled(form, places).residuals([0.0])
    wanted = [signed(curve, (0, curve.x[-1]), p) for p in places]
    np.testing.assert_allclose(found, wanted, **ROUNDING)


def test_distance_from_a_long_spline_that_comes_back():
    """Many feet for each place: the nearest of all is found."""
    random = np.random.default_rng(5)
    points = np.cumsum(random.normal([0.4, 0], 1, (20, 2)), axis=0)
    curve, places = spline(points), scattered(points, 300)
    found = compiled(f"(curve-distance (spline ({forms(points)})) [x y])", places).residuals([0.0])
    wanted = [minima(curve, (0, curve.x[-1]), p)[0][0] for p in places]
    np.testing.assert_allclose(np.abs(found), wanted, **ROUNDING)


def test_in_space_a_distance_is_never_negative():
    curve, places = spline(SPACE), scattered(SPACE, 80)
    found = compiled(f"(curve-distance (spline ({forms(SPACE)})) [x y z])", places).residuals([0.0])
    np.testing.assert_allclose(found, [minima(curve, (0, curve.x[-1]), p)[0][0] for p in places], **ROUNDING)
    way = compiled(f"(curve-distance (polyline ({forms(SPACE)})) [x y z])", places).residuals([0.0])
    line = polyline(SPACE)
    np.testing.assert_allclose(way, [minima(line, knots(SPACE), p)[0][0] for p in places], **ROUNDING)


CORNER = "(curve-distance (polyline ((0 0) (2 0) (2 2))) [x y])"


@pytest.mark.parametrize(
    ("place", "wanted"),
    [
        ((1, 0.5), 0.5),
        ((1, -0.5), -0.5),
        ((1.5, 1), 0.5),
        ((3, 1), -1),
        ((3, -1), -np.sqrt(2)),  # the corner is nearest; outside of a left turn is the right
        ((2.5, -1), -np.hypot(0.5, 1)),
        ((-3, 4), 5),  # beyond an end
        ((-3, -4), -5),
        ((1, 3), np.sqrt(2)),
        ((5, 6), -5),
        ((0, 0), 0),
        ((2, 0), 0),
        ((2, 2), 0),
        ((1, 0), 0),
    ],
)
def test_distance_from_a_corner(place, wanted):
    found = compiled(CORNER, np.array([place], dtype=float)).residuals([0.0])
    np.testing.assert_allclose(found, [wanted], **ROUNDING)


@pytest.mark.parametrize("turn", [30, 89, 91, 120, 150, 175])
def test_outside_of_a_sharp_turn(turn):
    """Left turns: the outside is the right, whichever of both lines a place is beside."""
    angle = np.deg2rad(turn)
    end = np.array([np.cos(angle), np.sin(angle)])
    away = angle / 2 - np.pi / 2 + np.linspace(-0.99, 0.99, 9) * angle / 2
    places = 0.5 * np.column_stack([np.cos(away), np.sin(away)])
    found = compiled(f"(curve-distance (polyline ((-1 0) (0 0) {forms([end])})) [x y])", places).residuals([0.0])
    np.testing.assert_allclose(found, -0.5, **ROUNDING)


def test_inside_of_a_polygon_is_left():
    """A polyline that ends where it begins: the winding number tells inside from outside."""
    corners = np.array([(0, 0), (4, 0), (4, 3), (2, 1), (0, 3), (0, 0)], dtype=float)
    places, line = scattered(corners, 200), polyline(corners)

    def winds(p):
        angles = np.unwrap(np.arctan2(*(corners - p).T[::-1]))
        return abs(angles[-1] - angles[0]) > np.pi

    wanted = [minima(line, knots(corners), p)[0][0] * (1 if winds(p) else -1) for p in places]
    found = compiled(f"(curve-distance (polyline ({forms(corners)})) [x y])", places).residuals([0.0])
    np.testing.assert_allclose(found, wanted, **ROUNDING)


def test_distance_from_a_circle():
    """Counter-clockwise: inside is left. The derivatives by the radius and the centre in closed form."""
    places = scattered(np.array([(-1.0, -1), (3, 2)]), 100)
    curve = "(curve (s 0 360deg) [(+ a (* r (cos s))) (* r (sin s))])"
    once = compiled(f"(curve-distance {curve} [x y])", places, unknowns="(r :init 0) (a :init 0)")
    x = np.array([1.7, 0.4])
    way = places - [x[1], 0]
    length = np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(once.residuals(x), 1.7 - length, **ROUNDING)
    # Near the centre the foot is badly determined, and the derivative by the centre with it.
    np.testing.assert_allclose(once.jacobian(x), np.column_stack([np.ones(100), way[:, 0] / length]), rtol=0, atol=1e-9)


def test_distance_from_an_arc_that_grows():
    """Beyond the end of an arc, which an unknown moves, the foot is that end."""
    places = np.array([(-1.0, 0.2), (0.1, 1.4), (0.9, -0.3), (0.7, 0.4)])
    curve = "(curve (s 0 e) [(cos s) (sin s)])"
    once = compiled(f"(curve-distance {curve} [x y])", places, unknowns="(e :init 0)")

    def outside(x):
        return np.array([signed(lambda s: np.stack([np.cos(s), np.sin(s)], axis=-1), (0, x[0]), p) for p in places])

    x = np.array([1.3])
    np.testing.assert_allclose(once.residuals(x), outside(x), **ROUNDING)
    np.testing.assert_allclose(once.jacobian(x), slopes(outside, x, 1e-2), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("points", "closed"), [(WAVE, False), (RING, True)])
def test_derivatives_by_points_of_a_spline_and_by_the_place(points, closed):
    option = ":closed true" if closed else ""
    written = f"{forms(points[:2])} (a b) {forms(points[3:])}"
    curve = spline(points, closed=closed)
    places = lone(curve, (0, curve.x[-1]), scattered(points, 24))
    assert len(places) > 15
    form = f"(curve-distance (spline ({written}) {option}) [(+ x c) (* y (+ 1 e))])"
    once = compiled(form, places, unknowns="(a :init 0) (b :init 0) (c :init 0) (e :init 0)")

    def outside(x):
        moved = points.astype(float).copy()
        moved[2] = x[:2]
        found = spline(moved, closed=closed)
        return np.array([signed(found, (0, found.x[-1]), p) for p in places * [1, 1 + x[3]] + [x[2], 0]])

    x = np.array([*points[2], 0.0, 0.0])
    np.testing.assert_allclose(once.residuals(x), outside(x), **ROUNDING)
    np.testing.assert_allclose(once.jacobian(x), slopes(outside, x, 4e-3), rtol=1e-8, atol=1e-8)


def test_derivatives_in_space_and_of_moved_polylines():
    curve, ends = polyline(SPACE), knots(SPACE)
    places = lone(curve, ends, scattered(SPACE, 24))
    form = f"(curve-distance (trans [a b 0] (rotate [0 0 c] (polyline ({forms(SPACE)})))) [x y z])"
    once = compiled(form, places, unknowns="(a :init 0) (b :init 0) (c angle :init 0)")

    def outside(x):
        cos, sin = np.cos(x[2]), np.sin(x[2])
        moved = SPACE @ np.array([(cos, sin, 0), (-sin, cos, 0), (0, 0, 1)]) + [*x[:2], 0]
        line = polyline(moved)
        return np.array([minima(line, knots(moved), p)[0][0] for p in places])

    x = np.array([0.02, -0.01, 0.01])
    np.testing.assert_allclose(once.residuals(x), outside(x), **ROUNDING)
    found, wanted = once.jacobian(x), slopes(outside, x, 2e-3)
    # Where the foot passes a corner the second derivative jumps: differences across it are worth less.
    smooth = np.abs(wanted - slopes(outside, x, 1e-3)).max(axis=1) < 1e-9
    assert smooth.sum() > 10
    np.testing.assert_allclose(found[smooth], wanted[smooth], rtol=1e-8, atol=1e-8)


ROAD = np.array([(0, 1, 2), (0.5, 0.8, 5), (-1, 0.9, 9), (1, 1, 16), (4, 0.7, 30)], dtype=float)
CAMERA = "(camera cam :focal 500 :center (320 240) :distortion (k))"


SEEN = [
    ("spline", -0.05),
    ("polyline", 0.0),
    *(pytest.param(*each, marks=pytest.mark.slow) for each in (("spline", 0.0), ("polyline", -0.05))),
]


@pytest.mark.parametrize(("kind", "radial"), SEEN)
def test_distance_from_the_image_of_a_curve(kind, radial):
    places = np.random.default_rng(2).uniform((0, 200), (640, 640), (20, 2))
    form = f"(curve-distance (project cam (trans [a 0 b] ({kind} ({forms(ROAD)})))) [x y])"
    once = compiled(form, places, unknowns="(a :init 0) (b :init 0) (k :init 0)", extra=CAMERA)
    ends = knots(ROAD)

    def outside(x):
        moved = ROAD + np.array([x[0], 0, x[1]])
        seen = image(spline(moved) if kind == "spline" else polyline(moved), radial=x[2])
        return np.array([minima(seen, ends, p)[0][0] for p in places])

    x = np.array([0.1, 0.2, radial])
    found = once.residuals(x)
    np.testing.assert_allclose(np.abs(found), outside(x), rtol=1e-11, atol=1e-9)
    assert np.isfinite(once.jacobian(x)).all()
    signs = np.sign(found)[:, None]
    wanted = signs * slopes(outside, x, 2e-4)
    # Where a foot reaches an end or the bend is as sharp as the distance is long, differences are worth less.
    smooth = np.abs(wanted - signs * slopes(outside, x, 1e-4)).max(axis=1) < 1e-6
    assert smooth.sum() > 14
    np.testing.assert_allclose(once.jacobian(x)[smooth], wanted[smooth], rtol=1e-8, atol=1e-6)  # some hundreds of px


def test_what_is_nearer_than_near_is_not_seen():
    """A straight line from behind the camera to before it: what is seen of it begins at `:near`."""
    places = np.array([(400.0, 250), (320, 1500), (330, 6000)])
    form = "(curve-distance (project cam (polyline ((0 1 -3) (0 1 10)))) [x y])"
    for near, given in ((0.1, ""), (1.0, ":near 1")):
        camera = f"(camera cam :focal 500 :center (320 240) {given})"
        found = compiled(form, places, extra=camera).residuals([0.0])
        end = np.array([320, 240 + 500 / near])
        top = np.array([320, 240 + 500 / 10])
        v = np.clip(places[:, 1], top[1], end[1])
        np.testing.assert_allclose(np.abs(found), np.hypot(places[:, 0] - 320, places[:, 1] - v), **ROUNDING)


@pytest.mark.parametrize(
    "line",
    [
        "(polyline ((0 1 0) (0 1 10)))",
        "(polyline ((0 1 -10) (0 1 10)))",
        "(polyline ((0 1 -10) (0 1 0) (0 1 10)))",
        "(curve (s 0 10) [0 1 s])",
        "(curve (s -10 10) [0 1 s])",
        "(spline ((0 1 0) (0 1 4) (0 1 10)))",
    ],
)
@pytest.mark.parametrize(("near", "given"), [(0.1, ""), (1.0, ":near 1")])
def test_a_curve_may_pass_through_the_plane_of_the_camera(line, near, given):
    """Where a curve is sampled, a point of it has no image: the division by its depth is one by zero."""
    places = np.array([(400.0, 250), (320, 400), (330, 6000), (310, 300)])
    camera = f"(camera cam :focal 500 :center (320 240) {given})"
    found = compiled(f"(curve-distance (project cam {line}) [x y])", places, extra=camera).residuals([0.0])
    v = np.clip(places[:, 1], 240 + 500 / 10, 240 + 500 / near)
    lengths = np.hypot(places[:, 0] - 320, places[:, 1] - v)
    wanted = np.where(places[:, 0] < 320, -lengths, lengths)  # v falls along it: what is right in the image is left
    np.testing.assert_allclose(found, wanted, **ROUNDING)


def test_an_extremum_of_a_curve_that_begins_in_the_plane_of_the_camera():
    """The image of (s² (4 - s), 1, s) is u = s (4 - s), v = 1/s; u is largest, 4, at s = 2."""
    text = (
        "(problem p (camera cam :focal 1) (data t (table (u v) (1 1))) (unknowns (k :init 4))"
        "(observe t (= [u v] ((extrema (project cam (curve (s 0 4) [(* s s (- k s)) 1 s])) 1) 1)) :sigma 1))"
    )
    np.testing.assert_allclose(mbm.loads(text).compile().residuals([0.0]), [4 - 1, 0.5 - 1], rtol=1e-12)


def test_a_curve_out_of_sight_has_no_distance_and_that_is_said():
    text = (
        "(problem p (camera cam :focal 500 :center (320 240)) (data t (table (u v) (300 200) (350 260)))"
        "(unknowns (b :init -5)) (observe t (= 0 (curve-distance (project cam (trans [0 0 b] "
        "(polyline ((0 0 0) (1 1 2))))) [u v])) :sigma 1))"
    )
    result = mbm.loads(text).solve()
    assert result.first.status == "not-converged"
    assert [d.code.name for d in result.first.diagnostics] == ["not-finite-at-start"]


def test_on_a_curve_derivatives_are_finite():
    """In the plane the distance runs through zero smoothly; in space it has no derivative there: zero."""
    plane = compiled(f"(curve-distance (spline ({forms(WAVE)})) [(+ x a) y])", WAVE, unknowns="(a :init 0)")
    np.testing.assert_allclose(plane.residuals([0.0]), 0, atol=1e-12)
    curve = spline(WAVE)
    way = curve(curve.x, 1)
    normal = -way[:, 1] / np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(plane.jacobian([0.0])[:, 0], normal, **ROUNDING)
    space = compiled(f"(curve-distance (polyline ({forms(SPACE)})) [(+ x a) y z])", SPACE, unknowns="(a :init 0)")
    np.testing.assert_allclose(space.residuals([0.0]), 0, atol=1e-12)
    assert (space.jacobian([0.0]) == 0).all()


def test_errors_in_both_coordinates_of_a_circle():
    """The foot moves with the true place: the same answer as by the equation of the circle."""
    points = "((1.02 0.01) (0.7 0.72) (0.01 0.98) (-0.7 0.69) (-0.99 0.02) (-0.72 -0.7))"
    start = "(c (vector 2) :init [0.1 0.1]) (r :init 1.1)"
    circle = "(curve (s 0 360deg) [(+ (c 1) (* r (cos s))) (+ (c 2) (* r (sin s)))])"
    answers = []
    for equation in (f"(= 0 (curve-distance {circle} [x y]))", "(= (hypot (- x (c 1)) (- y (c 2))) r)"):
        text = (
            f"(problem p (data d (table (x y) {points[1:-1]})) (unknowns {start})"
            f"(observe d {equation} :errors ((x 0.02) (y 0.03))))"
        )
        found = mbm.loads(text).solve().first
        assert found.status == "converged"
        answers.append([*np.concatenate([np.ravel(e.value) for e in found.estimates]), found.cost])
    np.testing.assert_allclose(answers[0], answers[1], rtol=1e-8)


FAULTS = [
    ("wrong-kind", "(curve-distance [1 2] [1 2])", "[1 2]", "a curve"),
    ("length-clash", "(curve-distance (polyline ((0 0) (1 1))) [1 2 3])", "[1 2 3]", ""),
    ("wrong-arity", "(curve-distance (polyline ((0 0) (1 1))))", None, "curve-distance"),
    ("too-many-steps", "(curve-distance (polyline (map (lambda (i) (list i 0)) (range 1 6000))) [1 2])", None, "64000"),
]


@pytest.mark.parametrize(("code", "form", "blamed", "words"), FAULTS, ids=[c for c, *_ in FAULTS])
def test_faults(code, form, blamed, words):
    with pytest.raises(MbmError) as caught:
        compiled(form, np.zeros((1, 2)))
    fault = caught.value.diagnostics[0]
    assert fault.code.name == code, fault.message
    assert blamed in (None, fault.place.text)
    assert words in f"{fault.message} | {fault.hint}"
