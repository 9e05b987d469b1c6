"""Likelihoods that are highest at an end: rates without a single count, rounded readings without scatter."""

from __future__ import annotations

from math import log

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import mbm

NEAR = 5e-3
"""As for the other intervals of likelihoods: −log L is known to 0.01 between the places where it was looked at."""


@pytest.mark.parametrize("option", ["", "positive", ":in (0 100)"])
def test_no_counts_in_unequal_times_tell_a_rate(option: str) -> None:
    """exp(−r Σ t): one end for all rows, at exactly 0."""
    times = np.array([1.0, 2.0, 1.0, 3.0, 0.3])
    text = f"(problem p (data d external) (unknowns (r {option})) (observe d (= k (* r t)) :distribution poisson))"
    found = mbm.loads(text).solve(data={"d": {"k": np.zeros(5), "t": times}})
    assert found.solves[0].record.status == "converged"
    assert found["r"].value == pytest.approx(0.0, abs=1e-11)
    assert found["r"].interval() == pytest.approx([0.0, -log(0.05) / times.sum()], rel=NEAR, abs=1e-10)
    assert [each.code.name for each in found.solves[0].record.diagnostics] == ["near-bound"]


def test_neither_a_background_nor_what_is_beside_it_has_a_count() -> None:
    """exp(−2 (s + b) − 2 b) with b ≥ 0 and s + b ≥ 0 is exp(−2 |s|) at the best b, and exp(−2 b) at the best s."""
    text = """(problem p (data d (table (k) (0) (0))) (unknowns (s) (b))
        (observe d (= k (+ s b)) :distribution poisson) (observe blank d (= k b) :distribution poisson))"""
    found = mbm.loads(text).solve()
    assert found.solves[0].record.status == "converged"
    assert found["b"].interval() == pytest.approx([0.0, -log(0.05) / 2], rel=NEAR, abs=1e-10)
    assert found["s"].interval() == pytest.approx([log(0.05) / 2, -log(0.05) / 2], rel=NEAR)
    assert np.isnan(found["s"].sigma) and np.isnan(found["b"].sigma)


def test_counts_that_are_expected_to_be_none_hold_nothing() -> None:
    """Expectations that fall below all numbers in the tails of a line are no end of the likelihood: SciPy has it so."""
    place = np.array([-40.0, -15.0, 1.5, 3.4, 4.0, 5.0, 11.0, 23.0, 48.0])
    text = """(problem p (data d external) (unknowns (m :init 4))
        (observe d (= k (* 30 (exp (- (^ (- t m) 2))))) :distribution poisson))"""
    k = np.array([0.0, 0.0, 1.0, 12.0, 30.0, 9.0, 0.0, 0.0, 0.0])
    found = mbm.loads(text).solve(data={"d": {"k": k, "t": place}})

    def slope(m: float) -> float:
        mean = 30.0 * np.exp(-((place - m) ** 2))
        return float(((k - mean) * 2.0 * (place - m))[np.abs(place - m) < 20].sum())

    assert found["m"].value == pytest.approx(brentq(slope, 3.0, 5.0), abs=1e-8)
    assert found["m"].sigma > 0


@pytest.mark.parametrize(("low", "high"), [(7, 1), (19, 1), (9, 1), (5, 3), (4, 4)])
def test_readings_in_two_steps_tell_a_greatest_scatter_and_where_the_mean_is(low: int, high: int) -> None:
    """With σ → 0 and the mean so near to 5.5 that Φ is low/n the likelihood is highest, and equal for all small σ.

    Beyond 5.5 it is at most 2⁻ⁿ: unless both steps are alike, so much less that the interval ends at 5.5.
    """
    text = "(problem p (data d external) (unknowns (a)) (observe d (= y a) :sigma unknown :resolution 1))"
    found = mbm.loads(text).solve(data={"d": {"y": np.array([5.0] * low + [6.0] * high)}})
    assert found.solves[0].record.status == "unobservable"
    assert np.isnan(found["a"].sigma) and np.isnan(found["d-sigma"].sigma)
    bottom, top = found["a"].interval()
    assert 4.5 < bottom < 5.2
    share = low / (low + high)
    lost = (low + high) * log(2.0) + low * log(share) + high * log(1.0 - share)
    assert top == pytest.approx(5.5, abs=1e-5) if 2.0 * lost > 4.0 else 5.5 < top < 6.0
    least, most = found["d-sigma"].interval()
    assert least == 0.0 and most < 1.0


BESIDE = """(problem p (data d external) (unknowns (r {r}) (s {s}))
    (observe d (= n (+ (* r t) (* s u))) :distribution poisson))"""


@pytest.mark.parametrize(("r", "s"), [("", ""), (":init 1", ":init 5"), ("positive", "positive"), (":in (0 100)", "")])
@pytest.mark.parametrize("counts", [[0, 0, 9, 12], [0, 0, 30, 2], [0, 0, 2, 30]])
def test_a_rate_without_counts_in_rows_of_another_one_is_zero(r: str, s: str, counts: list[int]) -> None:
    """dL/dr at (0, N/2.3) is Σ t − Σ n t/(s u): where it is positive, the likelihood falls from r = 0 on."""
    t, u, n = np.arange(1.0, 5.0), np.array([0.0, 0.0, 1.0, 1.3]), np.array(counts, dtype=float)
    other = n.sum() / u.sum()
    assert t.sum() - (n[2:] * t[2:] / (other * u[2:])).sum() > 0.0
    found = mbm.loads(BESIDE.format(r=r, s=s)).solve(data={"d": {"n": n, "t": t, "u": u}})
    solve = found.solves[0]
    assert solve.status == "converged", solve.message
    assert found["s"].value == pytest.approx(other, rel=1e-9)
    value, (low, high) = float(found["r"].value), found["r"].interval()
    assert 0.0 <= value < 1e-30
    assert not np.signbit(value)
    assert low == pytest.approx(0.0, abs=1e-30)

    def left(rate: float) -> float:
        """Greatest likelihood over s of a rate, beside that of none."""

        def fall(s: float) -> float:
            mean = rate * t + s * u
            return float(mean.sum() - (n[2:] * np.log(mean[2:])).sum())

        best = minimize_scalar(fall, bounds=(1e-6, 100.0), method="bounded", options={"xatol": 1e-9}).fun
        return float(np.exp(fall_at_none - best))

    mean = other * u
    fall_at_none = float(mean.sum() - (n[2:] * np.log(mean[2:])).sum())
    grid = np.linspace(0.0, 3.0, 601)
    shares = np.array([left(float(each)) for each in grid])
    wanted = np.interp(0.95, np.cumsum(shares) / shares.sum(), grid)
    assert high == pytest.approx(wanted, abs=0.01)  # the grid has steps of 0.005


def test_what_rises_for_ever_has_its_interval_and_says_so() -> None:
    """exp(r) of nothing in 6 hours: log(−log(0.05)/6), whether a start is stated or not."""
    text = """(problem p (data d (table (t n) (1 0) (2 0) (3 0))) (unknowns (r {}))
        (observe d (= n (* t (exp r))) :distribution poisson))"""
    for start in ("", ":init 0"):
        found = mbm.loads(text.format(start)).solve()
        low, high = found["r"].interval()
        assert low == -np.inf
        assert high == pytest.approx(np.log(-np.log(0.05) / 6.0), abs=5e-3)
        assert found["r"].reason is not None
    assert "infinite" in mbm.loads(text.format("")).solve().solves[0].message
