"""`:fixed … :at …`: what is fixed stays there. `:per (A.c B.d)`: a member for each value of either column."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

PLACES = {1: (90.0, 1.0, 2.0), 2: (-20.0, 3.0, -1.0), 3: (160.0, -2.0, 0.5)}
"""Angle in degrees and translation of three frames."""
POINTS = [(0.0, 0.0), (1.0, 0.0), (0.3, 2.0)]


def planar(angle, x, y):
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1]])


def images(base):
    """Rows of the points in every frame, seen from a further frame, without noise."""
    rows = []
    for frame, place in PLACES.items():
        whole = base @ planar(*place)
        rows += [(frame, a, b, *(whole @ [a, b, 1])[:2]) for a, b in POINTS]
    return rows


def listed(rows):
    return " ".join("(" + " ".join(f"{v:.12g}" for v in row) + ")" for row in rows)


def frames(options, rows):
    return mbm.loads(f"""(problem frames
      (data frames (table (frame) (1) (2) (3)) :key frame)
      (data seen (table (frame a b x y) {listed(rows)}))
      (unknowns (B (pose 2)) (T (pose 2) :per frames {options}))
      (observe seen (= [x y] (transform (compose B (T frame)) [a b])) :sigma 0.01))""")


def posed(value):
    """Homogeneous matrices of poses (angle, x, y)."""
    return [planar(np.rad2deg(v[0]), *v[1:]) for v in np.atleast_2d(value)]


BASE = planar(-35.0, 0.4, 0.7)


def test_a_member_is_held_where_it_is_said_and_the_others_need_no_start():
    found = frames(":fixed (= frame 1) :at (pose2 1 2 90deg)", images(BASE)).solve()
    assert found.status == "ok"
    np.testing.assert_allclose(posed(found["B"].value)[0], BASE, atol=1e-9)
    for got, place in zip(posed(found["T"].value), PLACES.values(), strict=True):
        np.testing.assert_allclose(got, planar(*place), atol=1e-9)
    np.testing.assert_array_equal(found["T"].sigma[0], 0)
    assert (found["T"].sigma[1:] > 0).all()


@pytest.mark.parametrize("said", ["", ":at (pose2)"])
def test_without_a_place_it_is_the_identity(said):
    found = frames(f":fixed (= frame 1) {said}", images(BASE)).solve()
    first = planar(*PLACES[1])
    np.testing.assert_allclose(posed(found["B"].value)[0], BASE @ first, atol=1e-9)
    for got, place in zip(posed(found["T"].value), PLACES.values(), strict=True):
        np.testing.assert_allclose(got, np.linalg.inv(first) @ planar(*place), atol=1e-9)


@pytest.mark.parametrize("said", [":fixed (= frame 1)", ":fixed (= frame 1) :at", ":fixed (= frame 1) :init"])
def test_the_identity_goes_with_every_unit_of_length(said):
    """(pose2) and (pose3) have no translation, in whatever unit: readings in mm give the same, in metres."""
    rows = [(frame, a, b, 1e3 * x, 1e3 * y) for frame, a, b, x, y in images(BASE)]
    found = mbm.loads(f"""(problem frames
      (data frames (table (frame) (1) (2) (3)) :key frame)
      (data seen (table (frame a b x y) {listed(rows)}) :columns ((x :unit mm) (y :unit mm) (a :unit m) (b :unit m)))
      (unknowns (B (pose 2)) (T (pose 2) :per frames {said} {"(pose2)" if said[-1] != ")" else ""}))
      (observe seen (= [x y] (transform (compose B (T frame)) [a b])) :sigma 10mm))""").solve()
    np.testing.assert_allclose(posed(found["B"].value)[0], BASE @ planar(*PLACES[1]), atol=1e-9)


def test_the_identity_of_space_goes_with_metres():
    found = mbm.loads("""(problem p (data d (table (x) (1m) (3m)))
      (unknowns (T (pose 3) :init (pose3)))
      (observe d (= [x 2m 0m] (translation T)) :sigma 1m)
      (observe (= (rot-z 0.5) (rotation T)) :sigma 1))""").solve()
    np.testing.assert_allclose(found["T"].value, [np.cos(0.25), 0, 0, np.sin(0.25), 2, 2, 0], atol=1e-9)


@pytest.mark.parametrize("sets", [1, 12])
def test_what_is_not_fixed_needs_no_place(sets):
    """`:at` may have gaps in the rows of members that are not fixed, in one solve and in many."""
    points = [(k, i, i if i == 1 else float("nan")) for k in range(1, sets + 1) for i in (1, 2, 3)]
    steps = [(k, i, i + 1, 0.5 * k) for k in range(1, sets + 1) for i in (1, 2)]
    columns = {
        name: np.array(column)
        for name, column in zip(("set", "point", "known"), zip(*points, strict=True), strict=True)
    }
    text = """(problem levels
      (data points external :key point)
      (data steps external)
      (unknowns (h :per points :fixed (finite known) :at known))
      (observe steps (= rise (- (h to) (h from))) :sigma 0.01){each})"""
    rises = {
        name: np.array(column)
        for name, column in zip(("set", "from", "to", "rise"), zip(*steps, strict=True), strict=True)
    }
    if sets == 1:
        del columns["set"], rises["set"]
    else:
        columns["point"] += 100 * columns["set"]
        rises["from"], rises["to"] = rises["from"] + 100 * rises["set"], rises["to"] + 100 * rises["set"]
    each = "" if sets == 1 else " (for-each set)"
    found = mbm.loads(text.format(each=each)).solve(data={"points": columns, "steps": rises})
    for k, solve in enumerate(found.solves, 1):
        np.testing.assert_allclose(solve.estimates[0].value, [1, 1 + 0.5 * k, 1 + k], rtol=1e-12)


def test_a_start_is_for_what_is_not_fixed():
    """A start far away leads to the same answer, and does not move what is fixed."""
    found = frames(":init (pose2 7 7 2) :fixed (= frame 1) :at (pose2 1 2 90deg)", images(BASE)).solve()
    np.testing.assert_allclose(posed(found["T"].value)[0], planar(*PLACES[1]), atol=1e-12)
    np.testing.assert_allclose(posed(found["B"].value)[0], BASE, atol=1e-9)


def test_elements_are_held_one_by_one():
    found = mbm.loads("""(problem line
      (data d (table (x y) (1 3.1) (2 5.0) (3 7.2) (4 8.9)))
      (unknowns (p (vector 2) :fixed [true false] :at [1 99]) (c :fixed true :at 0.5) (k :fixed true))
      (observe d (= y (+ (p 1) (* (p 2) x) c k)) :sigma 0.1))""").solve()
    x, y = np.array([1, 2, 3, 4]), np.array([3.1, 5.0, 7.2, 8.9])
    np.testing.assert_allclose(found["p"].value, [1, x @ (y - 1.5) / (x @ x)], rtol=1e-12)
    assert (found["c"].value, found["k"].value) == (0.5, 0)
    np.testing.assert_allclose(found["p"].sigma, [0, 0.1 / np.sqrt(x @ x)], rtol=1e-12)


@pytest.mark.parametrize("sets", [2, 12])
def test_members_of_many_solves_are_held_where_their_own_rows_say(sets):
    """Two sets are solved one by one, twelve together."""
    rows = []
    for number in range(1, sets + 1):
        rows += [(number, 2, 3, 0.7 * number - 0.3), (number, 1, 2, 0.3 - 0.1 * number)]
    found = mbm.loads(f"""(problem levels
      (data steps (table (set from to rise) {listed(rows)}))
      (unknowns (h :per (steps.from steps.to)
          :fixed (= from 1) :at (* 10 from)))
      (observe steps (= rise (- (h to) (h from))) :sigma 0.01)
      (for-each set))""").solve()
    assert len(found.solves) == sets
    for number, solve in enumerate(found.solves, 1):
        values = dict(zip(solve.estimates[0].keys, solve.estimates[0].value, strict=True))
        assert values[1] == 10
        assert values[2] == pytest.approx(10.3 - 0.1 * number, abs=1e-12)
        assert values[3] == pytest.approx(10 + 0.6 * number, abs=1e-12)


def test_a_family_over_two_tables_has_the_values_of_both():
    found = mbm.loads("""(problem both
      (data a (table (tag y) ("n" 1.0) ("s" 2.0)))
      (data b (table (name z) ("s" 2.2) ("w" 4.0)))
      (unknowns (v :per (a.tag b.name)))
      (observe a (= y (v tag)) :sigma 0.1)
      (observe b (= z (v name)) :sigma 0.1))""").solve()
    assert list(found["v"].keys) == ["n", "s", "w"]
    np.testing.assert_allclose(found["v"].value, [1.0, 2.1, 4.0], rtol=1e-12)


def test_errors_say_what_is_wrong():
    problem = (
        "(problem p (data d (table (t y) (1 2) (2 3))) (data e (table (t) (a))) (unknowns {}) (observe d (= y x)))"
    )
    for unknown, code, words in (
        ("(x :at 3)", "bad-form", "`:at` says where `:fixed` holds"),
        ("(x (pose 2) :fixed true :at (pose2 1))", "wrong-arity", "given 1 argument"),
        ("(x :per (d.t e.t))", "wrong-kind", "a column of numbers, as the first"),
        ("(x :per (d.t d))", "bad-form", "a table, a column, or a list of columns"),
        ("(x :per (d.t d.s))", "unknown-column", "`s`"),
    ):
        with pytest.raises(mbm.MbmError) as caught:
            mbm.loads(problem.format(unknown)).solve()
        first = caught.value.diagnostics[0]
        assert first.code.name == code, first
        assert words in first.message + (first.hint or ""), first
