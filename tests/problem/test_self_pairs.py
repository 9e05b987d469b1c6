"""A table paired with itself, and the row before: which rows, what is used, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

PAIRS = """
(problem p
  (data d external {options})
  (pair steps ((from d) (to d)) {pair})
  (unknowns (v :init 0))
  (observe steps (= (- to.x from.x) v) :sigma 0.1)
  {more})
"""


def table(count=40, seed=3):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(0.5, 1.5, count))
    return {"t": t, "x": random.normal(size=count).cumsum(), "y": random.normal(size=count).cumsum()}


def differences(given, pair, more="", options=""):
    """The differences of x over the pairs, as derived quantities."""
    text = PAIRS.format(pair=pair, more=f"{more} (derive (dx (- to.x from.x) :over steps))", options=options)
    return np.asarray(mbm.loads(text).solve(data={"d": given})["dx"].value)


def test_rows():
    given = table()
    np.testing.assert_array_equal(differences(given, ":by row :step 3"), given["x"][3:] - given["x"][:-3])


def nearest(at, step, tolerance):
    """The definition, row by row."""
    found = []
    for i, start in enumerate(at[:-1]):
        later = np.abs(at[i + 1 :] - start - step)
        if later.min() <= tolerance:
            found.append((i, i + 1 + int(later.argmin())))
    return np.array(found)


@pytest.mark.parametrize(("step", "tolerance"), [(2.0, 0.3), (0.1, 0.5), (5.0, 1.0)])
def test_times_in_any_order(step, tolerance):
    given = table()
    order = np.random.default_rng(0).permutation(len(given["t"]))
    pairs = nearest(given["t"], step, tolerance)
    wanted = given["x"][pairs[:, 1]] - given["x"][pairs[:, 0]]
    shuffled = {name: column[order] for name, column in given.items()}
    found = differences(shuffled, f":by t :step {step} :tolerance {tolerance}")
    # the pairs stand in the order of the table's rows
    place = np.argsort(order)[pairs[:, 0]]
    np.testing.assert_array_equal(found, wanted[np.argsort(place)])


def test_distance_is_the_length_of_the_path():
    given = table()
    path = np.concatenate([[0], np.cumsum(np.hypot(np.diff(given["x"]), np.diff(given["y"])))])
    pairs = nearest(path, 4.0, 0.5)
    wanted = given["x"][pairs[:, 1]] - given["x"][pairs[:, 0]]
    np.testing.assert_array_equal(differences(given, ":by distance :step 4 :tolerance 0.5"), wanted)
    along = {**given, "east": given["x"], "north": given["y"], "y": given["y"] * 100}
    found = differences(along, ":by distance :step 4 :tolerance 0.5 :along (east north)")
    np.testing.assert_array_equal(found, wanted)


def test_the_usual_tolerance_is_half_a_step():
    given = {"t": [0.0, 1.0, 2.0, 3.6, 4.6], "x": [0.0, 1.0, 3.0, 7.0, 12.0]}
    # 3.6 is 0.4 from 2 + 2, but 0.6 from 1 + 2: too far; 4.6 is 1 from 3.6 + 2
    np.testing.assert_array_equal(differences(given, ":by t :step 2"), [3.0, 7.0 - 3.0])


def test_no_pair_crosses_a_key():
    given = {"g": [1, 1, 2, 1, 2, 2], "t": [0.0, 1, 0, 2, 1, 2], "x": [0.0, 1, 10, 3, 14, 20]}
    text = PAIRS.format(pair=":by t :step 1", more="(for-each g) (derive (n (count steps)))", options="")
    solved = mbm.loads(text).solve(data={"d": given})
    assert [float(one.estimates[0].value) for one in solved.solves] == [1.5, 5.0]
    assert [float(one.derived[0].value) for one in solved.solves] == [2, 2]


def test_no_pair_crosses_a_source():
    text = """
    (problem p
      (data a (table (x) (1) (2)))
      (data b (table (x) (10) (14)))
      (data d (union a b))
      (pair steps (d d) :by row :step 1)
      (unknowns (v :init 0))
      (observe steps (= (- d-2.x d.x) v) :sigma 0.1)
      (derive (dx (- d-2.x d.x) :over steps)))"""
    np.testing.assert_array_equal(mbm.loads(text).solve()["dx"].value, [1.0, 4.0])


def test_windows_cut_pairs_by_the_time_of_their_first_row():
    given = {"t": np.arange(6.0), "x": np.arange(6.0) ** 2}
    more = "(window t :length 3 :step 1 :min-rows 1) (derive (n (count steps)))"
    solved = mbm.loads(PAIRS.format(pair=":by row :step 1", more=more, options="")).solve(data={"d": given})
    assert [float(one.derived[0].value) for one in solved.solves] == [1, 2, 3, 3, 3]


def test_pairs_of_a_pair():
    given = {"a": {"t": [0.0, 1, 2], "x": [0.0, 1, 3]}, "b": {"t": [0.0, 1, 2], "x": [0.5, 2, 5]}}
    text = """
    (problem p
      (data a external) (data b external)
      (pair both (a b) :by t)
      (pair steps ((from both) (to both)) :by t :step 1)
      (unknowns (k :init 1))
      (observe steps (= (- to.b.x from.b.x) (* k (- to.a.x from.a.x))) :sigma 0.1))"""
    assert float(mbm.loads(text).solve(data=given)["k"].value) == pytest.approx((1.5 * 1 + 3 * 2) / (1 + 4))


def test_units_go_with_the_columns():
    text = """
    (problem p
      (data d (table (t x) (0s 1m) (1s 2m) (2s 4m)))
      (pair steps (d d) :by t :step {step})
      (unknowns (v))
      (observe steps (= (- d-2.x d.x) (* v (- d-2.t d.t))) :sigma 1cm))"""
    assert mbm.loads(text.format(step="1000ms")).solve()["v"].unit == "m/s"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text.format(step="1m")).solve()
    assert {d.code.name for d in caught.value.diagnostics} == {"unit-clash"}


@pytest.mark.parametrize(
    ("pair", "code"),
    [
        (":by row", "bad-form"),
        (":by row :step 0", "bad-form"),
        (":by row :step 1.5", "wrong-kind"),
        (":by row :step 1 :tolerance 1", "bad-form"),
        (":by t :step -1", "bad-form"),
        (":by t :step 1 :interpolate true", "bad-form"),
        (":by t :step 1 :along (x)", "bad-form"),
        (":by clock :step 1", "unknown-column"),
        (":by distance :step 1 :along (nothing)", "unknown-column"),
        (":step 1", "bad-form"),
    ],
)
def test_what_is_refused(pair, code):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(PAIRS.format(pair=pair, more="", options="")).solve(data={"d": table()})
    assert code in {d.code.name for d in caught.value.diagnostics}


def test_a_gap_in_the_path_names_its_cell():
    given = table(5)
    given["y"][2] = np.nan
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(PAIRS.format(pair=":by distance :step 1", more="", options="")).solve(data={"d": given})
    (fault,) = caught.value.diagnostics
    assert (fault.code.name, fault.place.row, fault.place.column) == ("not-finite-cell", 3, "y")


PREVIOUS = """
(problem p
  (data d external {options})
  (unknowns (v :init 0))
  (observe d (= (- x (previous x)) (* v (- t (previous t)))) :sigma 0.1)
  {more})
