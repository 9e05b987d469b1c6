"""Standard deviations that follow the readings are doubted where that draws the estimates."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbm

CODE = "weights-from-readings"
MEAN = "(problem p (data d external) (unknowns (a)) (observe d {} :sigma {}) {})"
COUNTS = np.random.default_rng(3).poisson(30.0, (400, 8)).astype(np.float64)


def said(sigma: str, equation: str = "(= y a)", more: str = "", **columns: np.ndarray) -> list[list[str]]:
    solves = mbm.loads(MEAN.format(equation, sigma, more)).solve(data={"d": columns}).solves
    return [[each.message for each in solve.diagnostics if each.code.name == CODE] for solve in solves]


def shift(messages: list[str]) -> float:
    (message,) = messages
    (found,) = re.findall(r"by some (\S+) standard", message)
    return float(found)


def test_roots_of_counts_draw_the_mean_down() -> None:
    harmonic = COUNTS.shape[1] / (1 / COUNTS).sum(axis=1)
    drawn = (30.0 - harmonic.mean()) * np.sqrt(COUNTS.shape[1] / 30.0)
    found = said("(sqrt y)", more="(for-each run)", y=COUNTS.ravel(), run=np.repeat(np.arange(400.0), 8))
    # to first order, of counts of which second order is 1/30; the mean of 400 has a standard deviation of 0.05
    assert np.mean([shift(each) for each in found]) == pytest.approx(drawn, abs=0.15)
    assert shift(said("(sqrt y)", y=COUNTS[0])[0]) == pytest.approx(np.sqrt((1 / COUNTS[0]).sum()), rel=0.01)


def test_units_of_rates_do_not_matter() -> None:
    asked = said("(/ (sqrt n) 60)", "(= (/ n 60) a)", n=COUNTS[0])
    assert asked == said("(sqrt y)", y=COUNTS[0])


def test_percents_of_many_readings() -> None:
    y = 10.0 * (1.0 + 0.05 * np.random.default_rng(1).normal(size=100))
    assert shift(said("(* 5% y)", y=y)[0]) == pytest.approx(2 * 0.05 * np.sqrt(100), rel=0.02)
    assert shift(said("(unknown (* 0.05 y))", y=y)[0]) == pytest.approx(1.0, rel=0.2)  # noise told by 99 readings


def test_where_it_does_not_matter() -> None:
    assert said("(sqrt y)", y=1000.0 + COUNTS[0]) == [[]]
    assert said("(sqrt model)", y=COUNTS[0]) == [[]]
    assert said("5", y=COUNTS[0]) == [[]]
    assert said("(sqrt z)", y=COUNTS[0], z=COUNTS[1]) == [[]]


def test_deviations_that_fall_with_readings_favour_the_high_ones() -> None:
    y = 10.0 * (1.0 + 0.05 * np.random.default_rng(1).normal(size=100))
    ((low,),), ((high,),) = said("(* 5% y)", y=y), said("(/ 5 y)", y=y)
    assert "came out low weigh more" in low
    assert "came out high weigh more" in high
    assert np.sum(y**3) / np.sum(y**2) > y.mean() > np.sum(1 / y) / np.sum(1 / y**2)  # means with these weights


def test_the_reading_may_stand_on_the_side_of_the_model() -> None:
    asked = said("(sqrt y)", y=COUNTS[0])
    assert said("(sqrt y)", "(= a y)", y=COUNTS[0]) == asked
    assert said("(sqrt y)", "(= 0 (- y a))", y=COUNTS[0]) == asked
    assert said("(* 0.2 x)", "(= y (* a x))", y=COUNTS[0], x=COUNTS[1]) == [[]]  # x is known, and beside the unknown


def test_components_follow_their_own_readings() -> None:
    text = "(problem p (data d external) (unknowns (a (vector 2))) (observe d (= [u v] a) :sigma [{} {}]))"

    def of(first: str, second: str) -> list[str]:
        solve = mbm.loads(text.format(first, second)).solve(data={"d": {"u": COUNTS[0], "v": 1000.0 + COUNTS[1]}}).first
        return [each.message for each in solve.diagnostics if each.code.name == CODE]

    assert shift(of("(sqrt u)", "5")) == shift(said("(sqrt y)", y=COUNTS[0])[0])
    assert of("(sqrt v)", "(sqrt v)") == []
