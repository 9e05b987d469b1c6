"""Robust options where there is little, nothing or too much to be robust about: an answer, or a diagnostic."""

from __future__ import annotations

import json

import numpy as np
import pytest

import mbm

PROBLEMS = {
    "one row": (
        "(problem p "
        "(data t (table (x y) (0 1))) "
        "(unknowns (a :init 1) (b :init 0)) "
        "(observe t (= y (+ a (* b x))) {o}) {s})"
    ),
    "exactly two": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2))) "
        "(unknowns (a :init 1) (b :init 0)) "
        "(observe t (= y (+ a (* b x))) {o}) {s})"
    ),
    "exact": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3) (3 4) (4 5))) "
        "(unknowns (a :init 1) (b :init 0)) "
        "(observe t (= y (+ a (* b x))) {o}) {s})"
    ),
    "exact noinit": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3) (3 4) (4 50))) "
        "(unknowns (a) (b)) "
        "(observe t (= y (+ a (* b x))) {o}) {s})"
    ),
    "unobs": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3) (3 4.1) (4 50))) "
        "(unknowns (a) (b) (c)) "
        "(observe t (= y (+ a b (* c x))) {o}) {s})"
    ),
    "prior only": ("(problem p (unknowns (a :init 1 :sigma 1)) (observe o (= 2 a) {o}) {s})"),
    "no rows": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2))) "
        "(unknowns (a :init 1 :sigma 1)) "
        "(observe t (= y a) :when (> x 5) {o}) {s})"
    ),
    "fixed": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 2.5) (3 9))) "
        "(unknowns (a :init 1) (b :init 1 :fixed true)) "
        "(observe t (= y (+ a (* b x))) {o}) {s})"
    ),
    "positive": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 4.2) (3 8.1) (4 100))) "
        "(unknowns (a positive :init 1) (b :init 0.5 :in (0 2))) "
        "(observe t (= y (* a (exp (* b x)))) {o}) {s})"
    ),
    "nan at start": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 4.2) (3 8.1) (4 100))) "
        "(unknowns (a :init -1)) "
        "(observe t (= y (* x (log a))) {o}) {s})"
    ),
    "nan row": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 4.2) (-3 8.1) (4 5))) "
        "(unknowns (a :init 1)) "
        "(observe t (= y (* a (sqrt x))) {o}) {s})"
    ),
    "two clauses": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3.1) (3 3.9) (4 50))) "
        "(data u (table (z) (1.1) (0.9) (1.0) (7))) "
        "(unknowns (a) (b)) "
        "(observe t (= y (+ a (* b x))) {o}) "
        "(observe u (= z a) {o}) {s})"
    ),
    "two equations": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3.1) (3 3.9) (4 50))) "
        "(unknowns (a) (b)) "
        "(observe t (= y (+ a (* b x))) (= x (+ a (* b y) -2)) {o}) {s})"
    ),
    "angle": (
        "(problem p "
        "(data t (table (y) (3.1rad) (-3.1rad) (3.12rad) (0.5rad) (3.0rad))) "
        "(unknowns (a angle :init 3)) "
        "(observe t (= y a) {o}) {s})"
    ),
    "family unused": (
        "(problem p "
        "(data k (table (id) (1) (2) (3)) :key id) "
        "(data t (table (id y) (1 1) (1 1.1) (1 5) (2 2) (2 2.1) (2 2.05))) "
        "(unknowns (a :per k :init 0)) "
        "(observe t (= y (a id)) {o}) {s})"
    ),
    "constraint": (
        "(problem p "
        "(data t (table (x y) (0 1) (1 2) (2 3.1) (3 3.9) (4 50))) "
        "(unknowns (a) (b)) "
        "(observe t (= y (+ a (* b x))) {o}) "
        "(constraints (= a b) (<= a 0.9)) {s})"
    ),
    "rotation": (
        "(problem p "
        "(data t (table (x y u v) (1 0 0 1) (0 1 -1 0) (1 1 -1 1.01) (2 0 5 5) (0 2 -2 0.01))) "
        "(unknowns (R (rotation 2))) "
        "(observe t (= [u v] (rotate R [x y])) {o}) {s})"
    ),
}
OPTIONS = (
    ("", "(solve :robust lmeds)"),
    (":sigma 0.1", "(solve :robust (ransac :threshold 2))"),
    (":sigma 0.1", "(solve :robust gnc)"),
    (":loss tukey", ""),
    (":sigma 0.1 :loss huber", "(solve :robust lmeds)"),
)


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem_gets_an_answer(name):
    for noise, solve in OPTIONS:
        result = mbm.loads(PROBLEMS[name].format(o=noise, s=solve)).solve()
        written = json.loads(result.to_json())["solves"][0]
        assert written["status"] in ("converged", "not-converged", "unobservable", "infeasible")
        for clause, summary in written["residuals"].items():
            rows = [r for r in result.solves[0].rows() if r.clause == clause]
            assert summary["used"] == len({r.row for r in rows if r.used})
            assert set(summary["outliers"]) <= {r.row for r in rows}


def test_a_row_without_a_value_is_an_outlier():
    result = mbm.loads(PROBLEMS["nan row"].format(o=":sigma 0.5", s="(solve :robust lmeds)")).solve()
    assert 4 in result.solves[0].residual_summaries["t"].outliers
    assert np.isfinite(result.solves[0].estimates[0].value)


ROOTED = """
(problem rooted (data d (table (x y) {rows}))
  (unknowns (a :init {a}) (b :init {b}) (c :init 0))
  (observe d (= y (+ c (* a (exp (- (* b x)))))) :sigma 0.01)
  (observe (= -0.2231 (log b)) :sigma 0.02)
  (solve :robust gnc))
"""


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("start", [(1, 0.5), (3, -0.05), (1, -0.02)])
def test_gnc_moves_from_where_one_block_has_no_value(seed, start):
    """The logarithm has none where b < 0; the numbers that the rows were made with are the oracle."""
    generator = np.random.default_rng(seed)
    x = generator.uniform(0, 4, 30)
    y = 2 * np.exp(-0.8 * x) + 0.3 + 0.01 * generator.standard_normal(30)
    y[:6] += generator.uniform(0.3, 1.0, 6)
    rows = " ".join(f"({a:.4f} {b:.4f})" for a, b in zip(x, y, strict=True))
    found = mbm.loads(ROOTED.format(rows=rows, a=start[0], b=start[1])).solve()
    assert found.first.status == "converged"
    # Some four standard deviations of 24 rows.
    np.testing.assert_allclose([found["a"].value, found["b"].value, found["c"].value], [2, 0.8, 0.3], atol=0.03)


EMPTY = """
(problem empty (data d external) (unknowns (p (vector 2)))
  (observe d (= y (distance p [x 0])) :sigma 0.1)
  (observe (= 1.0 (norm p)) :sigma 0.1)
  (solve :robust {rule}))
"""


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rule", ["lmeds", "ransac", "gnc"])
def test_a_table_without_rows_beside_another_observation(rule):
    """Equations of the table begin where those of the other observation do: they are told apart."""
    rows = {"x": np.zeros(0), "y": np.zeros(0)}
    found = mbm.loads(EMPTY.format(rule=rule)).compile(data={"d": rows}).solve()
    assert found.first.status in ("unobservable", "not-converged")
