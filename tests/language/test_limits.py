"""Runaways that cost no form of their own, work that is long and honest, and matrices that are no rotations."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import mbm
from mbm.expression.nodes import Number
from mbm.language.limits import Budget, Limits
from mbm.language.scope import integer
from mbm.text.reader import read
from mbm.text.types import MbmError, Source

FORM = read(Source("form", "(range 1 9)"))[0]


def diagnostics(text, **given):
    try:
        return mbm.loads(text).check(**given)
    except MbmError as error:
        return error.diagnostics


@pytest.mark.parametrize(
    ("form", "code"),
    [
        ("(sum (i 1 40000) (sum (j 1 40000) 1))", "too-many-steps"),
        ("(sum (i 1 30000) (let ((r (range 1 90000))) 1))", "too-many-steps"),
        ("(sum (i 1 30000) (length (identity 300)))", "too-many-steps"),
        ("(sum (i 1 20000) (+ " + "a " * 500 + "))", "too-many-steps"),
        ("(sum (i 1 20000) (let (" + " ".join(f"(b{i} a)" for i in range(500)) + ") b1))", "too-many-steps"),
        ("(sum (i 1 1000000000000) 1)", "list-too-long"),
    ],
)
def test_a_runaway_ends_at_a_form(form, code):
    found = diagnostics(f"(problem p (unknowns (a :init 1)) (observe (= 1 {form})))")
    assert [d.code.name for d in found] == [code]
    assert found[0].place.text.startswith("(")


def test_constraints_that_run_away_end_with_one_error():
    text = "(for (i 1 1000) (for (j 1 1000) (for (k 1 1000) (normal a 0 1))))"
    found = diagnostics(f"(problem p (unknowns (a :init 1)) (observe (= 1 a)) (constraints {text}))")
    assert [d.code.name for d in found] == ["too-many-steps"]


def test_an_array_is_refused_by_the_number_of_its_elements():
    found = diagnostics("(problem p (unknowns (a (array 90000 90000))) (observe (= 1 1)))")
    assert [d.code.name for d in found] == ["list-too-long"]


def test_all_groups_of_rows_share_one_budget():
    text = "(problem p (data t external) (unknowns (a (vector 3000))) (observe t (= y (sum (i 1 {}) (* (a j) i)))))"
    data = {"t": {"j": list(range(1, 51)), "y": [1.0] * 50}}
    problem = mbm.loads(text.format(300))
    few = replace(problem.registry, limits=Limits(steps=2000, total_steps=20_000))
    found = replace(problem, registry=few).check(data=data)
    assert [d.code.name for d in found] == ["too-many-steps"]
    assert "together" in found[0].message


def test_two_hundred_groups_of_rows_are_no_runaway():
    text = "(problem p (data t external) (unknowns (a (vector 200))) (observe t (= y (sum (i 1 20) (* (a j) i)))))"
    data = {"t": {"j": list(range(1, 201)), "y": [1.0] * 200}}
    assert diagnostics(text, data=data) == ()


def test_the_total_counts_what_every_evaluation_took():
    budget = Budget(Limits(steps=100, total_steps=250))
    for _ in range(2):
        budget.reset(FORM.span)
        budget.spend(90, FORM)
    budget.reset(FORM.span)
    with pytest.raises(MbmError) as caught:
        budget.spend(90, FORM)
    assert "250" in caught.value.diagnostics[0].message


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1.5])
def test_what_is_no_whole_number_is_refused(value):
    with pytest.raises(MbmError) as caught:
        integer(Number(value), FORM.span)
    assert caught.value.diagnostics[0].code.name == "wrong-kind"


@pytest.mark.parametrize(
    "form",
    [
        "(rotate [[2 0] [0 1]] [1 2])",
        "(rotate [[1 1] [0 1]] [1 2])",
        "(pose3 [[1 0 0] [0 1 1e-6] [0 0 1]] [0 0 0])",
    ],
)
def test_a_matrix_of_numbers_turns_only_if_it_is_orthonormal(lisp, form):
    assert lisp.fault(form)[0] == "wrong-kind"


def test_a_rotation_may_be_given_as_a_matrix(lisp):
    assert lisp("(rotate [[0.6 -0.8] [0.8 0.6]] [5 10])") == pytest.approx([-5, 10], abs=1e-14)
    inverse = lisp("(transform (inverse (pose3 [[0 -1 0] [1 0 0] [0 0 1]] [1 2 3])) [1 2 3])")
    assert inverse == pytest.approx([0, 0, 0], abs=1e-15)


def test_a_matrix_with_unknowns_is_taken_at_its_word(lisp):
    assert lisp("(rotate [[c 0] [0 c]] [1 2])", c=3.0) == pytest.approx([3, 6])
