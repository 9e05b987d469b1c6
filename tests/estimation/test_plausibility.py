"""Warnings when data, stated noise and priors do not go together; none when they do."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TEXT = """(problem p
  (data d external)
  (unknowns (a :init 1 {prior}) (b :init 0))
  (observe d (= y (+ a (* b x))) :sigma {sigma})
  {more})"""
X = np.linspace(-1, 1, 40)
NOISE = np.random.default_rng(5).standard_normal(40)


def codes(*, prior: str = "", sigma: str = "0.1", more: str = "", mean: float = 1.0) -> list[str]:
    problem = mbm.loads(TEXT.format(prior=prior, sigma=sigma, more=more))
    solve = problem.solve(data={"d": {"x": X, "y": mean + 0.1 * NOISE}}).first
    assert solve.status == "converged"
    return [d.code.name for d in solve.diagnostics]


@pytest.mark.parametrize(("sigma", "warned"), [("0.1", False), ("0.08", False), ("0.04", True), ("1", False)])
def test_residuals_beyond_the_stated_noise(sigma: str, warned: bool) -> None:
    """chi² of 38 degrees of freedom at 0.04 is about 240: p is 1e-31; at 0.08 it is 60, p 1 %."""
    assert ("noise-against-data" in codes(sigma=sigma)) is warned


def test_unknown_noise_cannot_disagree() -> None:
    assert codes(sigma="unknown") == []


@pytest.mark.parametrize(
    ("mean", "sigma", "warned"),
    [(1.0, 0.1, False), (1.4, 0.1, False), (1.55, 0.1, True), (1.55, 0.3, False), (1.1, 0.001, True)],
)
def test_priors_far_from_what_the_data_say(mean: float, sigma: float, warned: bool) -> None:
    """The data alone give the mean ± 0.016 (0.1/√40): five and a half prior sigmas are too many, four not quite.

    With the prior of 0.001 it is the data that cannot move the estimate: six of their own 0.016.
    """
    found = codes(prior=f":sigma {sigma}", mean=mean)
    assert ("prior-against-data" in found) is warned


def test_a_prior_that_alone_determines_an_unknown_cannot_be_contradicted() -> None:
    problem = mbm.loads("(problem p (unknowns (a :init 1 :sigma 0.1)) (observe o (= 5 (+ 4 (* 0 a))) :sigma 1))")
    assert not [d for d in problem.solve().first.diagnostics if d.code.name == "prior-against-data"]


def test_contradicting_priors_name_both() -> None:
    more = "(constraints (normal a 3 0.1 :name low) (normal a 5 0.1 :name high))"
    problem = mbm.loads(TEXT.format(prior="", sigma="10", more=more))
    found = problem.solve(data={"d": {"x": X, "y": 4 + NOISE}}).first.diagnostics
    assert [d.message.split("`")[1] for d in found if d.code.name == "prior-against-data"] == ["low", "high"]


RECIPROCAL = """(problem p
  (data d external)
  (unknowns (b :init 1))
  (observe d (= y b) :sigma {sigma})
  (derive (reciprocal (/ 1 b)) (twice (* 2 b)) (both [(/ 1 b) b])))"""


def derived_warnings(sigma: float) -> list[str]:
    solved = mbm.loads(RECIPROCAL.format(sigma=sigma)).solve(data={"d": {"y": [1.0]}})
    return [d.message for d in solved.first.diagnostics if d.code.name == "too-nonlinear"]


def test_bent_derived_quantities_are_doubtful_though_the_model_is_linear() -> None:
    """1/b with b = 1 ± 0.15 lies in 0.773 … 1.416: 0.772 and 1.416 of the ±0.294 stated."""
    first, second = derived_warnings(0.15)
    assert first.endswith("`reciprocal` 0.77 times as far below and 1.4 times as far above")
    assert second.endswith("`both[1]` 0.77 times as far below and 1.4 times as far above")


def test_nearly_straight_derived_quantities_are_not() -> None:
    assert derived_warnings(0.05) == []


def test_a_derived_quantity_that_turns_back_is_told_so() -> None:
    """At 1 − 1.96·0.8 the reciprocal has passed infinity."""
    assert "turning back on the way above" in derived_warnings(0.8)[0]


@pytest.mark.parametrize("each", ["", " (for-each run)"])
@pytest.mark.parametrize(
    ("formula", "value", "sigma", "warned"),
    [
        ("(norm [(/ a (norm [a b])) (/ b (norm [a b]))])", 1.0, 0.0, []),
        ("(log (- a))", np.nan, None, ["derived-not-finite"]),
    ],
)
def test_derived_quantities_that_cannot_vary_or_have_no_value(each, formula, value, sigma, warned):
    """The length of a unit vector is 1, whatever the data; logarithms of negative numbers have no value."""
    rows = " ".join(f"({run} {x} {y})" for run in (1, 2) for x, y in ((1, 4.05), (2, 6), (3, 8.1 + run / 100)))
    found = mbm.loads(
        f"(problem p (data d (table (run x y) {rows})) (unknowns (a :init 1) (b :init 1)) "
        f"(observe d (= y (+ (* a x) (exp b))) :sigma 0.1) (derive (q {formula})){each})"
    ).solve()
    for solve in found.solves:
        np.testing.assert_allclose(solve.derived[0].value, value, rtol=1e-15)
        assert sigma is None or solve.derived[0].sigma == sigma
        assert [d.code.name for d in solve.diagnostics] == warned
