"""Silhouettes in problems: their words, what they refuse, and where they may not stand."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import mbm
from mbm.api.files import emit_file
from mbm.report.options import SolveOptions

HEAD = """
(defmodel cup (r) (surface (q 0 1) (s 0 (* 2 pi)) [(* r q (cos s)) (* r q (sin s)) (* q q)])
  (vertexes (1 (0 0 0)) (2 (9 0 0)) (3 (0 9 0))) (planes (1 (1 2 3))))
(defmodel two () (surface (left (sphere 1))) (right (trans (5 0 0) (sphere 1))))
"""
PROBLEM = """
(problem p
  (data t (table (u v) (1 2) (3 4)))
  (camera cam :focal (800 800) :center (0 0))
  (camera paper :focal (800 800) :axes paper)
  (unknowns (r :init 0.1) (x :init 0))
  {})
"""


def value(form: str) -> np.ndarray:
    clause = f"(observe ({'= 0' if form.startswith('(') else form} {form}) :sigma 1)"
    return mbm.loads(HEAD + PROBLEM.format(clause)).compile().residuals(np.zeros(2))


def code(clauses: str) -> tuple[str, str]:
    with pytest.raises(mbm.MbmError) as raised:
        mbm.loads(HEAD + PROBLEM.format(clauses)).compile()
    fault = raised.value.diagnostics[0]
    return fault.code.name, fault.message


DISK = np.pi * (800 * 0.1 / 2) ** 2


def test_project_and_silhouette_are_the_same():
    shape = "(trans [0 0 2] (disk r))"
    for head in (f"(silhouette cam {shape})", f"(project cam {shape})"):
        assert value(f"(area {head})") == pytest.approx(DISK, rel=1e-12)
    assert value("(area (perse (trans [2 0 0] (rotate (0 90deg 0) (disk r)))))") == pytest.approx(
        np.pi * 0.05**2, rel=1e-12
    )


@pytest.mark.parametrize(
    ("camera", "side", "expected"),
    [
        ("cam", "left", [-40, 0]),
        ("cam", "right", [40, 0]),
        ("cam", "top", [0, -40]),
        ("cam", "bottom", [0, 40]),
        ("paper", "top", [0, 40]),
        ("paper", "bottom", [0, -40]),
    ],
)
def test_sides_are_those_that_a_viewer_sees(camera, side, expected):
    shape = "(trans [0 0 2] (disk r))" if camera == "cam" else "(trans [2 0 0] (rotate (0 90deg 0) (disk r)))"
    clause = f"(observe (= [0 0] (extreme (silhouette {camera} {shape}) :{side})) :sigma 1)"
    found = mbm.loads(HEAD + PROBLEM.format(clause)).compile().residuals(np.zeros(2))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_distances_are_negative_inside_and_positive_in_holes():
    ring = "(silhouette cam (trans [0 0 2] (tube 0.2 0.1 0.001)))"
    for point, expected in (("[60 0]", -20), ("[0 0]", 800 * 0.1 / 2.001), ("[100 0]", 20)):
        found = value(f"(contour-distance {ring} {point})")
        assert found == pytest.approx(expected, rel=1e-9)


def test_planes_beside_smooth_faces_cover_nothing():
    """The triangle in `cup` is far larger than its bowl."""
    assert value("(area (silhouette cam (trans [0 0 2] (cup r))))") == pytest.approx(
        np.pi * max((800 * 0.1 * q / (2 + q * q)) ** 2 for q in np.linspace(0, 1, 1001)), rel=1e-6
    )


def test_surface_is_a_part_where_it_holds_shapes():
    """Files from before smooth faces may call a part so."""
    found = value("((vertex (two) surface left 1) 1)")
    assert found == pytest.approx(1)


def test_a_union_in_an_expression():
    """Two disks apart, at a depth of 2: their areas add up; in a transform, a function and a variable alike."""
    expected = pytest.approx(np.pi * (40**2 + 20**2), rel=1e-9)
    union = "(or (disk r) (trans [0.3 0 0] (disk (/ r 2))))"
    assert value(f"(area (silhouette cam (trans [0 0 2] {union})))") == expected
    assert value(f"(let ((S {union})) (area (silhouette cam (trans [0 0 2] (or S S)))))") == expected
    assert value("(area (silhouette cam (or (trans [0 0 2] (disk r)) (trans [0.3 0 2] (disk (/ r 2))))))") == expected


def test_or_of_conditions_is_a_condition():
    assert value("(if (or (> r 1) (< x 1)) 3 4)") == 3


def test_two_silhouettes_of_one_shape():
    """Two cameras, one size: each sees it with its own pose."""
    clauses = """
      (observe (= 8042.477193189871 (area (silhouette cam (trans [0 0 2] (disk r))))) :sigma 1)
      (observe (= 2010.619298297468 (area (silhouette cam (trans [x 0 4] (disk r))))) :sigma 1)
      (observe (= [40 0] (centroid (silhouette cam (trans [x 0 4] (disk r))))) :sigma 1)"""
    found = mbm.loads(HEAD + PROBLEM.format(clauses).replace("(r :init 0.1)", "(r :init 0.07)")).solve()
    assert found["r"].value == pytest.approx(np.sqrt(8042.477193189871 / np.pi) / 400, rel=1e-9)
    assert found["x"].value == pytest.approx(0.2, rel=1e-9)


def test_uncertain_points():
    """With errors in u and v, their standard deviation counts across the contour."""
    text = HEAD + PROBLEM.replace("(1 2) (3 4)", "(41 0) (0 39.5) (-40 1) (2 -40)")
    ring = "(contour-distance (silhouette cam (trans [0 0 2] (disk r))) [u v])"
    both = mbm.loads(text.format(f"(observe t {ring} :errors ((u 0.5) (v 0.5)))")).solve()
    plain = mbm.loads(text.format(f"(observe t {ring} :sigma 0.5)")).solve()
    assert both["r"].value == pytest.approx(plain["r"].value, rel=1e-4)
    assert both["r"].sigma == pytest.approx(plain["r"].sigma, rel=1e-2)


REFUSED = [
    ("(observe (= 1 (area (vertex (two) surface left 1))) :sigma 1)", "wrong-kind", "should be a silhouette"),
    ("(observe (= 1 (area (silhouette r (sphere r)))) :sigma 1)", "wrong-kind", "should be a camera"),
    ("(observe (= 1 (area (silhouette cam [0 0 1]))) :sigma 1)", "wrong-kind", "should be a shape"),
    ("(observe (= [1 1] (extreme (silhouette cam (sphere r)) :front)) :sigma 1)", "bad-form", "no side"),
    ("(observe (= 1 (area (trans [1 1] (silhouette cam (sphere r))))) :sigma 1)", "bad-form", "moves no silhouette"),
    ("(observe t (= 1 r) :sigma (area (silhouette cam (sphere u))))", "external-misplaced", "measures a silhouette"),
    ("(observe (= 1 (area (silhouette cam (two two)))) :sigma 1)", "wrong-arity", "two"),
    ("(observe (= 1 (area (silhouette cam (or (disk r) (> r 1))))) :sigma 1)", "wrong-kind", "should be a shape"),
    ("(observe (= 1 (area (silhouette cam (or (> r 1) (disk r))))) :sigma 1)", "not-a-condition", "the shape `disk`"),
]


@pytest.mark.parametrize(("clauses", "name", "words"), REFUSED, ids=[f"{n}-{w}" for _, n, w in REFUSED])
def test_what_is_refused(clauses, name, words):
    found, message = code(clauses)
    assert found == name
    assert words in message


@pytest.mark.parametrize("target", ["c", "python", "casadi"])
def test_generated_code_refuses_silhouettes(tmp_path, target):
    text = HEAD + PROBLEM.format("(observe (= 1 (area (silhouette cam (trans [0 0 2] (sphere r))))) :sigma 1)")
    (tmp_path / "p.mbm").write_text(text, encoding="utf-8")
    with pytest.raises(mbm.MbmError, match="a silhouette cannot be compiled"):
        emit_file(tmp_path / "p.mbm", SolveOptions(), target)


def test_casadi_functions_hold_no_silhouettes():
    problem = mbm.loads(HEAD + PROBLEM.format("(observe (= 1 (area (silhouette cam (sphere r)))) :sigma 1)"))
    with pytest.raises(mbm.MbmError, match="a silhouette cannot be compiled"):
        problem.compile().casadi()


def test_without_shapely(monkeypatch):
    """The extra is named in one line, before anything is computed."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("mbm.kernels.called_functions.find_spec", lambda name: None)
    fault, message = code("(observe (= 1 (area (silhouette cam (trans [0 0 2] (sphere r))))) :sigma 1)")
    assert fault == "missing-extra"
    assert "a silhouette" in message


