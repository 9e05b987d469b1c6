"""Intervals of what bends with uncertain constants, against quantiles in closed form or by drawing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi, chi2, halfnorm, norm, uniform

import mbm
from mbm.api.compiled import CompiledProblem

QUANTILE = 0.02
"""Of the interval's width: quantiles of 16,384 variates, interpolated between 128 solves."""

ROUGH = 0.04
"""The same of two or three constants together."""


def answer(constants: str, quantity: str) -> tuple[tuple[float, float], str, list[str]]:
    solve = mbm.loads(f"(problem p (constants {constants}) (derive (q {quantity})))").solve().document()["solves"][0]
    said = [each["message"] for each in solve["diagnostics"] if each["code"] == "too-nonlinear"]
    return solve["derived"]["q"]["interval"], solve["derived"]["q"]["interval_kind"], said


def check(found: tuple[float, float], wanted: tuple[float, float], share: float = QUANTILE) -> None:
    assert found == pytest.approx(wanted, abs=share * (wanted[1] - wanted[0]))


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
    check(found, tuple(np.quantile(drawn[quantity], (0.025, 0.975))), ROUGH)
    assert said


@pytest.mark.parametrize(
    ("constants", "quantity", "wanted"),
    [
        ("(v [0 0] :sigma 1)", "(norm v)", tuple(chi.ppf((0.025, 0.975), 2))),
        ("(a 0 :sigma 1)", "(max a 0)", (0.0, float(norm.ppf(0.975)))),
        ("(a 0 :sigma 1)", "(abs a)", tuple(halfnorm.ppf((0.025, 0.975)))),
    ],
)
def test_kinks_are_followed(constants: str, quantity: str, wanted: tuple[float, float]) -> None:
    found, _, said = answer(constants, quantity)
    check(found, wanted)
    assert found[0] >= 0.0
    assert said


@pytest.mark.parametrize(
    ("constants", "quantity", "wanted"),
    [
        # The product of two standard normal variates has the density K0(|z|)/pi.
        ("(a 0 :sigma 1) (b 0 :sigma 1)", "(* a b)", (-2.1817, 2.1817)),
        ("(c 0 :sigma 0.5)", "(^ c 3)", tuple((0.5 * norm.ppf((0.025, 0.975))) ** 3)),
        ("(c 0 :sigma 0.5)", "(exp (* 3 c))", tuple(np.exp(1.5 * norm.ppf((0.025, 0.975))))),
    ],
)
def test_what_no_derivative_at_the_value_tells(constants: str, quantity: str, wanted: tuple[float, float]) -> None:
    found, _, said = answer(constants, quantity)
    check(found, wanted, ROUGH)
    assert said


@pytest.mark.parametrize("limited", ["(w)", "(w :in (-10 10))", "(w :in (0 10))"])
def test_limits_elsewhere_change_nothing(limited: str) -> None:
    """A square, whether nothing limits an unknown beside it, or a limit is far, or holds it."""
    text = f"""(problem p (data d (table (y) (-0.3) (-0.1) (0.2))) (constants (c 0 :sigma 0.5)) (unknowns {limited})
      (observe d (= y w) :sigma 0.2) (derive (q (^ c 2))))"""
    found = mbm.loads(text).solve()["q"].interval()
    check((float(found[0]), float(found[1])), tuple(0.25 * chi2.ppf((0.025, 0.975), 1)))


def test_what_has_no_value_for_some_constants_is_doubted() -> None:
    """A tenth of all constants are negative: the interval stays linear, and is said not to be known."""
    found, kind, said = answer("(c 0.5 :sigma 0.4)", "(sqrt c)")
    middle, reach = np.sqrt(0.5), 1.959964 * 0.4 / (2 * np.sqrt(0.5))
    assert found == pytest.approx([middle - reach, middle + reach], rel=1e-3)
    assert kind == "t"
    assert "an unknown way" in said[0]


def test_solves_grow_with_the_number_of_constants_and_not_its_square(monkeypatch: pytest.MonkeyPatch) -> None:
    solves, own = [], CompiledProblem._solved
    monkeypatch.setattr(CompiledProblem, "_solved", lambda *given: solves.append(1) or own(*given))
    names = [f"c{i}" for i in range(20)]
    answer(" ".join(f"({name} 1 :sigma 0.2)" for name in names), f"(* {' '.join(names)})")
    # one, two for the derivative by each, four to look for curvature, 128 where there is some
    assert len(solves) <= 1 + 2 * 20 + 4 + 128


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
    # The pole at c = 0 is 3.3 standard deviations away, where solves still are: beside it what is interpolated is off.
    check(solve["derived"]["q"]["interval"], (low, high), 0.08)
    assert solve["estimates"]["a"]["interval_kind"] == "t"