"""


def slope(t, x):
    dt, dx = np.diff(t), np.diff(x)
    return dt @ dx / (dt @ dt)


def test_the_row_before_is_that_of_the_unfiltered_table():
    given = table()
    solved = mbm.loads(PREVIOUS.format(options=":where (> x 0)", more="(derive (n (count d)))")).solve(
        data={"d": given}
    )
    kept = np.flatnonzero(given["x"] > 0)
    used = kept[kept > 0]
    dt, dx = given["t"][used] - given["t"][used - 1], given["x"][used] - given["x"][used - 1]
    assert float(solved["v"].value) == pytest.approx(dt @ dx / (dt @ dt), rel=1e-12)
    assert float(solved["n"].value) == len(kept)
    assert solved.first.residual_summaries["d"].used == len(used)


def test_keys_that_interleave():
    given = {"g": [1, 2, 1, 2, 1], "t": [0.0, 0, 1, 2, 3], "x": [0.0, 5, 1.1, 9, 3]}
    solved = mbm.loads(PREVIOUS.format(options="", more="(for-each g)")).solve(data={"d": given})
    wanted = [slope([0, 1, 3], [0, 1.1, 3]), slope([0, 2], [5, 9])]
    np.testing.assert_allclose([float(one.estimates[0].value) for one in solved.solves], wanted, rtol=1e-12)


def test_windows_see_the_row_before_them():
    given = {"t": np.arange(8.0), "x": np.arange(8.0) ** 2}
    more = "(window t :length 2 :step 1 :min-rows 1)"
    solved = mbm.loads(PREVIOUS.format(options="", more=more)).solve(data={"d": given})
    last = solved.solves[len(solved.solves) - 1]
    # rows 6 and 7: 36 − 25 and 49 − 36
    assert float(last.estimates[0].value) == pytest.approx(12.0, rel=1e-12)


def test_members_of_a_family_that_the_row_before_names():
    text = """
    (problem p
      (data d (table (at step) ("a" 0) ("b" 2.0) ("c" 3.0)))
      (unknowns (p :per d.at :init 0))
      (observe odometry d (= step (- (p at) (previous (p at)))) :sigma 0.1)
      (constraints (= (p "a") 1))
      (derive (moved (- (p at) (previous (p at))) :over d)))"""
    solved = mbm.loads(text).solve()
    np.testing.assert_allclose(solved["p"].value, [1, 3, 6], atol=1e-9)
    assert np.isnan(solved["moved"].value[0])
    assert not [d for d in solved.first.diagnostics if d.code.name == "derived-not-finite"]


def test_a_condition_on_the_row_before():
    given = table()
    more = "(observe late d (= x v) :sigma 1 :when (> (- t (previous t)) 1)) (derive (m (mean d (previous x))))"
    solved = mbm.loads(PREVIOUS.format(options="", more=more)).solve(data={"d": given})
    assert solved.first.residual_summaries["late"].used == int((np.diff(given["t"]) > 1).sum())
    assert float(solved["m"].value) == pytest.approx(given["x"][:-1].mean(), rel=1e-12)


def test_texts_and_row_numbers_of_the_row_before():
    text = """
    (problem p
      (data d (table (who x) ("a" 1) ("b" 2) ("b" 5)))
      (unknowns (v :init 0))
      (observe d (= x (if (= who (previous who)) (* 2 v) v)) :sigma 1)
      (derive (r (previous row) :over d)))"""
    solved = mbm.loads(text).solve()
    # rows 2 and 3: 2 = v and 5 = 2 v
    assert float(solved["v"].value) == pytest.approx((2 + 2 * 5) / 5)
    np.testing.assert_array_equal(solved["r"].value, [np.nan, 1, 2])


def test_conditions_on_a_text_of_the_row_before_do_not_hold_without_one():
    text = """
    (problem p
      (data d (table (who x) ("a" 1) ("b" 2) ("b" 5)))
      (unknowns (v :init 0))
      (observe d (= x v) :sigma 1 :when (= (previous who) "b"))
      (derive (f (if (= (previous who) "b") 1 0) :over d)))"""
    solved = mbm.loads(text).solve()
    assert float(solved["v"].value) == 5.0
    np.testing.assert_array_equal(solved["f"].value, [np.nan, 0, 1])
    assert not [d for d in solved.first.diagnostics if d.code.name == "derived-not-finite"]


def test_gaps_that_are_skipped_do_not_move_the_row_before():
    given = {"x": [1, 2, np.nan, 4, 5, 7], "who": list("abcabc")}
    text = """
    (problem p
      (data d external :missing skip :where (< x 6))
      (unknowns (v))
      (observe d (= (- x (previous x)) v) :sigma 0.2)
      (derive (before (previous x) :over d) (b (if (= (previous who) "b") (previous row) 0) :over d)))"""
    solved = mbm.loads(text).solve(data={"d": given})
    np.testing.assert_array_equal(solved["before"].value, [np.nan, 1, 2, 4])
    np.testing.assert_array_equal(solved["b"].value, [np.nan, 0, 2, 0])
    assert float(solved["v"].value) == pytest.approx((1 + 2 + 1) / 3)


def test_a_gap_in_the_row_before_is_named_as_it_is_written():
    text = """
    (problem p
      (data d (table (x) (1) (NA) (3) (4)))
      (unknowns (v))
      (observe d (= (- x (previous x)) v) :sigma 0.2 {}))"""
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text.format(":when (finite x)")).solve()
    (fault,) = caught.value.diagnostics
    assert "`(previous x)`" in fault.message
    assert ":when (finite (previous x))" in fault.hint
    assert float(mbm.loads(text.format(":when (and (finite x) (finite (previous x)))")).solve()["v"].value) == 1.0


def test_columns_of_a_file_that_are_called_alike_change_nothing(tmp_path):
    (tmp_path / "d.csv").write_text("previous(),previous(x),x,y\n7,8,3,4\n7,8,4,5\n7,8,6,6\n")
    (tmp_path / "p.mbm").write_text(
        '(problem p (data d (csv "d.csv")) (unknowns (v)) (observe d (= (- y (previous y)) (* v (- x (previous x))))))'
    )
    # 1 = v and 1 = 2 v
    assert float(mbm.load(tmp_path / "p.mbm").solve()["v"].value) == pytest.approx((1 + 2) / 5)


def test_other_data_have_rows_before_of_their_own():
    compiled = mbm.loads(PREVIOUS.format(options="", more="")).compile()
    for seed in (1, 2):
        given = table(seed=seed)
        solved = compiled.solve(data={"d": given})
        assert float(solved["v"].value) == pytest.approx(slope(given["t"], given["x"]), rel=1e-12)


def test_an_unknown_of_that_name_comes_first():
    text = """
    (problem p
      (data d (table (t x) (1 1) (2 3)))
      (unknowns (previous (array 2) :init 0))
      (observe d (= x (previous t)) :sigma 0.1))"""
    np.testing.assert_allclose(mbm.loads(text).solve()["previous"].value, [1, 3])


@pytest.mark.parametrize(
    "clause",
    [
        "(observe (= (previous v) 2))",
        "(observe more d (= x (previous (previous x))))",
        "(observe more d (= x (previous x t)))",
        "(derive (f (first d (previous x))))",
    ],
)
def test_where_there_is_no_row_before(clause):
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(PREVIOUS.format(options="", more=clause)).solve(data={"d": table()})
    assert {d.code.name for d in caught.value.diagnostics} == {"bad-form"}