NEAR = "a part of the shape is nearer than 0.1 m or behind the camera"
NOTHING = "the shape covers nothing of the image: it has no size, or is a plate that is seen edge-on"


@pytest.mark.parametrize(
    ("silhouette", "rows", "reason"),
    [
        ("(trans [0 0 (- v 3)] (sphere r))", "rows 1, 3", NEAR),
        ("(trans [0 0 (- u 1)] (box 0.3 0.3 0.3))", "row 1", NEAR),
        ("(trans [0 0 v] (box r (- u 1) r))", "row 1", NOTHING),
        ("(trans [0 0 v] (rotate (0 90deg 0) (rectangular 0.1 (+ r 0.1))))", "rows 1, 2, 3", NOTHING),
        ("(trans [0 0 (/ v x)] (sphere r))", "rows 1, 2, 3", "a number that the shape or its camera is made of"),
        ("(trans [0 0 (sqrt (- 4 v))] (sphere r))", "row 2", "a number that the shape or its camera is made of"),
    ],
)
def test_the_start_without_an_outline_says_where_and_why(silhouette, rows, reason):
    """The camera in a body, bodies before and behind it, and what covers nothing."""
    text = f"""
    (problem p
      (data t (table (u v) (1 2) (3 4.5) (4 3)))
      (camera cam :focal (800 800))
      (unknowns (r :init 0.1) (x :init 0))
      (observe t (contour-distance (silhouette cam {silhouette}) [u v]) :sigma 1)
      (observe (= x 1) :sigma 1))"""
    (warning,) = mbm.loads(text).solve().first.diagnostics
    assert warning.code.name == "not-finite-at-start"
    assert f"an equation of `t` has no finite value at the initial values in {rows}" in warning.message
    assert f"{': ' if rows.startswith('row ') else '; in row 1 '}{reason}" in warning.message


