"""Distributions of priors: their mean and standard deviation against SciPy, and what is no distribution."""

from __future__ import annotations

from math import log, sqrt

import pytest
from scipy.stats import arcsine, lognorm, norm, t, trapezoid, triang, uniform

import mbm

LAWS = {
    "(normal 2 0.3)": norm(2, 0.3),
    "(rectangular 1 3)": uniform(1, 2),
    "(triangular 1 3)": triang(0.5, 1, 2),
    "(trapezoidal 1 3 0.4)": trapezoid(0.3, 0.7, 1, 2),
    "(trapezoidal 1 3 0)": triang(0.5, 1, 2),
    "(trapezoidal 1 3 1)": uniform(1, 2),
    "(arcsine 1 3)": arcsine(1, 2),
    "(student 2 0.3 5)": t(5, 2, 0.3),
    "(lognormal 2 1.2)": lognorm(log(1.2), scale=2),
}


@pytest.mark.parametrize("text", LAWS)
def test_a_prior_alone_gives_its_mean_and_standard_deviation(text: str) -> None:
    mean, sigma = LAWS[text].mean(), LAWS[text].std()
    option = mbm.loads(f"(problem p (unknowns (a :prior {text})))").solve()
    head, rest = text[1:].split(" ", 1)
    constraint = mbm.loads(f"(problem p (unknowns (a :init 1)) (constraints ({head} a {rest}))").solve()
    for found in (option, constraint):
        assert float(found["a"].value) == pytest.approx(mean, rel=1e-9)
        assert float(found["a"].sigma) == pytest.approx(sigma, rel=1e-9)


def test_a_prior_and_a_reading_are_weighted() -> None:
    found = mbm.loads("(problem p (unknowns (a :prior (rectangular 1 3))) (observe (= 2.5 a) :sigma 0.5))").solve()
    weights = 3.0, 4.0
    assert float(found["a"].value) == pytest.approx((2 * weights[0] + 2.5 * weights[1]) / sum(weights))
    assert float(found["a"].sigma) == pytest.approx(1 / sqrt(sum(weights)))


def test_vectors_and_families_have_priors_by_element_and_row() -> None:
    found = mbm.loads("""
      (problem p
        (data g (table (k lo) ("a" 1) ("b" 5)) :key k)
        (unknowns (v (vector 2) :prior (triangular [0 1] 4)) (w :per g :prior (rectangular lo (+ lo 2)))))""").solve()
    assert found["v"].value == pytest.approx([2.0, 2.5])
    assert found["v"].sigma == pytest.approx([4 / sqrt(24), 3 / sqrt(24)])
    assert found["w"].value == pytest.approx([2.0, 6.0])
    assert found["w"].sigma == pytest.approx([2 / sqrt(12)] * 2)


def test_units_go_through() -> None:
    found = mbm.loads("(problem p (unknowns (a :unit mm :prior (rectangular 10mm 2cm))))").solve()
    assert float(found["a"].value) == pytest.approx(15.0)
    assert float(found["a"].sigma) == pytest.approx(10 / sqrt(12))


@pytest.mark.parametrize(
    "law", ["rectangular 1s 2s", "arcsine 1m 2s", "student 1m 2s 5", "student 1s 2m 5", "lognormal 1s 2"]
)
@pytest.mark.parametrize(
    "clauses", ["(unknowns (a :unit m :prior (LAW)))", "(unknowns (a :unit m)) (constraints (HEAD a REST))"]
)
def test_units_that_clash_are_refused_as_those_of_the_normal_distribution_are(law: str, clauses: str) -> None:
    head, rest = law.split(" ", 1)
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads("(problem p " + clauses.replace("LAW", law).replace("HEAD", head).replace("REST", rest) + ")").solve()
    assert caught.value.diagnostics[0].code.name == "unit-clash"


