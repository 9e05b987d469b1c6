"""What an answer may not hide: unused members, noise that nothing tells, failed epochs, gaps in conditions."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mbm


def _estimate(document: dict, name: str, solve: int = 0) -> dict:
    found = document["solves"][solve]
    return found["estimates"].get(name) or found["derived"][name]


def _codes(text: str) -> set[str]:
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(text).solve()
    return {d.code.name for d in error.value.diagnostics}


FAMILY = """
(problem p
  (data c (table (k) (1) (2)) :key k)
  (data t (table (k y) (1 2) (1 3)))
  (unknowns (a :per c))
  (observe t (= y (a k)) :sigma 1)
  (derive (q (a 2)) (r (- (a 1) (a 2))) (s (* 2 (a 1)))))
"""


def test_an_unused_member_and_what_depends_on_it_have_no_value() -> None:
    document = mbm.loads(FAMILY).solve().document()
    assert document["status"] == "ok"
    assert document["solves"][0]["observability"]["unused"] == ["a[2]"]
    assert _estimate(document, "a")["value"] == [2.5, None]
    for name in ("q", "r"):
        assert _estimate(document, name)["value"] is None
        assert _estimate(document, name)["sigma"] is None
    assert _estimate(document, "s")["value"] == pytest.approx(5.0, rel=1e-12)
    # the mean of two values with sigma 1, doubled
    assert _estimate(document, "s")["sigma"] == pytest.approx(math.sqrt(2), rel=1e-12)


def test_noise_that_nothing_tells_gives_no_sigma_to_what_depends_on_it() -> None:
    text = """(problem p (data t (table (y) (2) (3) (2.5))) (unknowns (a :init 0) (b :init 0))
      (observe t (= y a) :sigma 1) (observe (= 3 (+ a b))) (derive (total (+ a b)) (twice (* 2 a))))"""
    document = mbm.loads(text).solve().document()
    assert _estimate(document, "a")["sigma"] == pytest.approx(1 / math.sqrt(3), rel=1e-9)
    assert _estimate(document, "b")["sigma"] is None
    assert _estimate(document, "total")["sigma"] is None
    assert _estimate(document, "twice")["sigma"] == pytest.approx(2 / math.sqrt(3), rel=1e-9)
    codes = {d["code"] for d in document["solves"][0]["diagnostics"]}
    assert "noise-not-estimated" in codes


def test_one_epoch_that_cannot_be_set_up_leaves_the_others_their_answers() -> None:
    text = """(problem p (data t (table (e y) (1 2) (1 3) (2 4) (3 7))) (unknowns (a :init 0))
      (observe t (= y a) :sigma 1 :when (< e 3)) (for-each e))"""
    document = mbm.loads(text).solve().document()
    assert document["status"] == "attention"
    assert [s["status"] for s in document["solves"]] == ["converged", "converged", "not-converged"]
    assert _estimate(document, "a", 0)["value"] == pytest.approx(2.5)
    assert document["solves"][2]["estimates"] == {}
    assert {d["code"] for d in document["solves"][2]["diagnostics"]} == {"no-equations"}


@pytest.mark.parametrize("condition", ["(< y 5)", "(not (> y 5))", "(and (< y 5) true)", "(or (< y 0) (< y 5))"])
def test_a_gap_leaves_a_condition_undecided(condition: str) -> None:
    data = {"t": {"y": [1.0, 2.0, math.nan]}}
    problem = mbm.loads(
        f"(problem p (data t external) (unknowns (a :init 0)) (observe t (= y a) :sigma 1 :when {condition}))"
    )
    with pytest.raises(mbm.MbmError) as error:
        problem.solve(data=data)
    assert [d.code.name for d in error.value.diagnostics] == ["not-finite-cell"]
    place = error.value.diagnostics[0].place
    assert (place.row, place.column) == (3, "y")  # type: ignore[union-attr]


@pytest.mark.parametrize("condition", ["(finite y)", "(and (finite y) (< y 5))", "(not (not (finite y)))"])
def test_a_gap_is_left_out_by_asking_for_it(condition: str) -> None:
    data = {"t": {"y": [1.0, 2.0, math.nan]}}
    text = f"(problem p (data t external) (unknowns (a :init 0)) (observe t (= y a) :sigma 1 :when {condition}))"
    assert mbm.loads(text).solve(data=data)["a"].value == pytest.approx(1.5)


def test_a_model_constrains_each_member_it_is_used_with_once() -> None:
    text = """
    (leg (l) (constraints (normal l 2 0.1)) (vertexes (1 (0 0 l))))
    (problem p
      (data parts (table (id) ("a") ("b")) :key id)
      (data t (table (id y) ("a" 2.3) ("b" 1.9) ("a" 2.5)))
      (unknowns (len :per parts :init 2))
      (observe t (= y ((vertex (leg (len id)) 1) 3)) :sigma 0.1))
    """
    document = mbm.loads(text).solve().document()
    found = _estimate(document, "len")
    # all weights are equal: a is the mean of 2.3, 2.5 and the prior's 2; b of 1.9 and 2
    assert found["value"] == pytest.approx([6.8 / 3, 3.9 / 2], rel=1e-12)
    assert found["sigma"] == pytest.approx([0.1 / math.sqrt(3), 0.1 / math.sqrt(2)], rel=1e-9)


def test_the_sigma_of_a_prior_with_covariance_is_that_of_its_diagonal() -> None:
    text = """(problem p (unknowns (v (vector 2) :init [1 2] :covariance [[4 3.9] [3.9 4]]))
      (observe (= 3 (v 1)) :sigma 1))"""
    priors = mbm.loads(text).solve().document()["solves"][0]["priors"]
    assert [p["sigma"] for p in priors] == pytest.approx([2.0, 2.0], rel=1e-9)


def test_other_data_are_selected_by_their_own_values() -> None:
    text = '(problem p (data t external) (unknowns (a :init 0)) (observe t (= y a) :sigma 1 :when (not (= k "b"))))'
    problem = mbm.loads(text)
    compiled = problem.compile(data={"t": {"k": ["a", "b", "a"], "y": [1.0, 50.0, 3.0]}})
    other = {"t": {"k": ["a", "b", "c"], "y": [1.0, 50.0, 3.0]}}
    again = compiled.solve(data=other)["a"].value
    assert again == pytest.approx(2.0)
    assert again == pytest.approx(float(problem.solve(data=other)["a"].value))


def test_a_derived_vector_with_one_angle_has_no_unit_of_its_own() -> None:
    text = """(problem p (unknowns (x :init 2 :unit m) (th angle :init 1))
      (observe (= [2m 1] [x th]) :sigma [1m 1]) (derive (v [x th])))"""
    assert mbm.loads(text).solve()["v"].unit is None


@pytest.mark.parametrize(
    ("unknown", "code"),
    [
        ("(c positive :in (-5 -1))", "bad-bounds"),
        ("(c positive :init -3)", "bad-bounds"),
        ("(c :in (3 2))", "bad-bounds"),
    ],
)
def test_impossible_starts_and_bounds_are_refused(unknown: str, code: str) -> None:
    assert _codes(f"(problem p (unknowns {unknown}) (observe (= 1 (* c c)) :sigma 1))") == {code}


@pytest.mark.parametrize(
    "clauses",
    [
        "(derive (q a) (q (* 2 a)))",
        "(derive (q (* a row) :over t) (q (* 2 a row) :over t))",
        "(derive (q a) (q (* 2 a row) :over t))",
        "(derive (q (* 2 a row) :over t) (q a))",
    ],
)
def test_a_derived_name_is_given_once(clauses: str) -> None:
    text = f"(problem p (data t (table (y) (1) (2))) (unknowns (a)) (observe t (= y a) :sigma 1) {clauses})"
    assert _codes(text) == {"duplicate-definition"}


def test_what_is_free_is_called_by_its_finite_motion() -> None:
    data = "(problem p (data t (table (x y) (1 2) (2 4)))"
    product = f"{data} (unknowns (a :init 1) (b :init 1)) (observe t (= y (* a b x)) :sigma 1))"
    total = f"{data} (unknowns (a) (b)) (observe t (= y (* x (+ a b))) :sigma 1))"
    for text, words in ((product, "only their product"), (total, "only their sum")):
        found = mbm.loads(text).solve().document()["solves"][0]
        assert found["status"] == "unobservable"
        assert words in found["observability"]["unobservable"][0]["sentence"]
        assert np.isclose(found["cost"], 0.0, atol=1e-20)


def test_keys_of_different_tables_that_combine_to_too_many_solves_are_refused() -> None:
    text = """(problem p (data s external) (data t external) (unknowns (a :init 0))
      (observe s (= y a) :sigma 1) (observe t (= y a) :sigma 1) (for-each i j))"""
    numbers = np.arange(1001.0)
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(text).solve(data={"s": {"i": numbers, "y": numbers}, "t": {"j": numbers, "y": numbers}})
    assert [d.code.name for d in error.value.diagnostics] == ["too-many-solves"]


@pytest.mark.parametrize(
    ("clauses", "code"),
    [
        ("(unknowns (a)) (observe t (= y a) :sigma -0.1)", "bad-noise"),
        ("(unknowns (a)) (observe t (= [y y] [a a]) :covariance [[1 2] [2 1]])", "bad-noise"),
        ("(unknowns (a :in (3 2))) (observe t (= y a) :sigma 1)", "bad-bounds"),
        ("(unknowns (a positive :init -1)) (observe t (= y a) :sigma 1)", "bad-bounds"),
    ],
)
def test_check_refuses_what_a_solve_would_refuse_before_its_first_step(clauses: str, code: str) -> None:
    problem = mbm.loads(f"(problem p (data t (table (y) (1) (2))) {clauses})")
    assert {d.code.name for d in problem.check()} == {code}
