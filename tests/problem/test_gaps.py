"""Rows without a number in a column that is used: named, and left out by what the error advises."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbm

GAPS = {"k": [1.0, np.nan, np.nan, 2.0], "t": [0.0, 1.0, 2.0, np.nan], "y": [1.0, 1.2, 3.0, 4.0]}
FULL = "(data f (table (k t z) (1 0 1) (2 1 2) (2 2 4)) :key t)"
PROBLEMS = {
    "for-each": ("k", "(observe d (= y m) :sigma 1 {when}) (for-each k)"),
    "for-each, derived": ("k", "(observe f (= z m) :sigma 1) (derive (q (* y m) :over d)) (for-each k)"),
    "for-each of two columns": ("k", "(observe d (= y m) :sigma 1 {when}) (for-each k t)"),
    "window": ("t", "(observe d (= y m) :sigma 1 {when}) (window t :length 2 :step 1)"),
    "an equation": ("t", "(observe d (= y (* m t)) :sigma 1 {when})"),
    "a condition": ("k", "(observe d (= y m) :sigma 1 :when {condition})"),
    "common errors": ("k", "(observe d (= y m) :sigma 1 :common ((1 :per k)) {when})"),
    "an aggregate": ("t", "(observe d (= y m) :sigma 1) (derive (q (mean d t)))"),
    "a sampled table": ("t", "(observe f (= z (+ m (sample d y t))) :sigma 1)"),
    "a quantity for each row": ("t", "(observe d (= y m) :sigma 1) (derive (q (* m t) :over d))"),
    "a constraint for each row": ("t", "(observe d (= y m) :sigma 1) (constraints (< m (+ 100 t) :over d))"),
    "steps": ("t", "(observe d (= y s) :sigma 1) (states :over t (s :init 0 :sigma 1)) (dynamics (static s))"),
}


def solved(clauses: str, where: str = "") -> mbm.Result:
    text = f"(problem p (data d external {where}) {FULL} (unknowns (m :init 0 :sigma 10)) {clauses})"
    return mbm.loads(text).solve(data={"d": GAPS})


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_mend_of_a_gap_mends(name):
    column, clauses = PROBLEMS[name]
    plain = clauses.format(when="", condition="(> k 0)")
    with pytest.raises(mbm.MbmError) as caught:
        solved(plain)
    found = caught.value.diagnostics
    assert {each.code.name for each in found} == {"not-finite-cell"}
    forms = {each.place.column: re.search(r"`(:when|:where|\(and) (\(finite \w+\))", each.hint) for each in found}
    assert column in forms
    word = forms[column].group(1)
    kept = f"(and {' '.join(each.group(2) for each in forms.values())})"
    if word == ":where":
        result = solved(plain, f":where {kept}")
    else:
        result = solved(clauses.format(when=f":when {kept}", condition="(and (finite k) (> k 0))"))
    for solve in result.solves:
        assert solve.status == "converged"
        assert np.isfinite(solve["m"].value)
        assert all(np.isfinite(value) for value in solve.key.values())


def test_a_gap_names_no_member():
    """Of the values 1 and 2 of a column with gaps, a family has the two."""
    result = mbm.loads(
        "(problem p (data d external) (unknowns (m :init 0 :per d.k))"
        " (observe d (= y (m k)) :sigma 1 :when (finite k)))"
    ).solve(data={"d": GAPS})
    assert result["m"].keys == (1.0, 2.0)
    np.testing.assert_allclose(result["m"].value, [1.0, 4.0], rtol=1e-12)  # one row each


def test_a_graph_that_gets_vertices_or_loses_them_is_read_anew(tmp_path):
    """Whether `:init` counts is decided by its columns, which hold numbers or gaps: not for good."""
    edges = "EDGE_SE2 0 1 1 0 1.5 100 0 0 100 0 400\nEDGE_SE2 1 2 1 0 1.5 100 0 0 100 0 400\n"
    vertices = "VERTEX_SE2 0 5 0 0\nVERTEX_SE2 1 6 0 1.5\nVERTEX_SE2 2 6 1 3\n"
    path = tmp_path / "p.mbm"
    path.write_text(
        '(problem p (data v (g2o "g.g2o" :vertices)) (data e (g2o "g.g2o" :edges))\n'
        "(unknowns (T (pose 2) :per v :fixed (= row 1) :init (pose2 x y theta)))\n"
        "(observe e (= (pose2 dx dy dtheta) (between (T from) (T to))) :information information))"
    )
    first = []
    for text in (vertices + edges, edges, vertices + edges):
        (tmp_path / "g.g2o").write_text(text)
        first.append(mbm.load(path).solve()["T"].value[0].tolist())
    assert first == [[0, 5, 0], [0, 0, 0], [0, 5, 0]]
