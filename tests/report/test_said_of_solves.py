"""What is said of solves: names, units, places and counts, told by the problem or counted by hand."""

from __future__ import annotations

import io
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mbm
from mbm.cli.output import is_terminal
from mbm.estimation.search import twins
from mbm.estimation.solve import estimate
from mbm.problem.scopes import _exact
from mbm.report.beginnings import with_beginnings
from mbm.report.table import table
from mbm.shapes.model import _key
from mbm.testing import coverage
from mbm.text.printer import print_form
from mbm.text.types import Source, Span

MEAN = "(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma 1) {})"


def test_what_no_equation_mentions_has_no_value_where_it_is_used():
    solved = mbm.loads("""(problem p (data m (table (k) ("a") ("b"))  :key k) (data d (table (w y) ("a" 1) ("a" 2)))
      (unknowns (u :per m)) (observe d (= y (u w)) :sigma 1) (derive (f (* 2 (u k)) :over m)))""").solve()
    value, sigma = solved["f"].value, solved["f"].sigma
    # twice the mean of 1 and 2
    assert (value[0], sigma[0]) == (pytest.approx(3.0), pytest.approx(2.0 / np.sqrt(2.0)))
    assert np.isnan(value[1])
    assert np.isnan(sigma[1])


def test_doubts_of_a_derived_quantity_are_those_of_each_solve_by_itself():
    """1/a of four readings at a = 0.9 (a ± 0.5) bends, at a = 90 it does not."""
    problem = "(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma 1) (derive (f (/ 1 a))) {})"
    near = np.array([0.7, 1.5, 0.2, 1.2])
    y = np.concatenate([near + 89.0 * (k % 2) for k in range(24)])
    many = mbm.loads(problem.format("(for-each k)")).solve(data={"d": {"y": y, "k": np.repeat(np.arange(24), 4)}})
    alone = [mbm.loads(problem.format("")).solve(data={"d": {"y": y[4 * k : 4 * k + 4]}}) for k in range(2)]
    expected = [[each.code.name for each in solved.diagnostics] for solved in alone]
    assert expected == [["too-nonlinear"], []]
    assert [[each.code.name for each in solve.diagnostics] for solve in many.solves] == expected * 12


def test_a_solve_that_was_not_made_has_no_covariance():
    data = {"y": [1.0, 2.0, 3.0], "s": [1.0, 1.0, 0.0], "k": [1, 1, 2]}
    text = "(problem p (data d external) (unknowns (a :init 1)) (observe d (= y a) :sigma s) (for-each k))"
    first, second = mbm.loads(text).solve(data={"d": data}).solves
    assert first.covariance is not None
    assert first.covariance.matrix == pytest.approx(np.array([[0.5]]))
    assert second.covariance is None


def test_rows_of_files_are_told_by_their_lines(tmp_path: Path):
    """The first line of the file is its header."""
    (tmp_path / "a.csv").write_text("x\n1\n2\n4\n")
    problem = mbm.loads('(problem p (data d (csv "a.csv")) (unknowns (a)) (observe d (= x a) :sigma 1))', base=tmp_path)
    rows = problem.solve().record.rows()
    assert [(row.row, row.file_row) for row in rows] == [(1, 2), (2, 3), (3, 4)]


def test_what_has_no_value_is_counted_where_it_has_rows():
    solved = mbm.loads("""(problem p (data d (table (x y) (1 1) (2 2.5) (-3 -3.4) (-4 -4))) (unknowns (a))
      (observe d (= y (* a x)) :sigma 1) (derive (f (log (* a x)) :over d) (g (log (- a)))))""").solve()
    said = [each.message for each in solved.diagnostics if each.code.name == "derived-not-finite"]
    assert ["in 2 rows" in message for message in said] == [True, False]
    assert not any("row" in message for message in said[1:])


def test_the_bound_that_holds_is_named_alone():
    text = "(problem p (data d (table (x y) (0 1) (1 2) (2 3.1))) (unknowns (a :in {}) (b))"
    text += " (observe d (= y (+ a (* b x))) :sigma 1))"
    for limits, side in (("(2 5)", "lower"), ("(-5 0.5)", "upper")):
        found = mbm.loads(text.format(limits)).solve().diagnostics
        assert [each.message for each in found if each.code.name == "near-bound"] == [
            f"`a` is held at its {side} bound"
        ]


