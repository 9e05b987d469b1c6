"""Intervals of what bends with uncertain constants, against quantiles in closed form or by drawing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, norm, uniform

import mbm

QUANTILE = 0.02
"""Of the interval's width: quantiles of 16,384 points, of polynomials of the fourth degree."""


def answer(constants: str, quantity: str) -> tuple[tuple[float, float], str, list[str]]:
    solve = mbm.loads(f"(problem p (constants {constants}) (derive (q {quantity})))").solve().document()["solves"][0]
    said = [each["message"] for each in solve["diagnostics"] if each["code"] == "too-nonlinear"]
    return solve["derived"]["q"]["interval"], solve["derived"]["q"]["interval_kind"], said


def check(found: tuple[float, float], wanted: tuple[float, float]) -> None:
    assert found == pytest.approx(wanted, abs=QUANTILE * (wanted[1] - wanted[0]))


def test_a_square_at_zero_has_the_interval_of_chi_squared() -> None:
    found, kind, said = answer("(c 0 :sigma 0.5)", "(^ c 2)")
    check(found, tuple(0.25 * chi2.ppf((0.025, 0.975), 1)))
    assert kind == "profile"
    assert "beyond its width of 0" in said[0]


def test_an_exponential_is_lognormal() -> None:
    found, _, said = answer("(c 1 :sigma 0.6)", "(exp c)")
    check(found, tuple(np.exp(1 + 0.6 * norm.ppf((0.025, 0.975)))))
    assert "times as far" in said[0]


@pytest.mark.parametrize("quantity", ["(* a b)", "(+ (* a a) (* b b) c)", "(- (* a b) (* b c))"])
def test_pairs_bend_together(quantity: str) -> None:
    a, b, c = np.random.default_rng(2).normal([[0.1], [0.2], [0.1]], 0.5, (3, 400_000))
    drawn = {"(* a b)": a * b, "(+ (* a a) (* b b) c)": a * a + b * b + c, "(- (* a b) (* b c))": a * b - b * c}
    found, _, said = answer("(a 0.1 :sigma 0.5) (b 0.2 :sigma 0.5) (c 0.1 :sigma 0.5)", quantity)
    check(found, tuple(np.quantile(drawn[quantity], (0.025, 0.975))))
    assert said


def test_a_rectangular_constant_alone_has_its_own_interval_and_no_doubt() -> None:
    found, _, said = answer("(c 1 :prior (rectangular 0 2))", "(* 3 c)")
    check(found, tuple(uniform.ppf((0.025, 0.975), 0, 6)))
    assert not said


def test_what_hardly_bends_stays_linear() -> None:
    found, kind, said = answer("(a 1 :sigma 0.02) (b 2 :sigma 0.02)", "(* a b)")
    reach = 1.959964 * np.hypot(2, 1) * 0.02
    assert found == pytest.approx([2 - reach, 2 + reach], rel=1e-6)
    assert (kind, said) == ("t", [])


def test_scatter_counts_beside() -> None:
    rows = "(1.9) (2.1) (2.05) (1.95)"
    text = f"""(problem p (constants (c 1 :sigma 0.3)) (data d (table (y) {rows})) (unknowns (a))
      (observe d (= y a) :sigma 0.6) (derive (q (/ a (^ c 2)))))"""
    solve = mbm.loads(text).solve().document()["solves"][0]
    rng = np.random.default_rng(3)
    drawn = 0.3 * rng.normal(size=400_000) + 2 * (1 + 0.3 * rng.normal(size=400_000)) ** -2.0
    low, high = np.quantile(drawn, (0.025, 0.975))
    # The upper end lies where c is nearly half of its value: there a polynomial is off by some percent.
    assert solve["derived"]["q"]["interval"] == pytest.approx([low, high], abs=0.08 * (high - low))
    assert solve["estimates"]["a"]["interval_kind"] == "t"
