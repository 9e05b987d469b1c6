"""Sliding windows: which rows each has, which are skipped, and that each answers as a solve of its rows alone."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm
from mbm.estimation.batches.solve import Together

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""

MEAN = "(problem p (data d external) (unknowns (a :init 0)) (observe d (= y a) :sigma 1 {when}) (window t {window}))"


def windows(t, length, step):
    """The definition of LANGUAGE §4, in whole multiples of 1e-6 so that no rounding decides."""
    ticks = np.round(np.asarray(t) * 1e6).astype(int)
    ends = range(ticks.min(), ticks.max() + 1, round(step * 1e6))
    return {end / 1e6: np.flatnonzero((ticks > end - round(length * 1e6)) & (ticks <= end)) for end in ends}


def solved(text, **data):
    return mbm.loads(text).solve(data=data)


@pytest.mark.parametrize(
    ("count", "spacing", "length", "step"),
    [(40, 0.1, 0.5, 0.1), (40, 0.1, 0.35, 0.2), (30, 1.0, 1000, 1), (9, 0.7, 2, 3)],
)
def test_each_window_holds_its_rows(count, spacing, length, step):
    t = np.arange(count) * spacing
    y = np.random.default_rng(1).normal(size=count)
    result = solved(MEAN.format(window=f":length {length} :step {step}", when=""), d={"t": t, "y": y})
    wanted = windows(t, length, step)
    assert [s.key["t"] for s in result.solves] == pytest.approx(list(wanted), abs=1e-12)
    found = [float(s.estimates[0].value) for s in result.solves]
    np.testing.assert_allclose(found, [y[rows].mean() for rows in wanted.values()], atol=1e-14)


def test_ends_are_written_as_the_data_write_them():
    t = np.array([0.0, 0.1, 0.2, 0.3])
    result = solved(MEAN.format(window=":length 1 :step 0.1", when=""), d={"t": t, "y": t})
    assert [s.key["t"] for s in result.solves] == [0.0, 0.1, 0.2, 0.3]  # 3 · 0.1 is not 0.3 in binary


def test_rows_need_not_be_in_order():
    random = np.random.default_rng(3)
    t, y = np.arange(20.0), random.normal(size=20)
    order = random.permutation(20)
    text = MEAN.format(window=":length 4 :step 2", when="")
    sorted_, shuffled = (solved(text, d={"t": t[o], "y": y[o]}) for o in (np.arange(20), order))
    means = [[float(s.estimates[0].value) for s in r.solves] for r in (sorted_, shuffled)]
    np.testing.assert_allclose(*means, atol=1e-14)


def test_windows_with_too_few_rows_are_skipped_and_no_failure():
    t = np.array([0.0, 1.0, 2.0, 7.0, 8.0, 9.0])
    y = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    result = solved(MEAN.format(window=":length 2 :step 1 :min-rows 2", when=""), d={"t": t, "y": y})
    statuses = [s.status for s in result.solves]
    assert statuses == ["skipped", "converged", "converged", *["skipped"] * 5, "converged", "converged"]
    assert result.status == "ok"
    document = json.loads(result.to_json())
    assert document["status"] == "ok"
    assert document["solves"][3]["status"] == "skipped"
    assert "1 row, and at least 2 are wanted" in document["solves"][3]["message"]
    assert document["solves"][3]["estimates"] == {}
    assert len(result.table()) == 10


def test_what_lies_before_a_window_is_looked_for_once(monkeypatch):
    """From each of the windows that are skipped, all before it were looked at: ten thousand of them took 8 s."""
    looked = []
    last = Together._last

    def counted(self, before, *others):
        looked.append(len(before))
        return last(self, before, *others)

    monkeypatch.setattr(Together, "_last", counted)
    text = MEAN.format(window=":length 1 :step 0.01 :min-rows 2", when="")
    result = solved(text, d={"t": np.array([0.0, 0.5, 40.0]), "y": np.array([1.0, 2.0, 4.0])})
    statuses = [s.status for s in result.solves]
    assert statuses.count("skipped") > 3800
    assert sum(looked) <= len(statuses)


def test_rows_that_when_leaves_out_do_not_count():
    t = np.arange(4.0)
    text = MEAN.format(window=":length 2 :step 1 :min-rows 2", when=":when (> y 0)")
    result = solved(text, d={"t": t, "y": np.array([1.0, -1.0, 1.0, 1.0])})
    assert [s.status for s in result.solves] == ["skipped", "skipped", "skipped", "converged"]


def test_with_for_each_every_key_has_windows_of_its_own():
    text = (
        "(problem p (data d external) (unknowns (a :init 0)) (observe d (= y a) :sigma 1)"
        " (for-each who) (window t :length 2 :step 2))"
    )
    data = {"who": ["x", "y", "x", "y", "x"], "t": [0.0, 5.0, 1.0, 6.0, 2.0], "y": [1.0, 10.0, 3.0, 20.0, 5.0]}
    result = solved(text, d=data)
    assert [dict(s.key) for s in result.solves] == [{"who": "x", "t": 0}, {"who": "x", "t": 2}, {"who": "y", "t": 5}]
    assert [float(s.estimates[0].value) for s in result.solves] == pytest.approx([1, 4, 10], rel=EXACT)


def test_tables_without_the_column_enter_whole_and_others_are_cut():
    text = """
    (problem p
      (data sites (table (name h) ("n" 10) ("s" 20)) :key name)
      (data d (table (t site y) (0 "n" 1) (1 "s" 2) (2 "s" 3)) :with (sites site))
      (data e (table (t z) (0 100) (1 200) (2 300)))
      (unknowns (a :init 0))
      (observe d (= (+ y sites.h) a) :sigma 1)
      (derive (newest (+ a (last d y) (last e z))))
      (window t :length 1 :step 1))
    """
    result = mbm.loads(text).solve()
    assert [float(s.estimates[0].value) for s in result.solves] == pytest.approx([11, 22, 23], rel=EXACT)
    newest = [float(s.derived[0].value) for s in result.solves]
    assert newest == pytest.approx([11 + 1 + 100, 22 + 2 + 200, 23 + 3 + 300], rel=EXACT)


def test_ends_span_the_rows_that_are_observed():
    text = """
    (problem p (data d (table (t y) (3 1) (4 2))) (data e (table (t z) (0 1) (9 2)))
      (unknowns (a :init 0)) (observe d (= y a) :sigma 1) (window t :length 1 :step 1))
    """
    assert [s.key["t"] for s in mbm.loads(text).solve().solves] == [3, 4]


def test_families_of_a_window_have_the_members_of_its_rows():
    text = """
    (problem p (data d (table (t k y) (0 1 5) (0 2 7) (1 2 9) (2 3 1)))
      (unknowns (m :per d.k :init 0)) (observe d (= y (m k)) :sigma 1) (window t :length 2 :step 1))
    """
    keys = [s.estimates[0].keys for s in mbm.loads(text).solve().solves]
    assert keys == [(1.0, 2.0), (1.0, 2.0), (2.0, 3.0)]


def test_a_window_starts_from_the_last_one_where_that_is_better():
    """A sine whose frequency the start misses: a few rows lead to it from there, all rows at once do not."""
    t = np.arange(0, 60, 0.25)
    y = np.sin(0.5 * t)
    text = """
    (problem p (data d external) (unknowns (w :init 0.3)) (observe d (= y (sin (* w t))) :sigma 0.1)
      (window t :length 100 :step 2 :min-rows 12))
    """
    result = solved(text, d={"t": t, "y": y})
    used = [s for s in result.solves if s.status != "skipped"]
    assert [float(s.estimates[0].value) for s in used] == pytest.approx([0.5] * len(used), abs=1e-9)
    alone = mbm.loads(text.split("(window")[0] + ")").solve(data={"d": {"t": t, "y": y}})
    assert abs(float(alone["w"].value) - 0.5) > 0.01  # a local minimum, which all rows at once lead to


def test_windows_take_the_units_of_their_column():
    text = (
        "(problem p (data d external :columns ((t :unit ms))) (unknowns (a :init 0)) (observe d (= y a) :sigma 1)"
        " (window t :length 20ms :step 10ms))"
    )
    result = solved(text, d={"t": [0.0, 10.0, 20.0], "y": [1.0, 2.0, 4.0]})
    assert [s.key["t"] for s in result.solves] == pytest.approx([0, 0.01, 0.02], rel=EXACT)
    assert [float(s.estimates[0].value) for s in result.solves] == pytest.approx([1, 1.5, 3], rel=EXACT)


def test_a_compiled_problem_slides_over_other_data():
    compiled = mbm.loads(MEAN.format(window=":length 2 :step 1", when="")).compile(
        data={"d": {"t": [0.0, 1.0], "y": [1.0, 3.0]}}
    )
    assert [float(s.estimates[0].value) for s in compiled.solve().solves] == pytest.approx([1, 2], rel=EXACT)
    again = compiled.solve(data={"d": {"t": [5.0, 6.0, 7.0], "y": [1.0, 3.0, 9.0]}})
    assert [float(s.estimates[0].value) for s in again.solves] == pytest.approx([1, 2, 6], rel=EXACT)


@pytest.mark.parametrize(
    ("clause", "code", "words"),
    [
        ("(window)", "bad-form", "names one column"),
        ("(window t :length 3)", "bad-form", "a length and a step"),
        ("(window s :length 3 :step 1)", "unknown-column", "`s`"),
        ("(window t :length 0 :step 1)", "bad-form", "above zero"),
        ("(window t :length 3m :step 1s)", "unit-clash", "`3m`"),
        ("(window t :length 3 :step 1 :min-rows 0)", "bad-form", "from 1 on"),
        ("(window name :length 3 :step 1)", "bad-time", "holds the text `x`"),
        ("(window t :length 3 :step 1) (window t :length 3 :step 1)", "duplicate-definition", "window"),
        ("(for-each t) (window t :length 3 :step 1)", "duplicate-definition", "`t`"),
        ("(window t :length 3 :step 1us)", "too-many-solves", "2000001 problems"),
    ],
)
def test_what_a_window_cannot_be(faults, clause, code, words):
    table = '(data d (table (t name y) (1s "x" 1) (3s "y" 2)))'
    found = faults(f"(problem p {table} {clause} (unknowns (a :init 0)) (observe d (= y a) :sigma 1))")
    assert found[0].code.name == code
    assert words in found[0].message


def test_a_row_without_a_time_is_named(faults):
    text = MEAN.format(window=":length 2 :step 1", when="")
    (fault,) = faults(text, data={"d": {"t": [0.0, np.nan], "y": [1.0, 3.0]}})
    assert (fault.code.name, fault.place.row, fault.place.column) == ("not-finite-cell", 2, "t")