def test_the_prior_of_a_constant_has_the_dimension_of_the_constant() -> None:
    text = "(problem p (constants (c 3m :prior (rectangular 2s 4s))) (unknowns (a)) (observe (= c a) :sigma 1m))"
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(text).solve()
    assert "a time (s), but the constant is a length (m)" in caught.value.diagnostics[0].message


def test_the_start_is_init_where_it_is_given() -> None:
    found = mbm.loads("(problem p (unknowns (a :init 7 :prior (rectangular 1 3))) (observe (= 2 a) :sigma 1))")
    assert float(found.solve()["a"].value) == pytest.approx(2.0)


def test_a_function_of_the_user_goes_before_a_distribution_and_a_model_does_not() -> None:
    own = """(defun student (x) `(normal ,x 5 0.1))
      (problem p (unknowns (a :init 1)) (constraints (student 'a)))"""
    assert float(mbm.loads(own).solve()["a"].value) == pytest.approx(5.0)
    model = """(rectangular (x y) (vertexes (1 (x y 0))))
      (problem p (unknowns (a :init 1)) (constraints (rectangular a 1 3)))"""
    assert float(mbm.loads(model).solve()["a"].sigma) == pytest.approx(2 / sqrt(12))


def test_words_of_distributions_are_names_elsewhere() -> None:
    text = """(problem p (data d (table (normal) (2.0))) (unknowns (student))
      (observe d (= normal student) :sigma 1))"""
    assert float(mbm.loads(text).solve()["student"].value) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("clauses", "said"),
    [
        ("(unknowns (a :prior (student 1 0.1 2)))", "has no variance"),
        ("(unknowns (a :prior (rectangular 3 1)))", "not in order"),
        ("(unknowns (a :prior (trapezoidal 1 3 1.5)))", "from 0 to 1"),
        ("(unknowns (a :prior (lognormal 2 0.9)))", "geometric standard deviation"),
        ("(unknowns (a :prior (lognormal 2 1e200)))", "geometric standard deviation"),
        ("(unknowns (a :prior (lognormal 2m 3s)))", "is a pure number, and not a time (s)"),
        ("(unknowns (a :prior (student 2m 1m 5m)))", "is a pure number, and not a length (m)"),
        ("(unknowns (a :prior (rectangular 1)))", "takes a form, lo and hi"),
        ("(unknowns (a :prior (rectangular 1 2 3)))", "takes a form, lo and hi"),
        ("(unknowns (a :prior 3))", "is no distribution"),
        ("(unknowns (a :prior (gaussian 1 3)))", "is no distribution"),
        ("(unknowns (a :init 1 :sigma 2 :prior (rectangular 1 3)))", "two priors"),
        ("(unknowns (R (rotation 3) :prior (normal 1 3)))", "is for numbers"),
        ("(unknowns (b) (a :prior (rectangular 1 b)))", "known before the solve"),
        ("(unknowns (a)) (constraints (rectangular a 3 1))", "not in order"),
        ("(unknowns (a)) (constraints (triangular))", "about no form"),
        ("(unknowns (a)) (constraints (arcsine a 1 2 3))", "takes a form, lo and hi"),
    ],
)
def test_what_is_no_prior_says_so(clauses: str, said: str) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads(f"(problem p {clauses} (observe (= 1 a) :sigma 1))").solve()
    assert said in caught.value.diagnostics[0].message


def test_limits_that_meet_are_refused_where_data_say_so() -> None:
    text = '(problem p (data g (table (k lo hi) ("a" 1 1)) :key k) (unknowns (w :per g :prior (rectangular lo hi))))'
    with pytest.raises(mbm.MbmError):
        mbm.loads(text).solve()


def test_uniform_says_what_to_write_for_a_distribution() -> None:
    text = "(problem p (unknowns (a :init 1)) (observe (= 5 a) :sigma 1) (constraints (uniform a 0 2)))"
    found = mbm.loads(text).solve()
    assert any("(rectangular form lo hi)" in (each.hint or "") for each in found.first.diagnostics)
