"""Units of what stands beside the equations: filters, fixed unknowns, matrices of noise; and powers by constants."""

from __future__ import annotations

import pytest

import mbm

DATA = "(data t (table (r s) (1m 1s) (2m 2s)))"


def codes(text):
    return [d.code.name for d in mbm.loads(text).check()]


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        (":information 5s", ["unit-clash"]),
        (":information (/ 5 1m^2)", []),
        (":sigma 1m :when (< r 5s)", ["unit-clash"]),
        (":sigma 1m :when (< r 5m)", []),
    ],
)
def test_options_of_an_observation(option, expected):
    assert codes(f"(problem p {DATA} (unknowns (a)) (observe t (= r a) {option}))") == expected


def test_filters_of_tables():
    text = "(problem p (data t (table (r) (1m) (2m)) :where (< r {})) (unknowns (a)) (observe t (= r a)))"
    assert codes(text.format("5s")) == ["unit-clash"]
    assert codes(text.format("5m")) == []


def test_conditions_of_fixed():
    text = "(problem p {} (unknowns (a) (b :init 1 :fixed (< 1m 1{}))) (observe t (= r (* b a)) :sigma 1m))"
    assert codes(text.format(DATA, "s")) == ["unit-clash"]
    assert codes(text.format(DATA, "cm")) == []


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ("[[1m^2 (* 1m 0.1s)] [(* 1m 0.1s) 1s^2]]", []),
        ("[[1m^2 0] [0 1s^2]]", []),
        ("[[1m^2 0.1m] [0.1m 1s^2]]", ["unit-clash", "unit-clash"]),
    ],
)
def test_all_elements_of_a_covariance(matrix, expected):
    text = f"(problem p {DATA} (unknowns (a) (b)) (observe t (= [r s] [a b]) :covariance {matrix}))"
    assert codes(text) == expected


@pytest.mark.parametrize("exponent", ["2", "n", "(- (- n))", "(/ (* 2 n) 2)"])
def test_powers_by_constants_have_units(exponent):
    text = f"(problem p (constants (n 2)) {DATA} (unknowns (a)) (observe t (= (^ r {exponent}) a) :sigma {{}}))"
    assert codes(text.format("1m^2")) == []
    assert codes(text.format("1m")) == ["unit-clash"]
