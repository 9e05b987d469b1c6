"""Counts and shares that scatter more than their distribution lets them, against how often chance makes them do so."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbm

Floats = np.ndarray[Any, np.dtype[np.float64]]
RUNS = 400
POISSON = "(problem p (data d external) (unknowns (m :init 2)) (observe d (= n m) :distribution poisson){more})"
SHARES = """(problem p (data d external) (unknowns (q :init 0.3))
  (observe d (= n (* {trials} q)) :distribution (binomial {trials})){more})"""


def doubted(text: str, counts: Floats, trials: int = 1) -> float:
    """The share of runs with doubts."""
    data = {"d": {"run": np.repeat(np.arange(1.0 * len(counts)), counts.shape[1]), "n": 1.0 * counts.ravel()}}
    solves = mbm.loads(text.format(trials=trials, more=" (for-each run)")).solve(data=data).document()["solves"]
    found = [{each["code"] for each in solve["diagnostics"]} for solve in solves]
    assert all(solve["chi2_p"] is None for solve in solves)
    return float(np.mean([bool(each & {"improbable-noise", "noise-against-data"}) for each in found]))


def test_shares_that_differ_between_rows_are_doubted() -> None:
    rng = np.random.default_rng(1)
    # Of 20,000 simulated sets of 15 rows 74 % are beyond the 99 % of the law; 0.07 is three deviations of chance.
    assert doubted(SHARES, rng.binomial(20, rng.beta(3, 7, (RUNS, 15))), 20) > 0.74 - 0.07


def test_small_counts_that_differ_between_rows_are_doubted() -> None:
    # As for shares: 44 % of 20,000 sets.
    assert doubted(POISSON, np.random.default_rng(2).negative_binomial(3, 0.5, (RUNS, 20))) > 0.44 - 0.08


@pytest.mark.parametrize("mean", [0.5, 2.0, 3.0])
def test_counts_are_not_doubted(mean: float) -> None:
    # One of a hundred is beyond the limit by chance; of 400, eleven or more are so in one of a thousand cases.
    assert doubted(POISSON, np.random.default_rng(3).poisson(mean, (RUNS, 20)) + 0) < 11 / RUNS


@pytest.mark.parametrize(("trials", "rows"), [(1, 200), (3, 60), (10, 20)])
def test_shares_are_not_doubted(trials: int, rows: int) -> None:
    counts = np.random.default_rng(4).binomial(trials, 0.5, (RUNS // 4, rows))
    assert doubted(SHARES, counts, trials) < 6 / (RUNS // 4)


def test_one_solve_says_what_many_say() -> None:
    counts = np.array([2.0, 14, 6, 0, 11, 3, 9, 1, 5, 12])
    solve = mbm.loads(SHARES.format(trials=20, more="")).solve(data={"d": {"n": counts}}).document()["solves"][0]
    assert [each["code"] for each in solve["diagnostics"]] == ["noise-against-data"]
    assert doubted(SHARES, counts[None], 20) == 1.0
