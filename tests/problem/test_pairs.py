"""Timed tables laid on one another: association one to one, interpolation, what pairs hold, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation, Slerp

import mbm
from mbm.problem.pairing import associated, usual_tolerance

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""


def greedy(a, b, tolerance):
    """The definition: of all pairs within the tolerance the nearest first, each row once."""
    pairs = sorted((abs(s - t), min(s, t), i, j) for i, s in enumerate(a) for j, t in enumerate(b))
    found = {}
    for distance, _, i, j in pairs:
        if distance <= tolerance and i not in found and j not in found.values():
            found[i] = j
    return found


@settings(max_examples=300)
@given(
    a=st.lists(st.integers(0, 60), max_size=15, unique=True),
    b=st.lists(st.integers(0, 60), max_size=15, unique=True),
    tolerance=st.integers(0, 20),
)
def test_association_is_the_nearest_first(a, b, tolerance):
    # Whole numbers and square roots apart: all distances are different, so that there is one answer.
    s, t = np.array(a, dtype=float), np.array(b) + np.sqrt(2) / 2 + np.array(b) * 1e-4
    rows, others = associated(s, t, float(tolerance))
    assert dict(zip(rows.tolist(), others.tolist(), strict=True)) == greedy(s.tolist(), t.tolist(), tolerance)
    assert rows.tolist() == sorted(rows.tolist())


def test_regular_times_with_jitter_are_matched_as_a_whole():
    random = np.random.default_rng(4)
    a = np.arange(200) + random.uniform(-0.1, 0.1, 200)
    b = random.permutation(np.arange(0, 200, 0.5) + random.uniform(-0.05, 0.05, 400))
    rows, others = associated(a, b, 0.25)
    # Where nothing competes, the nearest first is also the assignment of the least total distance.
    best = linear_sum_assignment(np.abs(a[:, None] - b))
    np.testing.assert_array_equal(rows, best[0])
    np.testing.assert_array_equal(others, best[1])


def test_the_usual_tolerance_is_half_a_step_of_the_denser_table():
    for a, b, half in ((np.arange(5.0), np.arange(0, 5, 0.25), 0.125), (np.array([3.0]), np.array([1.0, 1.0]), 0.0)):
        assert usual_tolerance((a, b), [(np.arange(len(a)), np.arange(len(b)))]) == half


PAIR = """
(problem p
  (data sites (table (name h) ("n" 10) ("s" 20)) :key name)
  (data left (table (t x site) (1 10 "n") (2 20 "s") (3 30 "s") (9 90 "n")) :with (sites site))
  (data right (table (t y) (2.1 5) (0.9 3) (3.4 7)))
  (pair both (left right) :by t {options})
  (unknowns (a) (b))
  {observe})
"""
SHARED = "(observe both (= (* left.x right.y) a) :sigma 1) (observe u both (= left.sites.h b) :sigma 1)"


def test_a_pair_holds_the_columns_of_both_and_what_was_joined_to_them(solve):
    solved = solve(PAIR.format(options=":tolerance 0.2", observe=SHARED))
    assert float(solved["a"].value) == pytest.approx((10 * 3 + 20 * 5) / 2, rel=EXACT)
    assert float(solved["b"].value) == pytest.approx(15, rel=EXACT)


def test_without_a_tolerance_half_a_step_counts(solve):
    # Steps of the right table 1.2 and 1.3, of the left 1, 1 and 6: half of the median of the denser is 0.5.
    solved = solve(PAIR.format(options="", observe=SHARED))
    assert float(solved["a"].value) == pytest.approx((10 * 3 + 20 * 5 + 30 * 7) / 3, rel=EXACT)


def test_the_time_stands_under_its_plain_name_and_under_both_others(solve):
    observe = "(observe both (= (+ t (* 10 right.t)) a) :sigma 1) (observe u both (= left.t b) :sigma 1)"
    solved = solve(PAIR.format(options=":tolerance 0.2", observe=observe))
    assert float(solved["a"].value) == pytest.approx((1 + 9 + 2 + 21) / 2, rel=EXACT)
    assert float(solved["b"].value) == pytest.approx(1.5, rel=EXACT)


def test_interpolation_takes_the_second_table_at_the_first_ones_times(solve):
    solved = solve(PAIR.format(options=":interpolate true", observe=SHARED))
    # At 1, 2, 3 (9 lies outside), on the lines (0.9, 3) – (2.1, 5) – (3.4, 7).
    y = np.interp([1, 2, 3], [0.9, 2.1, 3.4], [3, 5, 7])
    assert float(solved["a"].value) == pytest.approx(float(np.mean(np.array([10, 20, 30]) * y)), rel=EXACT)
    observe = "(observe both (= t a) :sigma 1) (observe u both (= right.t b) :sigma 1)"
    times = solve(PAIR.format(options=":interpolate true", observe=observe))
    assert (float(times["a"].value), float(times["b"].value)) == pytest.approx((2, 2), rel=EXACT)


def test_interpolation_bridges_no_gap_wider_than_the_tolerance(solve):
    solved = solve(PAIR.format(options=":interpolate true :tolerance 1.1", observe=SHARED))
    # 1 lies 1.1 before 2.1, 2 the same behind 0.9; 3 lies 0.9 and 0.4 from its neighbours.
    y = np.interp([1, 2, 3], [0.9, 2.1, 3.4], [3, 5, 7])
    assert float(solved["a"].value) == pytest.approx(float(np.mean(np.array([10, 20, 30]) * y)), rel=EXACT)
    narrow = solve(PAIR.format(options=":interpolate true :tolerance 1", observe=SHARED))
    assert float(narrow["a"].value) == pytest.approx(30 * y[2], rel=EXACT)


TURNING = """
(problem p
  (data a (table (t) (0.25) (0.5)))
  (data b external :columns ((bearing :unit deg) (t :unit s)))
  (pair c (a b) :by t :interpolate true)
  (unknowns (h :init 0))
  (observe c (= {form} h) :sigma 1))
