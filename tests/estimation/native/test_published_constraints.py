"""Hock and Schittkowski's constrained problems (1981) whose objective is a sum of squares: published optima."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.equations.types import Reason

PROBLEMS = {
    "HS6": ("(a -1.2) (b 1)", "1 a)", "(= (* 10 (- b (* a a))) 0)", [1.0, 1.0]),
    "HS14": (
        "(a 2) (b 2)",
        "2 a) (= 1 b)",
        "(= (+ (- a (* 2 b)) 1) 0) (<= (+ (* 0.25 a a) (* b b)) 1)",
        [(np.sqrt(7) - 1) / 2, (np.sqrt(7) + 1) / 4],
    ),
    "HS22": ("(a 2) (b 2)", "2 a) (= 1 b)", "(<= (+ a b) 2) (<= (* a a) b)", [1.0, 1.0]),
    "HS28": (
        "(a -4) (b 1) (c 1)",
        "0 (+ a b)) (= 0 (+ b c))",
        "(= (+ a (* 2 b) (* 3 c)) 1)",
        [0.5, -0.5, 0.5],
    ),
    "HS42": (
        "(a 1) (b 1) (c 1) (d 1)",
        "1 a) (= 2 b) (= 3 c) (= 4 d)",
        "(= a 2) (= (+ (* c c) (* d d)) 2)",
        [2.0, 2.0, 0.6 * np.sqrt(2), 0.8 * np.sqrt(2)],
    ),
    "HS48": (
        "(a 3) (b 5) (c -3) (d 2) (e -2)",
        "1 a) (= 0 (- b c)) (= 0 (- d e))",
        "(= (+ a b c d e) 5) (= (- c (* 2 (+ d e))) -3)",
        [1.0, 1.0, 1.0, 1.0, 1.0],
    ),
    "HS51": (
        "(a 2.5) (b 0.5) (c 2) (d -1) (e 0.5)",
        "0 (- a b)) (= 2 (+ b c)) (= 1 d) (= 1 e)",
        "(= (+ a (* 3 b)) 4) (= (+ c d (* -2 e)) 0) (= b e)",
        [1.0, 1.0, 1.0, 1.0, 1.0],
    ),
    "HS65 without bounds": (
        "(a -5) (b 5) (c 0)",
        "0 (- a b)) (= 0 (/ (- (+ a b) 10) 3)) (= 5 c)",
        "(<= (+ (* a a) (* b b) (* c c)) 48)",
        [3.650461821, 3.650461821, 4.6204170507],
    ),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_optimum_and_multipliers(name, both):
    starts, observed, constraints, optimum = PROBLEMS[name]
    unknowns = starts.replace(" ", " :init ").replace(") :init (", ") (")
    text = f"(problem p (unknowns {unknowns}) (observe (= {observed} :sigma 1) (constraints {constraints}))"
    (pair,) = both.of(text)
    equations, _, _, general, native = pair
    assert native is not None
    # Constraints hold to 1e-12 units, estimates to 1e-10 sigmas; the published point of HS65 misses its own by 3e-6.
    digits = 1e-6 if "HS65" in name else 1e-9
    np.testing.assert_allclose(native.point, optimum, rtol=0, atol=digits)
    assert not native.constraints.violated.any()
    # Kuhn and Tucker: the gradient of ‖r‖²/2 is balanced by the multipliers, and those of inequalities are not below 0.
    pull = native.jacobian.T @ native.residuals + native.constraints.slopes.T @ native.constraints.multipliers
    np.testing.assert_allclose(pull, 0, atol=1e-6)
    assert (native.constraints.multipliers[~equations.equality] >= 0).all()
    # A cost that vanishes does so quadratically, one that does not is met as far as its slope across the constraints.
    assert native.cost == pytest.approx(general.cost, rel=1e-9, abs=1e-15)


def test_constraints_that_contradict_are_seen(both):
    text = "(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 a) (= 2 b) :sigma 1) "
    (pair,) = both.of(text + "(constraints (<= (+ a b) 1) (>= (+ a b) 2)))")
    assert pair[4].reason is Reason.INFEASIBLE
    assert pair[3].constraints.conflict is not None


def test_unknowns_that_constraints_alone_determine(both):
    text = "(problem p (unknowns (a :init 1) (b :init 1)) (observe (= 1 a) :sigma 1) (constraints (= b (* 3 a))))"
    (pair,) = both.of(text)
    np.testing.assert_allclose(pair[4].point, [1.0, 3.0], rtol=0, atol=1e-10)
