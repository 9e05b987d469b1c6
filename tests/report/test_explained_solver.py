"""`mbm explain` names the solver that `mbm solve` takes, and why."""

from __future__ import annotations

from pathlib import Path

import pytest

import mbm
from mbm.api import explain

CASES = [
    ("(unknowns (a) (b))", "", "linear", "one step of linear least squares: every equation is affine in the unknowns"),
    ("(unknowns (a positive) (b))", "", "lm", "some must stay positive"),
    ("(unknowns (a :in (0 9)) (b))", "", "lm", "some are bounded"),
    ("(unknowns (a :in (0 9) :init 1 :fixed true) (b))", "", "linear", "one step of linear least squares"),
    ("(unknowns (a :init 2 :fixed true) (b))", "(observe q (= 4 (* a b)) :sigma 1)", "linear", "one step"),
    ("(unknowns (a :init 2) (b :init 1))", "(observe q (= 4 (* a b)) :sigma 1)", "lm", "not affine"),
    ("(unknowns (a) (b))", "(solve :method dogleg)", "dogleg", "it is asked for"),
]


@pytest.mark.parametrize(("unknowns", "more", "solver", "reason"), CASES)
def test_the_solver_and_its_reason(unknowns: str, more: str, solver: str, reason: str, tmp_path: Path) -> None:
    text = f"(problem p {unknowns} (observe o (= 1 a) (= 2 (+ a b)) (= 3 b) :sigma 1) {more})"
    assert mbm.loads(text).solve().first.method == solver
    path = tmp_path / "p.mbm"
    path.write_text(text)
    said = explain(path).split("\nsolver\n")[1]
    assert reason in said


def test_windows_and_keys_are_said(tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text("""(problem p (data d (table (g t y) (1 0 1) (1 1 2) (1 2 3)) :columns ((t :unit ms)))
      (unknowns (a)) (observe d (= y a) :sigma 1) (for-each g) (window t :length 2ms :step 1ms :min-rows 2))""")
    said = explain(path).split("\nsolver\n")[1]
    assert "  one solve for each value of g\n" in said
    assert "  and for each window of 0.002 of t, one every 0.001 (SI units), with at least 2 rows\n" in said


def test_what_cannot_be_solved_is_still_explained(tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text("(problem p (data t (table (y s) (1 -1))) (unknowns (a)) (observe t (= y a) :sigma s))")
    assert "  none: " in explain(path)


@pytest.mark.parametrize(
    "kind", ["(rotation 2)", "(rotation 3)", "(pose 2)", "(pose 3)", "(similarity 2)", "direction", "(vector 3)"]
)
def test_an_unknown_is_named_as_it_was_declared(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text(f"(problem p (unknowns (T {kind}) (a)) (observe o (= 1 a) :sigma 1))")
    assert f"\n  T  {kind}\n" in explain(path)


@pytest.mark.parametrize(
    ("divided", "rows", "equation"),
    [
        (
            "(for-each k)",
            "(1 1) (1 2) (2 3)",
            "(a*d.x[1] + Piecewise((a*d.x[2], 1 < count(d)), (0, True)))/count(d) - 1*5",
        ),
        ("(for-each k)", "(1 1) (1 2)", "(a*d.x[1] + a*d.x[2])/2 - 1*5"),
        ("", "(1 1) (1 2)", "(a*1 + a*2)/2 - 1*5"),
    ],
)
def test_aggregates_in_constraints_read_cells_and_count_rows(
    tmp_path: Path, divided: str, rows: str, equation: str
) -> None:
    """A row by its number from 1, as the language counts, and how many rows the solve has, if not all have as many."""
    path = tmp_path / "means.mbm"
    path.write_text(
        f"""(problem means (data d (table (k x) {rows})) (unknowns (a)) (observe d (= x a) :sigma 1)
        {divided} (constraints (= (mean d (* a x)) 5 :name middle)))"""
    )
    assert f"constraint middle\n    0 = {equation}\n" in explain(path)