def test_rows_that_consensus_leaves_out_count_nothing():
    x = np.arange(12.0)
    y = np.append(0.5 + x[:-1] + 0.01 * np.resize([1, -1, 0.5], 11), 50.0)
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 0.05)"
    solved = mbm.loads(text + " (solve :robust lmeds))").solve(data={"d": {"x": x, "y": y}})
    assert [row.weight for row in solved.record.rows()] == [1.0] * 11 + [0.0]


@pytest.mark.parametrize(("keys", "cells"), [(["bb", "a"], ["bb", "a "]), ([10, 9], ["10", " 9"])])
def test_keys_of_texts_begin_at_one_column_and_numbers_end_at_one(keys, cells):
    solved = mbm.loads(MEAN.format("(for-each k)")).solve(data={"d": {"y": [1.0, 2, 3, 4], "k": np.repeat(keys, 2)}})
    lines = table(solved.result, width=80, color=False).splitlines()
    assert [line[:2] for line in lines[3:5]] == cells


def test_derived_angles_agree_by_whole_turns_and_other_numbers_do_not():
    def agree(angle: bool, turned: float) -> bool:
        rows = SimpleNamespace(values=lambda point: point.reshape(1, 1))
        problem = SimpleNamespace(derived=(SimpleNamespace(angle=angle),))
        binder = SimpleNamespace(derived=lambda _kernels, _owner: (rows,))
        same = twins.derived_agreement(problem, binder, None)
        return same(np.array([0.4]), np.array([0.4 + turned]))

    assert agree(angle=True, turned=2 * np.pi)
    assert not agree(angle=True, turned=np.pi)
    assert not agree(angle=False, turned=2 * np.pi)
    assert agree(angle=False, turned=0.0)


def test_keys_that_are_whole_numbers_are_written_so():
    span = Span(source=Source("<text>", "k"), start=0, end=1)
    assert [print_form(_key(key, span)) for key in (3.0, 2.5, "north")] == ["3", "2.5", '"north"']
    assert [(_exact(value), type(_exact(value))) for value in (3.0, 2.5)] == [(3, int), (2.5, float)]


def test_a_stream_that_is_closed_shows_nobody_anything():
    stream = io.StringIO()
    stream.close()
    assert not is_terminal(stream)


def test_the_share_of_runs_with_warnings():
    asked = coverage._summary([], 8, 0, 2)
    assert asked.warned == 0.25
    assert coverage._summary([], 0, 0, 0).warned == 0.0


def test_starts_of_members_are_columns_of_their_table():
    """One for each number of a vector, counted from 1."""
    found = (
        mbm.loads("""(problem p (data m (table (k h) ("a" 0) ("b" 0)) :key k)
      (data d (table (w x y) ("a" 1 2) ("b" 3 4)))
      (unknowns (u (vector 2) :per m)) (observe d (= [x y] (u w)) :sigma 1))""")
        .compile()
        .elaborated
    )
    begun = with_beginnings(found, {"u": [[1.0, 2.0], [3.0, 4.0]]}).raw["m"]
    assert begun.columns["u start 1"].numbers.tolist() == [1.0, 3.0]
    assert begun.columns["u start 2"].numbers.tolist() == [2.0, 4.0]


def test_ends_with_corrections_are_confirmed_and_no_others():
    asked = []
    end = SimpleNamespace(bad_row=None, point=np.zeros(2))
    exact = SimpleNamespace(implicit=None)
    corrected = SimpleNamespace(implicit=SimpleNamespace(forget=asked.append), residuals=lambda point: point)
    assert estimate.confirmed(exact, end) is end
    assert not asked
    assert estimate.confirmed(corrected, end) is end
    assert asked == [end.point]


def test_another_solution_is_told_by_unknowns_that_are_one_number_first():
    """v = (2, 0), x = 10, or v = (−2, 0), x = 14: v differs by twice its size, x by a third."""
    text = """(problem p (unknowns (v (vector 2)) (x))
      (observe (= 4 (^ (v 1) 2)) :sigma 1) (observe (= 0 (v 2)) :sigma 1) (observe (= 12 (+ x (v 1))) :sigma 1)
      (solve :starts (given ((v [2 0]) (x 10)) ((v [-2 0]) (x 14)))))"""
    assert ", with x = 14, v[1] = -2" in str(mbm.loads(text).solve())