"""


def test_angles_with_a_unit_go_the_shorter_way_round(estimate):
    data = {"b": {"t": [0.0, 1.0], "bearing": [350.0, 30.0]}}
    found = estimate(TURNING.format(form="(cos (- b.bearing 5deg))"), "h", data=data)
    assert found == pytest.approx(np.cos(np.deg2rad([-5, 5])).mean(), rel=EXACT)


@pytest.mark.parametrize("sign", [1, -1])
def test_quaternions_are_interpolated_on_the_great_circle(estimate, sign):
    """Of both signs of a quaternion, which are one rotation, the nearer one counts: no detour."""
    turns = Rotation.random(2, random_state=7)
    cells = turns.as_quat() * [[1], [sign * np.sign(turns[0].as_quat() @ turns[1].as_quat())]]
    assert np.sign(cells[0] @ cells[1]) == sign
    data = {"b": {"t": [0.0, 1.0], "bearing": [0, 0], **dict(zip(("qx", "qy", "qz", "qw"), cells.T, strict=True))}}
    between = Slerp([0, 1], turns)([0.25, 0.5])
    form = "(((rotate (quaternion b.qw b.qx b.qy b.qz) [1 2 3])) {})"
    for i in range(3):
        form = f"((rotate (quaternion b.qw b.qx b.qy b.qz) [1 2 3]) {i + 1})"
        found = estimate(TURNING.format(form=form), "h", data=data)
        assert found == pytest.approx(between.apply([1, 2, 3])[:, i].mean(), abs=1e-12)


def test_a_fault_in_a_column_of_the_second_table_names_its_own_row(faults):
    text = "(problem p (data a external) (data b external) (pair c (a b) :by t) (unknowns (h)) (observe c (= b.y h)))"
    data = {"a": {"t": [1.0, 2.0]}, "b": {"t": [2.0, 5.0, 1.0], "y": [4.0, 3.0, np.nan]}}
    (fault,) = faults(text, data=data)
    assert fault.code.name == "not-finite-cell"
    assert (fault.place.file, fault.place.row, fault.place.column) == ("<b>", 3, "y")


@pytest.mark.parametrize(
    ("clause", "code", "words"),
    [
        ("(pair c (a b))", "bad-form", "names the column of times"),
        ("(pair c a :by t)", "bad-form", "a name and two tables"),
        ("(pair c (a a) :by t)", "bad-form", "paired with itself by a `:step`"),
        ("(pair c (a d) :by t)", "unknown-table", "`d`"),
        ("(pair c (a b) :by s)", "unknown-column", "`s`"),
        ("(pair a (a b) :by t)", "duplicate-definition", "`a`"),
        ("(pair c (a b) :by t :tolerance 0)", "bad-form", "above zero"),
        ("(pair c (a b) :by t :tolerance 3m)", "unit-clash", "`3m`"),
        ("(pair c (a b) :by t :interpolate yes)", "bad-form", "`true` or `false`"),
        ("(pair c (a b) :by name)", "bad-time", "holds the text `x`"),
        ("(pair c (a b) :by z :interpolate true)", "bad-time", "two rows have the time 7"),
        ("(pair c (a b) :by w)", "unit-clash", "column `w`"),
    ],
)
def test_what_a_pair_cannot_be(faults, clause, code, words):
    tables = '(data a (table (t name z w) (1s "x" 1 1m)))(data b (table (t name z w) (1 "y" 7 1s) (2 "y" 7 2s)))'
    found = faults(f"(problem p {tables} {clause} (unknowns (h)) (observe a (= t h)))")
    assert found[0].code.name == code
    assert words in found[0].message


def test_two_times_of_a_pair_are_of_one_dimension(faults):
    text = (
        "(problem p (data a (table (t) (1s) (2s))) (data b (table (t y) (1 3) (2 4))) (pair c (a b) :by t)"
        " (unknowns (h :unit m)) (observe c (= b.t h) :sigma 1m))"
    )
    assert [f.code.name for f in faults(text)] == ["unit-clash"]


def test_a_pair_follows_other_data():
    text = "(problem p (data a external) (data b external) (pair c (a b) :by t) (unknowns (h)) (observe c (= b.y h)))"
    compiled = mbm.loads(text).compile(data={"a": {"t": [1.0, 2.0]}, "b": {"t": [1.0, 2.0], "y": [3.0, 5.0]}})
    assert float(compiled.solve()["h"].value) == pytest.approx(4, rel=EXACT)
    other = {"a": {"t": [1.0, 2.0, 3.0]}, "b": {"t": [1.1, 3.0], "y": [30.0, 50.0]}}
    assert float(compiled.solve(data=other)["h"].value) == pytest.approx(40, rel=EXACT)


RUNS = """
(problem p (data A external) (data B external)
  (pair P (A B) :by t :tolerance 0.1 {how}) (unknowns (s))
  (observe P (= B.u (+ A.x s)) :sigma 0.1) (for-each {key}))"""


@pytest.mark.parametrize("how", ["", ":interpolate true"])
@pytest.mark.parametrize("key", ["run", "A.run"])
def test_no_pair_crosses_a_key(how, key):
    """Two runs at the same times; those of B stand in the other order, and what one reads in all is known for both."""
    t = np.tile([0.0, 1.0, 2.0], 2)
    x = np.array([1.0, 2, 4, 10, 30, 50])
    A = {"run": np.repeat([1, 2], 3), "t": t, "x": x}
    B = {"run": np.repeat([2, 1], 3), "t": t, "u": np.concatenate([x[3:] + 5.4, x[:3] + 5.1])}
    found = mbm.loads(RUNS.format(how=how, key=key)).solve(data={"A": A, "B": B})
    assert [float(each["s"].value) for each in found.solves] == pytest.approx([5.1, 5.4], abs=EXACT * 60)
    assert [each.dof for each in found.solves] == [2, 2]


@pytest.mark.parametrize("how", [":tolerance 0.1", "", ":interpolate true"])
def test_windows_over_laps_are_solves_of_their_rows(how):
    """The times start anew with each lap; those of B are a little later, and stand in the other order."""
    laps, t, shift = np.repeat([1.0, 2.0, 3.0], 4), np.tile(np.arange(4.0), 3), np.repeat([5.1, 5.4, 5.8], 4)
    a = {"lap": laps, "t": t, "x": np.square(t) * laps}
    b = {"lap": laps[::-1], "t": np.tile(np.arange(4.0), 3) + 0.01, "u": 0 * t}
    b["u"] = np.square(b["t"]) * b["lap"] + np.repeat([5.8, 5.4, 5.1], 4)
    text = f"""(problem p (data A external) (data B external) (pair P (A B) :by t {how}) (unknowns (s))
      (observe P (= B.u (+ A.x s)) :sigma 0.1) {{window}})"""
    found = mbm.loads(text.format(window="(window lap :length 1 :step 1)")).solve(data={"A": a, "B": b})
    one = mbm.loads(text.format(window=""))
    for lap, each in zip([1.0, 2.0, 3.0], found.solves, strict=True):
        own = {name: {c: v[table["lap"] == lap] for c, v in table.items()} for name, table in (("A", a), ("B", b))}
        alone = one.solve(data=own)
        assert float(each["s"].value) == pytest.approx(float(alone["s"].value), rel=EXACT)
        assert each.dof == alone.dof
    both = mbm.loads(text.format(window="(window lap :length 2 :step 1)")).solve(data={"A": a, "B": b})
    wide = [float(each["s"].value) for each in both.solves]
    narrow = [float(each["s"].value) for each in found.solves]
    assert wide == pytest.approx([narrow[0], (narrow[0] + narrow[1]) / 2, (narrow[1] + narrow[2]) / 2], rel=EXACT)
    assert shift[0] < narrow[0] < shift[-1]


def test_steps_do_not_cross_laps():
    """One step of the row and of time in each lap of three rows, at 1, 2 and 3 a second: none from lap to lap."""
    laps, t = np.repeat([1.0, 2.0, 3.0], 3), np.tile(np.arange(3.0), 3)
    for by in ("t", "row"):
        text = f"""(problem p (data A external) (pair P ((from A) (to A)) :by {by} :step 1) (unknowns (v))
          (observe P (= (- to.x from.x) v) :sigma 0.1) (window lap :length 1 :step 1))"""
        found = mbm.loads(text).solve(data={"A": {"lap": laps, "t": t, "x": laps * t}})
        assert [float(each["v"].value) for each in found.solves] == pytest.approx([1.0, 2.0, 3.0], rel=EXACT)
        assert [each.dof for each in found.solves] == [1, 1, 1]


def test_windows_along_a_way_take_pairs_across_its_values():
    """The times of a drive go on, there and back: pairs are those of time, wherever each table saw the car."""
    t = np.arange(6.0)
    way = np.array([0.0, 1, 2, 2, 1, 0])
    tables = {"A": {"s": way, "t": t, "x": t}, "B": {"s": way + 0.1, "t": t + 0.01, "u": t + 3}}
    text = """(problem p (data A external) (data B external) (pair P (A B) :by t) (unknowns (d))
      (observe P (= B.u (+ A.x d)) :sigma 0.1) (window s :length 3 :step 2))"""
    found = mbm.loads(text).solve(data=tables)
    assert [each.dof for each in found.solves] == [1, 5]


@pytest.mark.parametrize("how", ["", ":interpolate true"])
def test_each_key_of_one_table_is_paired_with_all_of_a_table_without_it(how):
    t = np.tile([0.0, 1.0, 2.0], 2)
    x = np.array([1.0, 2, 4, 10, 30, 50])
    A = {"run": np.repeat([1, 2], 3), "t": t, "x": x}
    B = {"t": t[:3], "u": np.array([7.0, 8.0, 9.0])}
    found = mbm.loads(RUNS.format(how=how, key="run")).solve(data={"A": A, "B": B})
    assert [float(each["s"].value) for each in found.solves] == pytest.approx([8 - 7 / 3, -22.0], abs=EXACT * 60)


@pytest.mark.parametrize("key", ["run", "A.run", "B.run", "P.A.run", "P.run", "C.run"])
def test_a_pair_of_a_pair_crosses_no_key_whatever_it_is_called(key):
    """Two runs at the same times, the tables in different orders: what C reads more than A and B together is known."""
    t, run = np.tile([0.0, 1.0, 2.0], 2), np.repeat([1.0, 2.0], 3)
    x = np.array([1.0, 2, 3, 10, 20, 30])
    tables = {
        "A": {"run": run, "t": t, "x": x},
        "B": {"run": run[::-1], "t": t[::-1], "u": x[::-1]},
        "C": {"run": run[::-1], "t": t[::-1], "w": (2 * x + np.where(run == 1, 5.0, 7.0))[::-1]},
    }
    text = f"""(problem p (data A external) (data B external) (data C external)
      (pair P (A B) :by t :tolerance 0.1) (pair Q (P C) :by t :tolerance 0.1) (unknowns (s))
      (observe Q (= C.w (+ P.A.x P.B.u s)) :sigma 0.1) (for-each {key}))"""
    found = mbm.loads(text).solve(data=tables)
    values = {each.key["run"]: float(each["s"].value) for each in found.solves}
    assert values == pytest.approx({1.0: 5.0, 2.0: 7.0}, abs=EXACT * 60)
    assert [each.dof for each in found.solves] == [2, 2]


@pytest.mark.parametrize("key", ["run", "A.run", "P.A.run"])
def test_a_key_under_the_name_of_its_table_divides_all_that_reads_the_column(key):
    """Rows of the table alone, of its pair, the row before, and what a constraint counts."""
    run, t = np.repeat([1.0, 2.0], 3), np.tile([0.0, 1.0, 2.0], 2)
    A = {"run": run, "t": t, "x": np.array([1.0, 2, 4, 10, 30, 50])}
    B = {"run": run, "t": t, "u": A["x"] + 3 * run}
    text = f"""(problem p (data A external) (data B external) (pair P (A B) :by t) (unknowns (s) (m) (v) (k :init 1))
      (observe P (= B.u (+ A.x s)) :sigma 0.1) (observe A (= x m) :sigma 1)
      (observe going A (= (- x (previous x)) v) :sigma 1)
      (constraints (= k (mean A x))) (solve :constraints exact) (for-each {key}))"""
    found = mbm.loads(text).solve(data={"A": A, "B": B}).solves
    values = [[float(each[name].value) for name in "smvk"] for each in found]
    np.testing.assert_allclose(values, [[3, 7 / 3, 1.5, 7 / 3], [6, 30, 20, 30]], rtol=1e-9)


@pytest.mark.parametrize("column", ["lap", "A.lap", "P.A.lap", "C.lap"])
def test_windows_over_laps_take_no_pair_of_a_pair_across_them(column):
    """The times start anew with each lap: what C reads more than A and B together is known for each."""
    t, lap = np.tile([0.0, 1.0, 2.0], 3), np.repeat([1.0, 2.0, 3.0], 3)
    x = np.square(t) * lap
    tables = {
        "A": {"lap": lap, "t": t, "x": x},
        "B": {"lap": lap[::-1], "t": t, "u": np.square(t) * lap[::-1]},
        "C": {"lap": lap[::-1], "t": t[::-1], "w": (2 * x + 5 * lap)[::-1]},
    }
    text = f"""(problem p (data A external) (data B external) (data C external)
      (pair P (A B) :by t) (pair Q (P C) :by t) (unknowns (s))
      (observe Q (= C.w (+ P.A.x P.B.u s)) :sigma 0.1) (window {column} :length 1 :step 1))"""
    found = mbm.loads(text).solve(data=tables)
    values = {next(iter(each.key.values())): float(each["s"].value) for each in found.solves}
    assert values == pytest.approx({1.0: 5.0, 2.0: 10.0, 3.0: 15.0}, abs=EXACT * 30)
    assert [each.dof for each in found.solves] == [2, 2, 2]


@pytest.mark.parametrize("rows", [1, 3])
def test_the_usual_tolerance_is_one_for_all_keys(rows):
    """Keys of one row have no steps of their own; those of parallel runs a little apart are not the steps of the table.

    With three rows the steps are 1 within each run and 0.3 and 0.4 between the runs; half of 1 reaches 0.32, half of
    the least does not. With one row the only steps are those between the runs, 1.
    """
    run = np.repeat([1.0, 2.0], rows)
    t = np.array([0.0, 1.0]) if rows == 1 else np.array([0.0, 1, 2, 0.3, 1.3, 2.3])
    tables = {"A": {"run": run, "t": t, "x": t}, "B": {"run": run, "t": t + 0.32, "u": t + 3 * run}}
    found = mbm.loads(RUNS.format(how="", key="run").replace(":tolerance 0.1", "")).solve(data=tables)
    assert [float(each["s"].value) for each in found.solves] == pytest.approx([3.0, 6.0], abs=EXACT * 10)
    assert [each.dof for each in found.solves] == [rows - 1, rows - 1]


def test_a_pair_whose_tables_share_no_value_of_a_key_says_so():
    """The gain `g` of B is not the group `g` of A."""
    t = np.arange(3.0)
    tables = {"A": {"g": [1.0, 1.0, 2.0], "t": t, "x": t}, "B": {"g": [7.0, 8.0, 9.0], "t": t, "u": t}}
    for key in ("A.g", "g"):
        problem = mbm.loads(RUNS.format(how="", key=key))
        with pytest.raises(mbm.MbmError) as raised:
            problem.solve(data=tables)
        for told in (problem.check(data=tables), raised.value.diagnostics):
            (fault,) = [each for each in told if "pair" in each.message]
            assert fault.code.name == "no-rows"
            for words in ("`P`", "column `g`", "`A` (1, 2)", "`B` (7, 8, 9)"):
                assert words in fault.message
            assert ":columns" in fault.hint


@pytest.mark.parametrize("how", ["", ":interpolate true"])
def test_times_that_do_not_overlap_are_said_with_their_spans(how):
    text = f"""(problem p (data a external) (data b external) (pair both (a b) :by t :tolerance 1 {how})
      (unknowns (x)) (observe both (= a.y (+ x b.y))))"""
    data = {"a": {"t": [0.0, 1.0, 4.5], "y": [1.0, 2.0, 3.0]}, "b": {"t": [1000.0, 1007.25], "y": [1.0, 2.0]}}
    with pytest.raises(mbm.MbmError, match="no-equations") as caught:
        mbm.loads(text).solve(data=data).first.cost  # noqa: B018
    (said,) = caught.value.diagnostics
    assert "`both`" in said.message
    assert "from 0 to 4.5 in `a`" in said.message
    assert "from 1000 to 1007.25 in `b`" in said.message
