"""The harness finds stated uncertainties true where they are, and false where they are made false."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.testing.coverage import Coverage, coverage
from tests.testing.simulated import KINDS, judged

CHANCE = 4.0
"""Deviations of chance that a right answer may show: one of these assertions in 16,000."""

QUICK = ("linear", "unknown noise", "angle", "prior", "equality", "errors on both sides")


def assert_true(found: Coverage, *, systematic: float = 0.0) -> None:
    """Ratios and coverage within chance, and within ``systematic`` besides."""
    assert found.failures == 0
    assert abs(found.pooled - 1) < CHANCE * found.pooled_error + systematic
    for number in found.numbers:
        assert abs(number.ratio - 1) < CHANCE * number.ratio_error + systematic, number
    for level in (0, 1):
        share, spread = found.expected_coverage(level)
        inside = float(np.mean([number.covered[level] for number in found.numbers]))
        assert abs(inside - share) < CHANCE * spread + systematic, level
    assert found.cost_p is None or found.cost_p > 1e-4


@pytest.mark.parametrize("name", QUICK)
def test_stated_uncertainties_are_true(name: str) -> None:
    assert_true(judged(KINDS[name], 150, seed=11))


@pytest.mark.parametrize(
    "name", ["nonlinear", "unknown noise", "two unknown noises", "pose", "consensus, 10 % outliers"]
)
def test_runs_in_one_table_say_what_they_say_one_by_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    together = judged(KINDS[name], 12, seed=3)
    monkeypatch.setattr("mbm.report.simulated.Simulator.repeated", lambda *_: None)
    alone = judged(KINDS[name], 12, seed=3)
    assert (together.failures, together.warned) == (alone.failures, alone.warned)
    assert [number.name for number in together.numbers] == [number.name for number in alone.numbers]
    for one, other in zip(together.numbers, alone.numbers, strict=True):
        assert one.covered == other.covered
        # the same draws; both minima are exact to 1e-10 standard deviations
        assert [one.ratio, one.bias] == pytest.approx([other.ratio, other.bias], rel=1e-8, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(KINDS))
def test_stated_uncertainties_are_true_to_three_percent(name: str) -> None:
    """The pooled ratio of 2,000 runs lies in 0.97 … 1.03, as far as its own chance of about 1 % allows to tell."""
    found = judged(KINDS[name], 2000, seed=12)
    assert found.failures <= found.runs // 100
    assert abs(found.pooled - 1) < 0.03 + 2 * found.pooled_error


LINE = """(problem p
  (data d external)
  (unknowns (a :init 2) (b :init -1))
  (observe d (= y (+ a (* b x))) :sigma {sigma}))"""
TABLE = {"d": {"x": np.linspace(0, 1, 20), "y": np.zeros(20)}}


def test_outliers_without_robust_options_are_found_out() -> None:
    """A tenth of errors of 10 σ makes the variance 11 times as large: the ratio is 3.3, and the costs are no χ²."""
    found = coverage(mbm.loads(LINE.format(sigma=0.1)), runs=100, data=TABLE, outliers=(0.1, 10.0))
    assert found.pooled == pytest.approx(np.sqrt(11), rel=0.15)
    assert found.worst_ratio() > 2.5
    assert found.cost_p is not None
    assert found.cost_p < 1e-6
    assert found.numbers[0].covered[1] < 0.8


def test_a_strongly_bent_model_covers_less_and_is_warned_of() -> None:
    """The reciprocal of a number known to 40 %: intervals of ±1.96 σ about the estimate miss on one side."""
    text = "(problem p (data d external) (unknowns (a :init 2)) (observe d (= y (/ 1 a)) :sigma 0.6))"
    found = coverage(mbm.loads(text), runs=100, data={"d": {"y": np.zeros(9)}})
    assert found.warned > 0.9


def test_the_same_seed_gives_the_same_answer() -> None:
    problem = mbm.loads(LINE.format(sigma=0.1))
    first, second = (coverage(problem, runs=5, seed=3, data=TABLE) for _ in range(2))
    assert first == second
    assert first != coverage(problem, runs=5, seed=4, data=TABLE)