def test_of_many_rows_without_a_value_some_are_named():
    numbers = " ".join(f"({n})" for n in range(1, 21))
    text = f"(problem p (data t (table (n) {numbers})) (unknowns (a :init 5)) (observe t (= 1 (log (- a n))) :sigma 1))"
    (warning,) = mbm.loads(text).solve().first.diagnostics
    assert warning.message.endswith("at the initial values in rows 5, 6, 7, 8, 9, 10 and 10 more")


def test_a_constraint_without_an_outline_says_why():
    text = """
    (problem p
      (camera cam :focal (800 800))
      (unknowns (z :init 0.05))
      (observe (= 1 z) :sigma 1)
      (constraints (<= (area (silhouette cam (trans [0 0 z] (sphere 0.1)))) 3000)))"""
    (warning,) = mbm.loads(text).solve().first.diagnostics
    assert warning.code.name == "not-finite-at-start"
    assert warning.message.endswith(f"at the initial values: {NEAR}")


def test_a_derived_quantity_says_why_a_silhouette_has_none():
    """Behind the camera, and seen edge-on; where a formula has no value nothing more is known."""
    clauses = """(observe (= -2 x) :sigma 0.001)
      (derive (behind (area (silhouette cam (trans [0 0 x] (box 1 1 1)))))
        (edge (perimeter (silhouette cam (trans [(+ x 2) 0 3] (rotate (90deg 0 0) (rectangular 1 1))))))
        (root (sqrt x)))"""
    text = (HEAD + PROBLEM.format(clauses)).replace("(r :init 0.1) ", "").replace("(x :init 0)", "(x :init -2)")
    found = mbm.loads(text).solve().first
    behind, edge, root = (each.reason for each in found.derived)
    assert "behind the camera" in behind
    assert "edge-on" in edge
    assert root == "the value is not finite"
    said = [each.message for each in found.diagnostics if each.code.name == "derived-not-finite"]
    assert [behind.split(": ", 1)[1] in said[0], edge.split(": ", 1)[1] in said[1], ":" in said[2]] == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize(
    "shape",
    ["(cylinder r 1)", "(cone r 1)", "(sphere r)", "(ellipsoid r 1 1)", "(extrude (disk r) 1)", "(cup2 r)"],
)
def test_sizes_of_smooth_bodies_are_lengths_where_their_place_is(shape):
    turned = "(cup2 (r) (revolve (polyline ((0 0) (r 0) (r 1) (0 1))) 360deg))\n"
    clauses = f"(observe (= 9 (area (silhouette cam (trans [x 0m 2m] {shape})))) :sigma 1)"
    (solve,) = mbm.loads(turned + PROBLEM.format(clauses + "(constraints (normal x 0 1mm))")).solve().solves
    assert [solve[name].unit for name in "rx"] == ["m", "m"]


def test_a_size_that_is_no_length_clashes_with_a_place_that_is_one():
    assert code("(observe (= 9 (area (silhouette cam (trans [0m 0m 2m] (sphere 3s))))) :sigma 1)")[0] == "unit-clash"
