"""What names and clauses may say twice, in which order, and around which row."""

from __future__ import annotations

import pytest

import mbm

EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""

ROWS = "(data t (table (y) (1) (2) (3)))"
CHAIN = {
    "a": "(data a external :with (b kb))",
    "b": "(data b external :key k :with (c kc))",
    "c": "(data c external :key k)",
}
TABLES = {
    "a": {"kb": ["p", "q"], "y": [10, 40]},
    "b": {"k": ["p", "q"], "kc": ["r", "s"]},
    "c": {"k": ["r", "s"], "v": [1, 2]},
}


def codes(text, **given):
    try:
        return [d.code.name for d in mbm.loads(text).check(**given)]
    except mbm.MbmError as error:
        return [d.code.name for d in error.diagnostics]


def test_a_chosen_row_sees_the_variables_around_it(estimate):
    text = f"(problem p {ROWS} (unknowns (a)) (observe t (let ((q 2)) (= y (* a (first t (* q y)))))))"
    assert estimate(text) == pytest.approx((1 + 2 + 3) / 3 / 2, rel=EXACT)
    text = f"(defun f (x) (last t (* x y))) (problem p {ROWS} (unknowns (a)) (observe t (= y (* a (f 5)))))"
    assert estimate(text) == pytest.approx((1 + 2 + 3) / 3 / 15, rel=EXACT)


def test_a_variable_and_a_column_of_the_chosen_row_are_not_confused():
    text = f"(problem p {ROWS} (unknowns (a)) (observe t (let ((y 2)) (= 1 (* a (first t {{}}))))))"
    assert "ambiguous-name" in codes(text.format("y"))
    assert codes(text.format("t.y")) == []


@pytest.mark.parametrize("name", ["first", "last", "if"])
def test_special_forms_cannot_be_defined(name):
    assert codes(f"(defun {name} (x) x) (problem p (unknowns (a)) (observe (= 1 a)))") == ["duplicate-definition"]
    assert codes(f"(problem p (unknowns (a)) (defun {name} (x) x) (observe (= 1 a)))") == ["duplicate-definition"]


def test_a_function_of_the_problem_is_defined_once():
    text = "(problem p (unknowns (a)) (defun f (x) x) (defun f (x) (* 2 x)) (observe (= 1 (f a))))"
    assert codes(text) == ["duplicate-definition"]


@pytest.mark.parametrize("order", ["abc", "acb", "bac", "bca", "cab", "cba"])
def test_joined_tables_may_stand_in_any_order(estimate, order):
    clauses = " ".join(CHAIN[name] for name in order)
    text = f"(problem p {clauses} (unknowns (x)) (observe a (= y (* x b.c.v))))"
    assert estimate(text, "x", data=TABLES) == pytest.approx((10 + 80) / 5, rel=EXACT)


def test_tables_that_join_in_a_circle_are_refused():
    clauses = f"{CHAIN['a']} {CHAIN['b']} (data c external :key k :with (b v))"
    text = f"(problem p {clauses} (unknowns (x)) (observe a (= y (* x b.c.v))))"
    assert codes(text, data=TABLES) == ["circular-definition"]


def test_a_table_may_join_itself(estimate):
    text = "(problem p (data t external :key k :with (parent t up)) (unknowns (a)) (observe t (= y (* a parent.y))))"
    data = {"t": {"k": [1, 2], "up": [1, 1], "y": [2, 6]}}
    assert estimate(text, data=data) == pytest.approx((2 * 2 + 2 * 6) / 8, rel=EXACT)


def test_a_joined_column_does_not_replace_one_that_is_there():
    text = "(problem p (data b external :key k) (data t external{}) (unknowns (a)) (observe t (= y (* a b.v))))"
    data = {"t": {"kb": [1], "kc": [1], "y": [1], "b.v": [7]}, "b": {"k": [1], "v": [1]}}
    assert codes(text.format(" :with (b kb)"), data=data) == ["duplicate-definition"]
    del data["t"]["b.v"]
    assert codes(text.format(" :with (b kb) :with (b b kc)"), data=data) == ["duplicate-definition"]


def test_a_problem_is_solved_one_way():
    text = f"(problem p {ROWS} (unknowns (a)) (observe t (= y a)) {{}})"
    assert codes(text.format("(solve :seed 3) (solve :max-iterations 4)")) == ["duplicate-definition"]
    assert codes(text.format("(for-each y) (for-each y)")) == ["duplicate-definition"]
    assert codes(text.format("(for-each)")) == ["bad-form"]
